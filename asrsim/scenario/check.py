"""Checks whether a scenario fits its robot, and finds errors. `asrsim.scenario.doubts` finds warnings.

To add an error, write a generator and list it in `CHECKS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.document.kinds import walk
from asrsim.document.node import node_from_data
from asrsim.errors import Problem, RobotError, ScenarioError, counted, did_you_mean
from asrsim.robot import ActuatorBlock, Robot, merge_fixed, read_robot
from asrsim.robot.findings import LARGEST_NUMBER
from asrsim.robot.loops import Assembly, Loop, assembled, assembly_of, linkages_of
from asrsim.robot.model import UNREAD, is_locked
from asrsim.robot.mounting import equipped, reference_names
from asrsim.scenario.data import SCENARIO, Scenario
from asrsim.scenario.kinds import RELEASED_MOTORS, prescribes_motion, released_order
from asrsim.scenario.names import unknown_names
from asrsim.scenario.signal_checks import over_run, reference_key, signal_faults
from asrsim.scenario.starts import stated_start

MOST_DELAY = 1_000_000
"""Largest number of steps in a delay."""
MOST_TICKS = 100
"""Largest number of ticks of a sensor or a command in a step. There is a limit, since each tick splits the step into further
pieces."""
PLAIN_NUMBERS = ("base", "gravity", "initial", "link_damping", "task", "world")
"""Keys of the scenario that hold numbers and no signals."""
PLANNED_MODES = (1, 2, 3, 5, 6)
"""Modes whose references are positions, which a Cartesian path requires."""


def robot_of(scenario: Scenario) -> Robot:
    """Robot in the file that the scenario names, with the problems of the file. Raises RobotError if the file has no robot."""
    return read_robot(
        scenario.robot, xacro_arguments=scenario.xacro_arguments, package_paths=scenario.package_paths, locked=scenario.locked
    )


def misfits(scenario: Scenario, robot: Robot | None) -> tuple[Robot | None, list[Problem], list[Problem]]:
    """Robot with the scenario's changes; errors in the robot's file and in these changes; and other errors in the scenario,
    such as unknown names, invalid values and impossible references. The robot is None if it has no moving joint or cannot be
    read. Checks that depend on an invalid value are skipped. The problems do not state their lines yet; `Scenario.placed` adds
    the lines.

    robot: Robot of the file, without the scenario's modes and parameters; None if the file cannot be read.
    """
    if robot is None or not robot.moving_joints:
        return None, [] if robot is None else [*robot.faults, nothing_moves(robot)], [*signal_faults(scenario)]
    changed, faults = changed_robot(scenario, robot)
    errors: list[Problem] = []
    # Only actuators with a known mode can be checked.
    driven = replace(changed, actuators=tuple(block for block in changed.actuators if block.joint not in changed.unread))
    unread = {key for key, *_ in scenario.unread}
    for needed, check in CHECKS:
        if not unread.intersection(needed):
            errors += check(scenario, driven)
    return changed, [*robot.faults, *faults], errors


def loop_warnings(scenario: Scenario, source: Robot, robot: Robot) -> list[Problem]:
    """Warnings about the closed chains of a robot with the scenario's changes. source: robot of the file, whose joints have the
    initial positions and limits of the file.
    """
    stated = replace(robot, joints=source.joints)
    return [*map(scenario.placed, assembled(stated, _assembly(scenario, stated))[1])] if robot.loops else []


def apply_to_robot(scenario: Scenario, robot: Robot) -> Robot:
    """Robot with the scenario's actuators, modes, parameters (origin `scenario`) and namespace in its actuator blocks.

    Raises ScenarioError with every unknown joint, mode or parameter and every value out of range.
    """
    changed, problems = changed_robot(scenario, robot)
    if problems:
        raise ScenarioError(list(map(scenario.placed, problems)))
    return changed


def changed_robot(scenario: Scenario, robot: Robot) -> tuple[Robot, list[Problem]]:
    """Robot with the valid changes of the scenario, and the problems of the other changes. The problems do not state their
    lines yet."""
    given = scenario.actuators
    unread = set[str]()
    parameters = {joint: dict(values) for joint, values in scenario.parameters.items()}
    for section, *rest in scenario.unread:
        if section == "parameters" and len(rest) == 2:
            parameters.setdefault(rest[0], {})[rest[1]] = UNREAD
        elif section in ("actuators", "modes", "parameters"):
            joint = rest[0] if rest else "*"
            unread |= {one.name for one in robot.moving_joints} if joint == "*" else {joint}
    looped, wrong = _with_loops(scenario, robot)
    changed, problems = equipped(
        looped,
        {joint: (one.type, one.mode) for joint, one in given.items()},
        {joint: one.parameters for joint, one in given.items() if one.parameters},
        modes=scenario.modes,
        parameters=parameters,
        armature=scenario.armature,
        unread=unread,
    )
    problems += wrong
    if scenario.weightless:
        off = scenario.weightless
        links = tuple(replace(link, gravity=link.gravity and link.name not in off) for link in changed.links)
        changed = replace(changed, links=links)
    if changed.loops:
        assembly = _assembly(scenario, changed)
        changed, _ = assembled(changed, assembly)
        problems += assembly.errors
    if scenario.namespace is not None:
        blocks = tuple(replace(block, namespace=scenario.namespace) for block in changed.actuators)
        changed = replace(changed, actuators=blocks)
    return changed, problems


def _with_loops(scenario: Scenario, robot: Robot) -> tuple[Robot, list[Problem]]:
    """Robot with the closed chains of its file and of the scenario, and the problems of these chains. If file and scenario
    state a chain between the same links, the scenario's chain is used.
    """
    names = {link.name for link in robot.links}
    own = tuple(
        Loop(links=(loop.links[0], loop.links[1]), points=(loop.points[0], loop.points[1]), master=loop.master or "")
        for loop in scenario.loops
        if names.issuperset(loop.links)  # another check reports unknown links
    )
    if not own:
        return robot, []
    ends = {frozenset(loop.links) for loop in own}
    looped = replace(robot, loops=(*own, *(loop for loop in robot.loops if frozenset(loop.links) not in ends)))
    try:
        linkages_of(looped)
    except RobotError as error:
        return robot, list(error.problems)
    return looped, []


def _assembly(scenario: Scenario, robot: Robot) -> Assembly:
    """Closed chains of the robot at the scenario's initial positions."""
    joints = tuple(replace(joint, start=stated_start(scenario, joint)) if joint.moves else joint for joint in robot.joints)
    stated = [joint.name for joint in robot.moving_joints if joint.name in scenario.initial_positions]
    return assembly_of(replace(robot, joints=joints), stated)


