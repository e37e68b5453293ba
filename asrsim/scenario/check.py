"""What of a scenario does not fit its robot."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import Problem, RobotError, ScenarioError, did_you_mean
from asrsim.robot import ActuatorBlock, Robot, merge_fixed, read_robot
from asrsim.robot.mounting import reference_names
from asrsim.samples import Array
from asrsim.scenario.apply import laid_on
from asrsim.scenario.choices import prescribes_motion, released_order
from asrsim.scenario.data import Scenario
from asrsim.scenario.doubts import doubts
from asrsim.scenario.places import placed
from asrsim.scenario.signal_doubts import over_run, reference_key, signal_doubts, signal_faults

MOST_DELAY = 1_000_000
"""Steps of a delay."""
PLANNED_MODES = (1, 2, 3, 5, 6)
"""Modes whose references are positions: the only ones that a Cartesian path can drive."""


def checked_robot(scenario: Scenario, robot: Robot | None = None) -> tuple[Robot, list[Problem]]:
    """The scenario's robot as its file has it, read unless given, and warnings. Raises RobotError with everything that is wrong
    with the file, and ScenarioError with everything of the scenario that does not fit it: one error where both are at fault.
    """
    if robot is None:
        robot = robot_of(scenario)
    errors, warnings = check_against_robot(scenario, robot)
    if errors:
        raise (RobotError if robot.faults else ScenarioError)(errors, warnings=robot.warnings)
    return robot, warnings


def robot_of(scenario: Scenario) -> Robot:
    """The robot that the scenario names, with its file's faults. Raises RobotError where there is none in it."""
    return read_robot(scenario.robot, xacro_arguments=scenario.xacro_arguments, package_paths=scenario.package_paths)


def check_against_robot(
    scenario: Scenario, robot: Robot | None, *, propose: bool = False
) -> tuple[list[Problem], list[Problem]]:
    """(errors, warnings): the robot file's own faults; names that the robot does not have, values that it cannot take,
    references that are missing. What rests on a value that has a fault itself, in either file, is not checked.

    `robot` is the file's, None where it cannot be read; the scenario's modes and parameters are applied here. propose:
    parameters that hold an arm that falls, which takes a while.
    """
    if robot is None or not robot.moving_joints:
        own = [placed(scenario, problem) for problem in signal_faults(scenario)]
        return own if robot is None else [*robot.faults, nothing_moves(robot), *own], []
    changed, faults = laid_on(scenario, robot)
    errors = [*robot.faults, *faults]
    # Actuators whose mode is known.
    driven = replace(changed, actuators=tuple(block for block in changed.actuators if block.joint not in changed.unread))
    unread = {key for key, *_ in scenario.unread}
    for needed, check in CHECKS:
        if not unread.intersection(needed):
            errors += (placed(scenario, problem) for problem in check(scenario, driven))
    if robot.faults or faults or unread:
        return errors, []
    found = [*_default_start(scenario, changed), *_sensors(scenario, changed), *doubts(scenario, robot, changed)]
    if not any(signal_faults(scenario)):
        found += (*signal_doubts(scenario, changed), *_idle_references(scenario, changed), *_negative_sigma(scenario, changed))
    warnings = [placed(scenario, problem) for problem in found]
    if not errors:
        from asrsim.kinematics.sizing import holding_findings

        warnings.extend(holding_findings(scenario, changed, propose=propose))
    return errors, warnings


def nothing_moves(robot: Robot) -> Problem:
    """What is said of a robot without a joint that moves."""
    return Problem("the robot has no moving joint: there is nothing to simulate", file=robot.path, code="no-joint")


