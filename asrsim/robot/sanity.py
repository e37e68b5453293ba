"""Numbers that are allowed and hardly meant: grams for kilograms, millimetres for metres, degrees for radians."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.robot.findings import EMPTY_LIMIT, Findings
from asrsim.robot.model import ActuatorBlock, Joint, Link, ParameterValue, Robot
from asrsim.robot.poses import Pose, link_poses
from asrsim.robot.values import has_spring

HEAVY = 50.0
"""kg: a link of an arm below 0.8 m is not that heavy; beyond, the bound grows with the cube of the arm's size."""
DENSITY = 100.0
"""kg/m^3 over the cube around the whole arm; industrial arms have 10 to 30."""
AWAY = 2.0
"""m that a centre of mass may lie outside everything that is known of the robot."""
DEGREES = (20.0, 720.0)
"""Limits of revolute joints in this range are turns of several, or degrees."""
WIDE = 100.0
"""m from one end of a robot to the other."""
UNUSUAL = 1e4
"""Times a parameter's default, or that part of it."""
GAINS = ("proportional", "integral", "derivative")


def check_sanity(findings: Findings, robot: Robot) -> None:
    """Warn of what a robot's numbers make improbable."""
    poses = link_poses(robot)
    size = _size(robot, poses)
    if size > WIDE and robot.joints:
        farthest = max(robot.joints, key=lambda joint: math.hypot(*joint.origin))
        findings.warn(
            "makes a very large robot (lengths are in m)", code="wide-robot", line=farthest.line, key=farthest.name,
            value=f"{size:.4g} m",
        )  # fmt: skip
    for link in robot.links:
        _check_body(findings, link, size, moves=link is not robot.root)
    for joint in robot.moving_joints:
        _check_limits(findings, joint)
    for block in robot.actuators:
        for doubt in block_doubts(block, robot.joint(block.joint)):
            line = block.line if doubt.parameter is None else doubt.parameter.line
            findings.warn(doubt.message, code=doubt.code, line=line, key=block.plugin_name or block.joint, value=doubt.value)


def _size(robot: Robot, poses: Mapping[str, Pose]) -> float:
    """m: the largest distance of frames and shapes from each other along an axis, at the zero pose."""
    points = np.array([point for link in robot.links for point in _points(link, poses[link.name])])
    return float(np.ptp(points, axis=0).max())


def _points(link: Link, pose: Pose) -> Iterator[np.ndarray]:
    yield pose.position
    for shape in (*link.collisions, *link.visuals):
        reach = max(shape.size, default=0.0) / 2.0
        centre = pose.position + pose.rotation @ shape.origin
        yield from (centre - reach, centre + reach)


def _check_body(findings: Findings, link: Link, size: float, *, moves: bool) -> None:
    bound = max(HEAVY, DENSITY * size**3)
    # A robot of one link without shapes has no size.
    what = f"a robot of {size:.2g} m" if size else "a robot"
    if moves and link.mass is not None and link.mass > bound:
        findings.warn(
            f"a heavy link for {what} (masses are in kg)", code="heavy-link", line=link.line, key=link.name,
            value=f"{link.mass:g} kg",
        )  # fmt: skip
    away = math.hypot(*link.centre_of_mass)
    if away > AWAY + 2.0 * size:
        findings.warn(
            f"the centre of mass lies far outside {what} (lengths are in m)",
            code="far-centre", line=link.line, key=link.name, value=f"{away:g} m from the link's frame",
        )  # fmt: skip
    largest = max(link.inertia[i] for i in (0, 3, 5)) if link.inertia is not None else 0.0
    gyration = math.sqrt(max(largest, 0.0) / link.mass) if link.mass else 0.0
    if moves and gyration > AWAY + 2.0 * size:
        findings.warn(
            f"the inertia is that of a body far larger than {what} (in kg m^2)", code="large-inertia", line=link.line,
            key=link.name, value=f"radius of gyration {gyration:.4g} m",
        )  # fmt: skip


