"""What of a scenario does not fit its robot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import InputError, Problem, ScenarioError, did_you_mean
from asrsim.robot import Robot, load_robot, merge_fixed
from asrsim.robot.mounting import reference_names
from asrsim.scenario.apply import apply_to_robot
from asrsim.scenario.choices import prescribes_motion, released_order
from asrsim.scenario.data import Scenario
from asrsim.scenario.doubts import doubts
from asrsim.scenario.places import placed
from asrsim.scenario.signal_doubts import over_run, reference_key, signal_doubts, signal_faults

PLANNED_MODES = (1, 2, 3, 5, 6)
"""Modes whose references are positions: the only ones that a Cartesian path can drive."""


def checked_robot(scenario: Scenario, robot: Robot | None = None) -> tuple[Robot, list[Problem]]:
    """The scenario's robot as its file has it, read unless given, and warnings. Raises RobotError, or ScenarioError with
    everything of the scenario that does not fit it.
    """
    if robot is None:
        robot = load_robot(scenario.robot, xacro_arguments=scenario.xacro_arguments, package_paths=scenario.package_paths)
    errors, warnings = check_against_robot(scenario, robot)
    if errors:
        raise ScenarioError(errors)
    return robot, warnings


def check_against_robot(scenario: Scenario, robot: Robot, *, propose: bool = False) -> tuple[list[Problem], list[Problem]]:
    """(errors, warnings): names that the robot does not have, values that it cannot take, references that are missing.

    `robot` is the file's; the scenario's modes and parameters are applied here. propose: parameters that hold an arm that
    falls, which takes a while.
    """
    errors: list[Problem] = []
    warnings: list[Problem] = []
    if not robot.moving_joints:
        return [nothing_moves(robot)], []
    try:
        changed = apply_to_robot(scenario, robot)
    except InputError as error:
        errors.extend(error.problems)
        try:
            # Its actuators alone, so that their references are not told of too.
            changed = apply_to_robot(replace(scenario, modes={}, parameters={}), robot)
        except InputError:
            if scenario.actuators:
                return errors, []
            changed = robot

    def with_places(*found: Iterable[Problem]) -> list[Problem]:
        return [placed(scenario, problem) for problem in chain(*found)]

    checks = (_unknown_names, _initial, _floating, _ranges, _task)
    errors += with_places(*(check(scenario, changed) for check in checks))
    warnings += with_places(_default_start(scenario, changed), _sensors(scenario, changed), doubts(scenario, robot, changed))
    errors += with_places(_released(scenario, changed))
    faults = with_places(signal_faults(scenario))
    errors += faults
    warnings += [] if faults else with_places(signal_doubts(scenario, changed))
    for problem, fatal in (*_references(scenario, changed), *(() if faults else _sigma(scenario, changed))):
        (errors if fatal else warnings).append(placed(scenario, problem))
    if not errors:
        from asrsim.kinematics.sizing import holding_findings

        warnings.extend(holding_findings(scenario, changed, propose=propose))
    return errors, warnings


def nothing_moves(robot: Robot) -> Problem:
    """What is said of a robot without a joint that moves."""
    return Problem("the robot has no moving joint: there is nothing to simulate", file=robot.path, code="no-joint")


def _unknown_names(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    moving = tuple(joint.name for joint in robot.moving_joints)
    actuated = tuple(block.joint for block in robot.actuators)
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
        hint=did_you_mean(name, known),
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
    if scenario.fixed_base or prescribes_motion(scenario.engine):
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


def _references(scenario: Scenario, robot: Robot) -> Iterator[tuple[Problem, bool]]:
    """References of each actuator: (problem, whether it is an error)."""
    common = scenario.references.get("*", {})
    allowed_somewhere = {name for block in robot.actuators for name in MODES[block.mode].references}
    known = tuple(sorted(allowed_somewhere))
    for name in common:
        if name not in allowed_somewhere:
            message = "no actuator of the robot has this reference in its mode"
            hint = did_you_mean(name, known)
            key = f"references.*.{name}"
            yield Problem(message, key=key, choices=known, hint=hint, code="unknown-reference"), True
    for block in robot.actuators:
        names = reference_names(block)
        mode = MODES[block.mode]
        own = scenario.references.get(block.joint, {})
        for name in own:
            if name not in names and name in mode.references:
                message = f"an actuator of type {block.actuator} has no second reference: it does nothing"
                yield Problem(message, key=f"references.{block.joint}.{name}", code="unused-reference"), False
            elif name not in names:
                message = f"mode {mode.number} ({mode.name}) has no such reference"
                key = f"references.{block.joint}.{name}"
                hint = did_you_mean(name, names)
                yield Problem(message, key=key, choices=names, hint=hint, code="unknown-reference"), True
        for name in names:
            if name not in own and name not in common and not made_elsewhere(scenario, block.joint):
                message = f"joint '{block.joint}' has no {name}: it rests at its start"
                yield Problem(message, key=f"references.{block.joint}", code="missing-reference"), False


def _ranges(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Ranges of references that no joint has, or not the joint that they stand under."""
    blocks = {block.joint: reference_names(block) for block in robot.actuators}
    for joint, ranges in scenario.reference_ranges.items():
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


def _sigma(scenario: Scenario, robot: Robot) -> Iterator[tuple[Problem, bool]]:
    """References of adjusters that their lever does not reach: (problem, whether it is an error)."""
    for block in robot.actuators:
        names, values = MODES[block.mode].references, block.values()
        signal = scenario.references_of(block.joint).get(names[-1])
        # In the released order an adjuster has a motor, whose torque the reference of mode 4 is.
        torque = block.mode == 4 and released_order(scenario.stepping)
        if signal is None or len(names) < 2 or torque or not ACTUATORS.get(block.actuator).adjuster:
            continue
        key, length = reference_key(scenario, block, names[1]), values.get("lever_length", np.inf)
        time, sigma = over_run(scenario, signal)
        if (largest := float(sigma.max())) >= length:
            message = f"sigma of '{block.joint}' reaches the lever's length L = {length:g} m at {time[np.argmax(sigma)]:g} s"
            hint = "There the stiffness is infinite: stay below L"
            yield Problem(message, key=key, value=largest, hint=hint, code="sigma-limit"), True
        elif (least := float(sigma.min())) < 0.0:
            message = f"sigma of '{block.joint}' is negative at {time[np.argmin(sigma)]:g} s"
            yield Problem(message, key=key, value=least, code="sigma-negative"), False