def nothing_moves(robot: Robot) -> Problem:
    """Error for a robot without a moving joint."""
    return Problem("the robot has no moving joint, so there is nothing to simulate", file=robot.path, code="no-joint")


def _released(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Errors in toolbox stepping: modes that the toolbox does not have, such as voltage and current references, and actuators
    with more motors than the actuators of the toolbox.
    """
    for block in robot.actuators if released_order(scenario.stepping) else ():
        mode, motors = MODES[block.mode], ACTUATORS.get(block.actuator).motors
        if motors > RELEASED_MOTORS:
            message = f"'{block.joint}' has {motors} motors; the toolbox moves only {RELEASED_MOTORS}"
            yield Problem(message, key="stepping", value=scenario.stepping, code="released-motors")
        if mode.command != "torque":
            message = f"'{block.joint}' is in mode {mode.number} ({mode.name}), which the toolbox does not have"
            yield Problem(message, key="stepping", value=scenario.stepping, code="released-mode")


def _task(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Errors of the Cartesian task: modes without position references, and poses after the end of the run."""
    if scenario.task is None:
        return
    for block in robot.actuators:
        if block.mode not in PLANNED_MODES:
            message = f"a Cartesian task needs position references, which mode {block.mode} does not take"
            choices = tuple(map(str, PLANNED_MODES))
            yield Problem(message, key=f"modes.{block.joint}", value=block.mode, choices=choices, code="mode-not-planned")
    for index, pose in enumerate(scenario.task.poses):
        # Allow for the rounding error of the duration, which is a whole number of steps.
        if pose.time > scenario.duration * (1 + 1e-9):
            yield Problem(
                f"is later than the end of the run at {scenario.duration:g} s",
                key=f"task.poses.{index}.time",
                value=pose.time,
                hint=f"Set the duration to at least {pose.time:g} s, or the pose to an earlier time",
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


def _locked(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    for name in scenario.locked:
        joints = tuple(joint.name for joint in robot.joints)
        if not any(is_locked(joint, [name]) for joint in joints):
            message = "the robot has no such joint"
            yield Problem(message, key="locked", value=name, hint=did_you_mean(name, joints), code="unknown-joint")


def _too_large(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Errors for numbers whose powers would overflow. Other functions check signals and parameters."""
    numbers = {key: value for key, value in scenario.resolved.items() if key in PLAIN_NUMBERS}
    for path, _, node in walk(SCENARIO, node_from_data(numbers)):
        if isinstance(node.value, float | int) and abs(node.value) > LARGEST_NUMBER:
            message = f"is larger than {LARGEST_NUMBER:g}, too large for a robot"
            yield Problem(message, key=".".join(path), value=node.value, code="out-of-range")


def _motor_starts(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Errors for initial values of motors that do not have one value for each motor of the joint. An entry for all joints
    applies only to joints with motors.
    """
    blocks = {block.joint: block for block in robot.actuators}
    tables = {"motor_positions": scenario.initial_motor_positions, "motor_velocities": scenario.initial_motor_velocities}
    for joint in robot.moving_joints:
        block = blocks.get(joint.name)
        if block is None and joint.name in robot.unread:
            continue
        motors = ACTUATORS.get(block.actuator).motors if block else 0
        for name, table in tables.items():
            key = joint.name if joint.name in table or not block else "*"
            values = table.get(key)
            if values is not None and len(values) != motors:
                message = f"has {counted(len(values), 'value')}, but '{joint.name}' has {counted(motors, 'motor')}"
                yield Problem(message, key=f"initial.{key}.{name}", value=list(values), code="initial-motors")


def _floating(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Error for a floating robot whose root (with links fixed to it) has no mass. Engines would fix such a root or assume a
    mass."""
    if scenario.fixed_base or prescribes_motion(scenario.engine) or robot.faults:
        return
    body = merge_fixed(robot).robot.root
    if not (body.mass and body.inertia and any(body.inertia)):
        message = f"a floating robot needs mass and inertia in its root link '{body.name}', or in links fixed to it"
        yield Problem(message, key="base.fixed", value=False, code="massless-base")


def _all_references(block: ActuatorBlock) -> tuple[str, ...]:
    """All references of the block's mode, including those without effect on its actuator."""
    return MODES[block.mode].references_of(ACTUATORS.get(block.actuator).motors)


def _unknown_references(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Errors for references and ranges that do not exist in the mode of the joint, or, under `*`, in the mode of any joint."""
    blocks = {block.joint: block for block in robot.actuators}
    for section, tables in (("references", scenario.references), ("reference_ranges", scenario.reference_ranges)):
        more = ("external_torque",) if section == "reference_ranges" else ()
        for joint, table in tables.items():
            users = list(blocks.values()) if joint == "*" and not robot.unread else [blocks[joint]] if joint in blocks else []
            # A reference may have no effect on an actuator, but a range must have an effect.
            known = {name for block in users for name in (reference_names(block) if more else _all_references(block))}
            choices = (*sorted({name for block in users for name in reference_names(block)}), *more)
            mode = f"mode {users[0].mode} ({MODES[users[0].mode].name})" if len(users) == 1 else "the mode of every joint"
            for name in table if users or (joint == "*" and not robot.unread) else ():
                if name not in known and name not in more:
                    key, message = f"{section}.{joint}.{name}", f"{mode} has no such reference"
                    yield Problem(message, key=key, choices=choices, meant=name, code="unknown-reference")


def _delays(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Errors for delays and rates of sensors and commands that would need too much memory."""
    for section, table in (("commands", scenario.command_imperfections), ("sensors", scenario.sensor_imperfections)):
        for name, imperfections in table.items():
            if imperfections.delay > MOST_DELAY * scenario.step:
                message = f"is longer than {MOST_DELAY} steps of {scenario.step:g} s, the limit"
                yield Problem(
                    message, key=f"imperfections.{section}.{name}.delay", value=imperfections.delay, code="long-delay"
                )
            if (imperfections.rate or 0.0) * scenario.step > MOST_TICKS:
                message = f"has more than {MOST_TICKS} ticks in a step of {scenario.step:g} s, the limit"
                key, hint = f"imperfections.{section}.{name}.rate", "Leave the rate out: values are then continuous"
                yield Problem(message, key=key, value=imperfections.rate, hint=hint, code="fast-rate")


def _long_sigma(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Errors for references of an adjuster (AwAS-II) beyond the end of its lever."""
    for block in robot.actuators:
        name = MODES[block.mode].references[-1]
        signal = scenario.references_of(block.joint).get(name)
        length = block.values().get("lever_length")
        # In toolbox stepping an adjuster has a motor, whose torque is the reference in mode 4.
        torque = len(MODES[block.mode].references) < 2 or (block.mode == 4 and released_order(scenario.stepping))
        if signal is None or length is None or torque or not ACTUATORS.get(block.actuator).adjuster:
            continue
        with suppress(Exception):  # a user's signal may raise any error, which signal_faults reports
            time, sigma = over_run(scenario, signal)
            largest = float(sigma.max())
            if np.isfinite(sigma).all() and largest >= length:
                message = f"sigma of '{block.joint}' reaches the lever length L = {length:g} m at {time[sigma.argmax()]:g} s"
                hint, key = "The stiffness is infinite there: choose a reference below L", reference_key(scenario, block, name)
                yield Problem(message, key=key, value=largest, hint=hint, code="sigma-limit")


CHECKS: tuple[tuple[tuple[str, ...], Callable[[Scenario, Robot], Iterator[Problem]]], ...] = (
    ((), unknown_names),
    ((), _initial),
    (("locked",), _locked),
    ((), _motor_starts),
    ((), _too_large),
    (("base", "engine"), _floating),
    (("step",), _delays),
    (("task", "duration"), _task),
    (("stepping",), _released),
    (("duration", "step"), lambda scenario, _: signal_faults(scenario)),
    ((), _unknown_references),
    (("duration", "step", "stepping"), _long_sigma),
)
"""Pairs (keys that the check depends on, check). A check yields errors of the robot with the scenario's changes."""
