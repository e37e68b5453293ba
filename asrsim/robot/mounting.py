"""Actuators put on joints without plugin blocks: a plain URDF becomes a soft robot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.drive import Drive
from asrsim.actuators.electric import missing_constants
from asrsim.errors import Problem, RobotError, ScenarioError, did_you_mean
from asrsim.robot.advice import advise
from asrsim.robot.blocks import default_parameter
from asrsim.robot.findings import Findings
from asrsim.robot.model import ActuatorBlock, Robot
from asrsim.robot.overrides import overridden
from asrsim.robot.tags import REQUIRED_TAGS, parameter_tags


def block_for(joint: str, actuator: str, mode: int, namespace: str = "") -> ActuatorBlock:
    """The block of an actuator with nothing but defaults. Raises InputError where the actuator is unknown."""
    cls = ACTUATORS.get(actuator)
    tags = parameter_tags(cls)
    parameters = {one.name: default_parameter(one, mode, tags[one.name]) for one in cls.all_parameters()}
    return ActuatorBlock(actuator=actuator, joint=joint, mode=mode, namespace=namespace, parameters=parameters)


def block_text(joint: str, actuator: str, mode: int) -> str:
    """The plugin block of an actuator with all its finite parameters at their defaults, to paste into a URDF.

    Raises InputError where the actuator is unknown.
    """
    from xml.sax.saxutils import escape, quoteattr

    block = block_for(joint, actuator, mode)
    declared = ACTUATORS.get(actuator).all_parameters()
    docs = {parameter.name: parameter.doc for parameter in declared}
    needed = missing_constants(block.values(), ACTUATORS.get(actuator).motors, MODES[mode])
    left_out = {parameter.name for parameter in declared if parameter.optional}.difference(needed)
    given = [("joint", escape(joint)), ("operation_mode", str(mode)), *((tag, "true") for tag in REQUIRED_TAGS[2:])]
    lines = ["<gazebo>", f'  <plugin name={quoteattr(f"{joint}_{actuator}")} filename="lib{actuator}_plugin.so">']
    lines += [f"    <{tag}>{text}</{tag}>" for tag, text in given]
    lines += [
        f"    <{one.tag}>{one.value:g}</{one.tag}>  <!-- {one.unit}: {escape(docs[one.name])} -->"
        for one in block.parameters.values()
        if math.isfinite(one.value) and one.name not in left_out
    ]
    return "\n".join([*lines, "  </plugin>", "</gazebo>"])


def with_actuators(robot: Robot, types: Mapping[str, tuple[str, int]], parameters: Mapping[str, Mapping[str, float]]) -> Robot:
    """The robot with actuators (type, mode) on joints, or on all moving ones by `"*"` (a joint's own entry wins).

    They take the place of the file's; the blocks' warnings join the robot's. Raises ScenarioError, whose keys begin with
    `actuators`. Whether parameters and modes go together is checked by :func:`with_overrides`.
    """
    changed, problems = mounted(robot, types, parameters)
    if problems:
        raise ScenarioError(problems)
    return changed


def mounted(
    robot: Robot, types: Mapping[str, tuple[str, int]], parameters: Mapping[str, Mapping[str, float]]
) -> tuple[Robot, list[Problem]]:
    """As :func:`with_actuators`, as far as it goes, and what is wrong."""
    if not types:
        return robot, []
    moving = {joint.name: joint for joint in robot.moving_joints}
    names = tuple(moving)
    problems = [
        Problem(
            "the robot has no such moving joint", key=f"actuators.{name}", choices=names,
            hint=did_you_mean(name, names) or "For all joints write \"*\"", code="unknown-joint",
        )
        for name in types
        if name != "*" and name not in moving
    ]  # fmt: skip
    kinds = ACTUATORS.names()
    problems += [
        Problem(
            "there is no such actuator", key=f"actuators.{name}", value=kind, choices=kinds,
            meant=kind, code="unknown-actuator",
        )
        for name, (kind, _) in types.items()
        if kind not in kinds
    ]  # fmt: skip
    present = {block.joint: block for block in robot.actuators}
    unread = set(robot.unread)
    blocks = []
    for name in names:
        entry = types.get(name, types.get("*"))
        if entry is not None and entry[0] in kinds:
            blocks.append(block_for(name, *entry, namespace=present[name].namespace if name in present else ""))
            unread.discard(name)
        elif entry is not None:
            unread.add(name)
        elif name in present:
            blocks.append(present[name])
    known = {joint: values for joint, values in parameters.items() if joint == "*" or joint in moving}
    changed, faults = overridden(replace(robot, actuators=tuple(blocks), unread=frozenset(unread)), {}, known)
    problems += [replace(fault, key=_key(fault.key or "")) for fault in faults]
    findings = Findings(robot.path)
    driven = {block.joint for block in blocks}
    known_warnings = [
        problem
        for problem in robot.warnings
        if not (problem.code == "no-actuators" and driven) and not (problem.code == "mimic-joint" and problem.key in driven)
    ]
    for block in changed.actuators:
        if present.get(block.joint) != block:
            advise(ACTUATORS.get(block.actuator), block, moving[block.joint], findings)
    return replace(changed, warnings=(*known_warnings, *findings.warnings)), problems


def _key(key: str) -> str:
    """`parameters.JOINT.NAME` as the scenario has it: `actuators.JOINT.parameters.NAME`."""
    joint, _, name = key.removeprefix("parameters.").rpartition(".")
    return f"actuators.{joint or name}.parameters" + (f".{name}" if joint else "")


def drive_of(block: ActuatorBlock) -> Drive:
    """The drive of an actuator block, with the parameters that it resolved."""
    return Drive(joint=block.joint, actuator=ACTUATORS.get(block.actuator), mode=MODES[block.mode], values=block.values())


def check_two_motors(robot: Robot, what: str) -> None:
    """Raise RobotError for actuators with more motors than two, which `what` does not take."""
    problems = [
        Problem(f"{what} takes actuators of one or two motors; {block.actuator} has {ACTUATORS.get(block.actuator).motors}",
                file=robot.path, key=block.joint, code="motors")
        for block in robot.actuators if ACTUATORS.get(block.actuator).motors > 2
    ]  # fmt: skip
    if problems:
        raise RobotError(problems)


def reference_names(block: ActuatorBlock) -> tuple[str, ...]:
    """References that count for this actuator: one with one motor and no adjuster has no second."""
    actuator = ACTUATORS.get(block.actuator)
    names = MODES[block.mode].references_of(actuator.motors)
    return names if actuator.motors > 1 or actuator.adjuster else names[:1]