def _unknown_names(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    moving = tuple(joint.name for joint in robot.moving_joints)
    actuated = (*(block.joint for block in robot.actuators), *sorted(robot.unread))
    links = tuple(link.name for link in robot.links)
    by_joint: tuple[tuple[str, Iterable[str], tuple[str, ...]], ...] = (
        ("initial", scenario.initial_positions, moving),
        ("references", scenario.references, actuated),
        ("reference_ranges", scenario.reference_ranges, moving),
        ("desired", scenario.desired, moving),
        ("external_torques", scenario.external_torques, moving),
        ("effects.commands", scenario.command_effects, actuated),
        ("effects.sensors", scenario.sensor_effects, actuated),
        ("link_damping", scenario.link_damping, actuated),
        ("motion", scenario.motion, moving),
        *((section, table, actuated) for section, table in scenario.trajectories.items()),
        ("ilc.joint_gains", scenario.learning.joint_gains if scenario.learning else (), actuated),
        ("task.preset", scenario.task.preset if scenario.task else (), actuated),
    )
    for section, names, known in by_joint:
        for name in names:
            if name != "*" and name not in known:
                yield _unknown(f"{section}.{name}", name, known, "joint", "actuated " if known is actuated else "moving ")
    for name in scenario.joint_order:
        if name not in moving:
            yield _unknown("manager", name, moving, "joint", "moving ")
    for name in scenario.task.joints if scenario.task else ():
        if name not in actuated:
            yield _unknown("task.joints", name, actuated, "joint", "actuated ")
    for index, claim in enumerate(scenario.expect):
        if claim.joint is not None and claim.joint != "*" and claim.joint not in moving:
            problem = _unknown(f"expect.{index}.joint", claim.joint, moving, "joint", "moving ")
            yield replace(problem, file=scenario.path, line=claim.line)
    for index, wrench in enumerate(scenario.wrenches):
        if wrench.link not in links:
            yield _unknown(f"wrenches.{index}.link", wrench.link, links, "link")
    if scenario.task and scenario.task.link not in links:
        yield _unknown("task.link", scenario.task.link, links, "link")


def _unknown(key: str, name: str, known: tuple[str, ...], noun: str, kind: str = "") -> Problem:
    return Problem(
        f"the robot has no {kind}{noun} '{name}'",
        key=key,
        choices=known,
        meant=name,
        code=f"unknown-{noun}",
    )


def _released(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """The toolbox's order of a step has the toolbox's motors: voltages and currents are none of its references."""
    for block in robot.actuators if released_order(scenario.stepping) else ():
        mode = MODES[block.mode]
        if mode.command != "torque":
            message = f"'{block.joint}' is in mode {mode.number} ({mode.name}), which the toolbox does not have"
            yield Problem(message, key="stepping", value=scenario.stepping, code="released-mode")


def _task(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Modes that no path can drive, and poses that the run ends before."""
    if scenario.task is None:
        return
    for block in robot.actuators:
        if block.mode not in PLANNED_MODES:
            message = f"a Cartesian task drives positions, which mode {block.mode} does not take"
            choices = tuple(map(str, PLANNED_MODES))
            yield Problem(message, key=f"modes.{block.joint}", value=block.mode, choices=choices, code="mode-not-planned")
    for index, pose in enumerate(scenario.task.poses):
        # The rounding of a duration that is counted in steps is no overrun.
        if pose.time > scenario.duration * (1 + 1e-9):
            yield Problem(
                f"comes after the run's end at {scenario.duration:g} s",
                key=f"task.poses.{index}.time",
                value=pose.time,
                hint=f"Let the run last at least {pose.time:g} s (duration), or move the pose before its end",
                code="pose-after-end",
            )


def _initial(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    for joint in robot.moving_joints:
        key = joint.name if joint.name in scenario.initial_positions else "*"
        position = scenario.initial_positions.get(key)
        low, high = joint.stops
        if position is not None and not low <= position <= high:
            message = f"lies outside the limits of '{joint.name}', {low:g} to {high:g}"
            yield Problem(message, key=f"initial.{key}", value=position, code="initial-limits")


def _default_start(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Joints that start at 0, since nothing else is said, where their limits do not let them be."""
    if scenario.initial_equilibrium or "*" in scenario.initial_positions or prescribes_motion(scenario.engine):
        return
    for joint in robot.moving_joints:
        low, high = joint.stops
        if joint.name not in scenario.initial_positions and not low <= 0.0 <= high:
            message = f"starts at 0, outside its limits, {low:g} to {high:g}: its stop throws it back"
            hint = f"Say under `initial` where it starts, such as {low if low > 0.0 else high:g}"
            yield Problem(message, key=f"initial.{joint.name}", hint=hint, code="default-start")


def _floating(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """A floating body without mass: an engine holds it still, or makes up a mass. What fixed joints hold to it counts."""
    if scenario.fixed_base or prescribes_motion(scenario.engine) or robot.faults:
        return
    body = merge_fixed(robot).robot.root
    if not (body.mass and body.inertia and any(body.inertia)):
        message = f"a floating robot needs mass and inertia in its root link '{body.name}', or in what is fixed to it"
        yield Problem(message, key="base.fixed", value=False, code="massless-base")


def _sensors(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Effects on sensors that no controller reads, and delays that are no whole number of steps."""
    for name, effects in scenario.sensor_effects.items():
        blocks = [block for block in robot.actuators if name in ("*", block.joint)]
        if effects.active and blocks and not any(MODES[block.mode].controller for block in blocks):
            modes = ", ".join(sorted({str(block.mode) for block in blocks}))
            message = f"no controller reads this sensor in mode {modes}: it does nothing"
            yield Problem(message, key=f"effects.sensors.{name}", code="unused-effect")
        steps = effects.delay / scenario.step
        if abs(steps - round(steps)) > 1e-6:
            message = "is no whole number of steps and may be rounded"
            yield Problem(message, key=f"effects.sensors.{name}.delay", value=effects.delay, code="delay")


def _all_references(block: ActuatorBlock) -> tuple[str, ...]:
    """References of its mode, whether or not they do something."""
    return MODES[block.mode].references_of(ACTUATORS.get(block.actuator).motors)


def _unknown_references(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """References that the mode of no actuator has, or not that of the joint's."""
    known = tuple(sorted({name for block in robot.actuators for name in _all_references(block)}))
    for name in scenario.references.get("*", {}) if not robot.unread else ():
        if name not in known:
            message = "no actuator of the robot has this reference in its mode"
            hint = did_you_mean(name, known)
            yield Problem(message, key=f"references.*.{name}", choices=known, hint=hint, code="unknown-reference")
    for block in robot.actuators:
        mode, names = MODES[block.mode], reference_names(block)
        for name in scenario.references.get(block.joint, {}):
            if name not in _all_references(block):
                message = f"mode {mode.number} ({mode.name}) has no such reference"
                key, hint = f"references.{block.joint}.{name}", did_you_mean(name, names)
                yield Problem(message, key=key, choices=names, hint=hint, code="unknown-reference")


def _idle_references(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """References that do nothing, and those that are missing."""
    common = scenario.references.get("*", {})
    for block in robot.actuators:
        names, own = reference_names(block), scenario.references.get(block.joint, {})
        for name in own:
            if name not in names and name in _all_references(block):
                message = f"an actuator of type {block.actuator} has no second reference: it does nothing"
                yield Problem(message, key=f"references.{block.joint}.{name}", code="unused-reference")
        for name in names:
            if name not in own and name not in common and not made_elsewhere(scenario, block.joint):
                message = f"joint '{block.joint}' has no {name}: it rests at its start"
                yield Problem(message, key=f"references.{block.joint}", code="missing-reference")


def _delays(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Delays of sensors and commands that need more memory than there is."""
    for section, table in (("commands", scenario.command_effects), ("sensors", scenario.sensor_effects)):
        for name, effects in table.items():
            if effects.delay > MOST_DELAY * scenario.step:
                message = f"is longer than {MOST_DELAY} steps of {scenario.step:g} s, all of which would be kept"
                yield Problem(message, key=f"effects.{section}.{name}.delay", value=effects.delay, code="long-delay")


def _ranges(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Ranges of references that no joint has, or not the joint that they stand under."""
    blocks = {block.joint: reference_names(block) for block in robot.actuators}
    for joint, ranges in scenario.reference_ranges.items():
        if joint in robot.unread or (joint == "*" and robot.unread):
            continue
        known = {name for names in blocks.values() for name in names} if joint == "*" else set(blocks.get(joint, ()))
        choices = (*sorted(known), "external_torque")
        for name in ranges:
            if name not in choices:
                key, hint = f"reference_ranges.{joint}.{name}", did_you_mean(name, choices)
                message = "there is no such reference in the mode"
                yield Problem(message, key=key, choices=choices, hint=hint, code="unknown-reference")


def made_elsewhere(scenario: Scenario, joint: str) -> bool:
    """Whether a Cartesian task, or learning, makes the joint's reference."""
    if any(joint in trajectory or "*" in trajectory for trajectory in scenario.trajectories.values()):
        return True
    return scenario.task is not None and (not scenario.task.joints or joint in scenario.task.joints)


def _sigma(scenario: Scenario, robot: Robot) -> Iterator[tuple[str, Array, Array, ActuatorBlock]]:
    """References of adjusters over the run, unless they fail: (key, times in s, values in m, actuator)."""
    for block in robot.actuators:
        names = MODES[block.mode].references
        signal = scenario.references_of(block.joint).get(names[-1])
        # In the released order an adjuster has a motor, whose torque the reference of mode 4 is.
        torque = block.mode == 4 and released_order(scenario.stepping)
        if signal is not None and len(names) > 1 and not torque and ACTUATORS.get(block.actuator).adjuster:
            try:
                time, sigma = over_run(scenario, signal)
            except Exception:  # a user's own signal may raise anything; signal_faults says so
                continue
            if np.isfinite(sigma).all():
                yield reference_key(scenario, block, names[1]), time, sigma, block


def _long_sigma(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """References of adjusters that their lever does not reach."""
    for key, time, sigma, block in _sigma(scenario, robot):
        length, largest = block.values().get("lever_length", np.inf), float(sigma.max())
        if largest >= length:
            message = f"sigma of '{block.joint}' reaches the lever's length L = {length:g} m at {time[np.argmax(sigma)]:g} s"
            hint = "There the stiffness is infinite: stay below L"
            yield Problem(message, key=key, value=largest, hint=hint, code="sigma-limit")


def _negative_sigma(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """References of adjusters that go below 0 and not beyond the lever."""
    for key, time, sigma, block in _sigma(scenario, robot):
        length = block.values().get("lever_length", np.inf)
        if (least := float(sigma.min())) < 0.0 and float(sigma.max()) < length:
            message = f"sigma of '{block.joint}' is negative at {time[np.argmin(sigma)]:g} s"
            yield Problem(message, key=key, value=least, code="sigma-negative")


Check = Callable[[Scenario, Robot], Iterator[Problem]]
CHECKS: tuple[tuple[tuple[str, ...], Check], ...] = (
    ((), _unknown_names),
    ((), _initial),
    (("base", "engine"), _floating),
    ((), _ranges),
    (("step",), _delays),
    (("task", "duration"), _task),
    (("stepping",), _released),
    (("duration", "step"), lambda scenario, _: signal_faults(scenario)),
    ((), _unknown_references),
    (("duration", "step", "stepping"), _long_sigma),
)
"""(keys on which it rests, check): errors, on the robot as the scenario changes it."""