def _check_limits(findings: Findings, joint: Joint) -> None:
    if joint.velocity == 0.0:
        findings.warn(
            "the joint's velocity limit is 0: it is beyond it whenever it moves", code="zero-velocity-limit", line=joint.line,
            key=joint.name, hint=EMPTY_LIMIT,
        )  # fmt: skip
    bounds = [bound for bound in (joint.lower, joint.upper) if bound is not None]
    if joint.kind == "revolute" and any(DEGREES[0] < abs(bound) <= DEGREES[1] for bound in bounds):
        findings.warn(
            "a limit of several turns; limits are in rad", code="limit-in-degrees", line=joint.line, key=joint.name,
            value=" to ".join(f"{bound:g}" for bound in bounds), hint="180 degrees are 3.14159 rad",
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """What of an actuator is hardly meant."""

    message: str
    code: str
    value: str | None = None
    parameter: ParameterValue | None = None
    """The parameter that is at fault, if it is one."""


def block_doubts(block: ActuatorBlock, joint: Joint) -> Iterator[Doubt]:
    """Negative gains, values far from all others, motors that stand still, and springs that are none."""
    mode = MODES[block.mode]
    # What is usual in N m/rad says nothing of a slider's N/m.
    yield from _unusual(block) if joint.kind != "prismatic" else ()
    yield from _held(block)
    for name, parameter in block.parameters.items():
        if mode.controller and name.startswith("controller_") and name.endswith(GAINS) and parameter.value < 0.0:
            message = f"a negative gain (<{parameter.tag}>) drives away from the reference"
            yield Doubt(message=message, code="negative-gain", value=f"{parameter.value:g}", parameter=parameter)
    yield from _model_doubts(block)
    if mode.spring and not has_spring(block):
        yield Doubt(message="the spring has no stiffness: nothing couples the motor to the link", code="no-spring")


def _unusual(block: ActuatorBlock) -> Iterator[Doubt]:
    """Given values that are far from the usual ones."""
    actuator = ACTUATORS.get(block.actuator)
    # The springs of a large drive are as much larger as its motors are.
    motors = [abs(block.parameters[one.name].value / one.default) for one in actuator.all_parameters()
              if one.name.endswith("max_torque") and one.default]  # fmt: skip
    size = max((ratio for ratio in motors if 1.0 < ratio < UNUSUAL), default=1.0)
    for declared in actuator.all_parameters():
        parameter, usual = block.parameters[declared.name], abs(declared.default)
        ratio = abs(parameter.value) / usual if usual and math.isfinite(usual) else 1.0
        ratio = ratio / min(size, ratio) if declared.name.startswith("spring") and ratio > 1.0 else ratio
        if ratio and not 1.0 / UNUSUAL < ratio < UNUSUAL and math.isfinite(ratio):
            unit = "" if declared.unit == "1" else f" {declared.unit}"
            message = f"<{parameter.tag}> is {ratio:.1g} times the usual {usual:g}{unit}"
            yield Doubt(message=message, code="unusual-value", value=f"{parameter.value:g}", parameter=parameter)


def _held(block: ActuatorBlock) -> Iterator[Doubt]:
    """Motors that their friction holds."""
    values, motors = block.values(), ACTUATORS.get(block.actuator).motors
    for motor in (f"motor_{i}" for i in range(1, motors + 1)) if MODES[block.mode].motor else ():
        friction, torque = block.parameters[f"{motor}_friction_torque"], values[f"{motor}_max_torque"]
        if friction.value >= torque > 0.0:
            message = f"<{friction.tag}> is as much as the motor's torque: it never turns"
            yield Doubt(message=message, code="stuck-motor", value=f"{friction.value:g} N m", parameter=friction)


def _model_doubts(block: ActuatorBlock) -> Iterator[Doubt]:
    """Optional models that are given in part, or beyond sense."""
    values = block.values()
    for declared in ACTUATORS.get(block.actuator).all_parameters():
        name, parameter = declared.name, block.parameters[declared.name]
        if not declared.optional or parameter.origin not in ("tag", "scenario"):
            continue
        if values.get(declared.needs, 1.0) <= 0.0:
            message = f"<{parameter.tag}> has no effect without {declared.needs}"
            yield Doubt(message=message, code="no-effect", value=f"{parameter.value:g}", parameter=parameter)
        if name.endswith("load_friction") and parameter.value >= 1.0:
            message = "friction grows by more than the load: the spring never turns the motor back"
            yield Doubt(message=message, code="self-locking", value=f"{parameter.value:g}", parameter=parameter)
