"""Warnings about a robot that can be simulated: values that are probably mistakes, and settings without effect.

To add a warning, write a generator and list it in `ROBOT_CHECKS` or `BLOCK_CHECKS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import combinations
from typing import Unpack

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.stages import STAGES
from asrsim.errors import Details, Problem
from asrsim.robot.model import ActuatorBlock, Joint, Link, Robot
from asrsim.robot.poses import link_poses
from asrsim.robot.structure import EMPTY_LIMIT
from asrsim.robot.values import has_spring, stage_acts

HEAVY = 50.0
"""Largest plausible mass of a link in arms below 0.8 m, kg; for larger arms the limit grows with the cube of the arm's size."""
DENSITY = 100.0
"""Largest plausible density of a robot, over the cube around it, kg/m^3; industrial arms have 10 to 30."""
AWAY = 2.0
"""Largest plausible distance of a centre of mass from its link's frame, in addition to twice the size of the robot, m."""
DEGREES = (20.0, 720.0)
"""Range of limits of a revolute joint, in rad, that were probably stated in degrees."""
WIDE = 100.0
"""Largest plausible size of a robot, m."""
UNUSUAL = 1e4
"""Largest usual ratio of a parameter to its default; the smallest usual ratio is the inverse."""
ROTORS = 0.05
"""Relative difference between the rotor inertia in the file and the inertia of the actuator's motors, above which these two
values contradict each other.
"""
EXCHANGED = 1.5
"""Smallest difference of each of two parameters from its default, in powers of ten, for which the two may have been
exchanged."""
GAINS = ("proportional", "integral", "derivative")


def warnings_of(robot: Robot) -> tuple[Problem, ...]:
    """Warnings about the robot's file, and about links, joints and actuators whose values are probably mistakes. Values are not
    checked in a file with errors.
    """
    return robot.findings if robot.faults else (*robot.findings, *_doubts(robot))


def _doubts(robot: Robot) -> Iterator[Problem]:
    """Warnings about values. If the scenario states a parameter, the key of its warning is a key of the scenario."""
    for check in ROBOT_CHECKS:
        yield from check(robot)
    for block in robot.actuators:
        name = block.plugin_name or block.joint
        for doubt in _block_doubts(block, robot.joint(block.joint)):
            set_by = [block.parameters[name] for name in (doubt.key or "").split(", ") if name]
            if not set_by:
                yield replace(doubt, file=robot.path, line=block.line, key=name)
            elif set_by[0].origin == "scenario":
                yield replace(doubt, key=f"parameters.{block.joint}.{doubt.key}")
            else:
                key = f"{name}.{', '.join(parameter.tag for parameter in set_by)}"
                yield replace(doubt, file=robot.path, line=set_by[0].line, key=key)


# -- links and joints --------------------------------------------------------------------------------------------------


def _about(message: str, robot: Robot, part: Link | Joint, *, code: str, **details: Unpack[Details]) -> Problem:
    return Problem(message, code=code, file=robot.path, line=part.line, key=part.name, **details)


def _sizes(robot: Robot) -> Iterator[Problem]:
    """Warnings about masses and lengths that are probably in g and mm."""
    poses = link_poses(robot)
    points = [pose.position for pose in poses.values()]
    for link in robot.links:
        for shape in (*link.collisions, *link.visuals):
            centre = poses[link.name].position + poses[link.name].rotation @ shape.origin
            reach = max(shape.size, default=0.0) / 2.0
            points += [centre - reach, centre + reach]
    size = float(np.ptp(points, axis=0).max())
    if size > WIDE and robot.joints:
        farthest = max(robot.joints, key=lambda joint: math.hypot(*joint.origin))
        yield _about("makes a very large robot (lengths are in m)", robot, farthest, code="wide-robot", value=f"{size:.4g} m")
    # A robot with one link and without shapes has no size.
    what = f"a robot of {size:.2g} m" if size else "a robot"
    for link in robot.links:
        moves, mass, inertia = link is not robot.root, link.mass or 0.0, link.inertia or (0.0,) * 6
        if moves and mass > max(HEAVY, DENSITY * size**3):
            yield _about(
                f"the link is heavy for {what} (masses are in kg)", robot, link, code="heavy-link", value=f"{mass:g} kg"
            )
        away = math.hypot(*link.centre_of_mass)
        if away > AWAY + 2.0 * size:
            message = f"the centre of mass lies far outside {what} (lengths are in m)"
            yield _about(message, robot, link, code="far-centre", value=f"{away:g} m from the link's frame")
        gyration = math.sqrt(max(inertia[0], inertia[3], inertia[5], 0.0) / mass) if mass else 0.0
        if moves and gyration > AWAY + 2.0 * size:
            message = f"only a body far larger than {what} has this inertia (in kg m^2)"
            yield _about(message, robot, link, code="large-inertia", value=f"radius of gyration {gyration:.4g} m")


def _no_inertial(robot: Robot) -> Iterator[Problem]:
    """Warnings about links without `<inertial>`, except the root, since PyBullet would assume that such a link has a mass of 1
    kg."""
    for link in robot.links:
        if link.mass is None and link is not robot.root:
            message = "link has no <inertial>: the link is taken as massless (PyBullet alone would assume 1 kg)"
            yield _about(message, robot, link, code="no-inertial")


def _limits(robot: Robot) -> Iterator[Problem]:
    for joint in robot.moving_joints:
        if joint.velocity == 0.0:
            message = "the joint's velocity limit is 0: every motion exceeds it"
            yield _about(message, robot, joint, code="zero-velocity-limit", hint=EMPTY_LIMIT)
        bounds = [bound for bound in (joint.lower, joint.upper) if bound is not None]
        if joint.kind == "revolute" and any(DEGREES[0] < abs(bound) <= DEGREES[1] for bound in bounds):
            value = " to ".join(f"{bound:g}" for bound in bounds)
            message = "the limits allow several turns: are they in degrees? Limits are in rad"
            yield _about(message, robot, joint, code="limit-in-degrees", value=value, hint="180 degrees are 3.14159 rad")


def _passive(robot: Robot) -> Iterator[Problem]:
    """Warnings about the springs of `<gazebo reference>`."""
    driven = {block.joint for block in robot.actuators}
    for joint in robot.moving_joints:
        stiffness = joint.spring_stiffness
        if stiffness < 0.0:
            message = "the passive spring pushes the joint away from its reference: its stiffness is negative"
            yield _about(message, robot, joint, code="negative-spring", value=f"{stiffness:g}")
        elif not stiffness and joint.spring_reference:
            yield _about("the passive spring has no stiffness: it has no effect", robot, joint, code="no-spring")
        if stiffness and joint.name in driven:
            message = "the joint has an actuator and a passive spring: both act on it"
            yield _about(message, robot, joint, code="two-springs", value=f"{stiffness:g}")


def _no_actuators(robot: Robot) -> Iterator[Problem]:
    if not robot.actuators and robot.moving_joints:
        hint = "`asrsim init FILE --actuator NAME` writes a scenario that puts an actuator on every joint"
        message = "no actuator of the toolbox is in this file: no joint is driven"
        yield Problem(message, code="no-actuators", file=robot.path, key=robot.name, hint=hint)


ROBOT_CHECKS: tuple[Callable[[Robot], Iterator[Problem]], ...] = (_no_inertial, _sizes, _limits, _passive, _no_actuators)


# -- actuators ---------------------------------------------------------------------------------------------------------


def _block_doubts(block: ActuatorBlock, joint: Joint) -> tuple[Problem, ...]:
    """Warnings about one actuator. The key of a warning names its parameters, separated by commas; None: the whole actuator.

    Parameters with the same warning, such as the parameters of two motors, share this warning.
    """
    merged: dict[tuple[str, str], Problem] = {}
    for check in BLOCK_CHECKS:
        for doubt in check(block, joint):
            first = merged.setdefault((doubt.message, doubt.code), doubt)
            if first is not doubt:
                merged[doubt.message, doubt.code] = replace(first, key=f"{first.key}, {doubt.key}")
    return tuple(merged.values())


def _of_joint(block: ActuatorBlock, joint: Joint) -> Iterator[Problem]:
    if joint.kind == "prismatic":
        yield Problem("the joint is prismatic: the actuator's rad and N m are taken as m and N", code="prismatic-joint")
    if joint.effort is None:
        yield Problem("the joint has no effort limit: torques are not clipped", code="no-effort-limit")
    elif joint.effort == 0.0:
        message = "the joint's effort limit is 0: every torque is clipped to 0"
        yield Problem(message, code="zero-effort-limit", hint=EMPTY_LIMIT)
    yield from _left_rotor(block, joint)
    if MODES[block.mode].spring and not has_spring(block):
        names = [one.name for one in ACTUATORS.get(block.actuator).parameters if block.parameters[one.name].value == 0.0]
        message = "the spring has no stiffness: nothing couples the motor to the link"
        yield Problem(message, key=", ".join(names) or None, code="no-spring")


def _left_rotor(block: ActuatorBlock, joint: Joint) -> Iterator[Problem]:
    """Warning about the rotor inertia in the file behind a spring, unless the motors have this inertia or the scenario states
    `armature`.
    """
    mode, rotor = MODES[block.mode], joint.rotor_inertia
    own = sum(value for name, value in block.values().items() if name.startswith("motor_") and name.endswith("_inertia"))
    if not mode.spring or joint.armature or rotor <= 0.0 or (mode.motor and abs(own - rotor) <= ROTORS * rotor):
        return
    motors = f", which have {own:.3g} kg m^2" if mode.motor else f", whose positions are commands in mode {mode.number}"
    message = (
        f"a spring separates the link from the motors{motors}: the file's rotor of {rotor:.3g} kg m^2 at the joint is left out"
    )
    cure = "Set motor_1_inertia to the file's value, or set" if mode.motor else "If it moves with the link, set"
    yield Problem(message, code="two-rotors", hint=f"{cure} `armature` in the scenario")


def _of_parameters(block: ActuatorBlock, joint: Joint) -> Iterator[Problem]:
    """Warnings about single parameters that the file sets."""
    mode, values = MODES[block.mode], block.values()
    for declared in ACTUATORS.get(block.actuator).all_parameters():
        name, parameter = declared.name, block.parameters[declared.name]
        value = parameter.value
        if parameter.origin not in ("tag", "scenario"):
            continue
        if declared.unused:
            yield Problem(f"has no effect: {declared.unused}", key=name, code="unused-tag")
        if mode.controller and name.startswith("controller_") and name.endswith(GAINS) and value < 0.0:
            yield Problem("a negative gain drives away from the reference", key=name, code="negative-gain", value=f"{value:g}")
        if declared.optional and values.get(declared.needs, 1.0) <= 0.0:
            yield Problem(f"has no effect without {declared.needs}", key=name, code="no-effect", value=f"{value:g}")
        motor = name[: len("motor_1")]
        friction, largest = f"{motor}_friction_torque", f"{motor}_max_torque"
        if mode.motor and name in (friction, largest) and values[friction] >= values[largest] > 0.0:
            message = "the motor's friction is not below its largest torque: the motor never turns"
            yield Problem(message, key=name, code="stuck-motor", value=f"{values[friction]:g} N m")
        # The usual values are for revolute joints, so do not compare values of a prismatic joint with them.
        usual = 0.0 if joint.kind == "prismatic" or math.isinf(declared.default) else abs(declared.default)
        ratio = abs(value) / usual if usual and math.isfinite(value) else 0.0
        if ratio and not 1.0 / UNUSUAL < ratio < UNUSUAL:
            unit = "" if declared.unit == "1" else f" {declared.unit}"
            yield Problem(f"is {ratio:.1g} times the usual {usual:g}{unit}", key=name, code="unusual-value", value=f"{value:g}")


def _idle_stages(block: ActuatorBlock, _joint: Joint) -> Iterator[Problem]:
    """Warnings about stages whose parameters are set, but that do not act in this mode."""
    for stage in STAGES.loaded():
        first, *_ = stage.parameters
        given = block.parameters[first.name]
        if given.origin in ("tag", "scenario") and given.value != first.default and not stage_acts(stage, block):
            message = f"has no effect: the stage '{stage.title}' does not act in mode {block.mode} with these values"
            yield Problem(message, key=first.name, code="idle-stage", value=f"{given.value:g}")


def _one_controller(block: ActuatorBlock, _joint: Joint) -> Iterator[Problem]:
    """Warning about a block that sets only the gains of motor 1, so that motor 2 keeps the default gains."""
    mode = MODES[block.mode]
    differing = []
    for name, value in block.parameters.items() if mode.motor and mode.controller else ():
        other = block.parameters.get(name.replace("controller_1", "controller_2"))
        if other is not None and value.origin == "tag" and other.origin != "tag" and other.value != value.value:
            differing.append(f"<{value.tag}> is {value.value:g}, but {other.tag} is {other.value:g}")
    if differing:
        yield Problem(f"motor 2 keeps the default gains: {'; '.join(differing)}", code="one-controller-set")


def _exchanged(block: ActuatorBlock, _joint: Joint) -> Iterator[Problem]:
    """Warning about two spring parameters that are far from their defaults, but would be near their defaults if they were
    exchanged.
    """
    declared = {one.name: one.default for one in ACTUATORS.get(block.actuator).parameters}
    given = {
        name: one.value
        for name, one in block.parameters.items()
        if 0.0 < declared.get(name, 0.0) < math.inf and one.origin in ("tag", "scenario") and one.value > 0.0
    }
    left = [*given]
    for first, second in combinations(given, 2):
        own = [abs(math.log10(given[name] / declared[name])) for name in (first, second)]
        other = [abs(math.log10(given[a] / declared[b])) for a, b in ((second, first), (first, second))]
        if {first, second} <= {*left} and min(own) > EXCHANGED and max(other) < min(own) - 1.0:
            left = [name for name in left if name not in (first, second)]
            shown = f"{given[first]:g} and {given[second]:g}; usual values are {declared[first]:g} and {declared[second]:g}"
            yield Problem("these two values look exchanged", key=f"{first}, {second}", value=shown, code="exchanged-values")


BLOCK_CHECKS: tuple[Callable[[ActuatorBlock, Joint], Iterator[Problem]], ...] = (
    _of_joint,
    _of_parameters,
    _idle_stages,
    _one_controller,
    _exchanged,
)
