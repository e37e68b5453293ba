"""Actuators, modes and parameters that a scenario sets on a robot's joints."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.drive import Drive
from asrsim.actuators.electric import missing_constants
from asrsim.errors import Problem, ScenarioError, did_you_mean
from asrsim.robot.model import ActuatorBlock, Joint, Robot
from asrsim.robot.tags import REQUIRED_TAGS
from asrsim.robot.values import block_faults, block_for, overridden


def block_text(joint: str, actuator: str, mode: int) -> str:
    """Plugin block of an actuator with its finite parameters at their defaults, to paste into a URDF.

    Raises InputError if the actuator is unknown.
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
    """Robot with actuators (type, mode) on joints. `"*"` stands for all moving joints; a joint's own entry takes precedence.

    The actuators replace the actuators of the file. Raises ScenarioError with keys that begin with `actuators`.
    `with_overrides` checks later whether parameters and modes fit together.
    """
    changed, problems = mounted(robot, types, parameters)
    if problems:
        raise ScenarioError(problems)
    return changed


def mounted(
    robot: Robot, types: Mapping[str, tuple[str, int]], parameters: Mapping[str, Mapping[str, float]]
) -> tuple[Robot, list[Problem]]:
    """Robot that `with_actuators` returns for the valid entries, and the problems of the invalid entries."""
    if not types:
        return robot, []
    moving = {joint.name: joint for joint in robot.moving_joints}
    names = tuple(moving)
    problems = [_unmoved(robot, name, names) for name in types if name != "*" and name not in moving]
    problems += [
        replace(ACTUATORS.unknown(kind), key=f"actuators.{name}") for name, (kind, _) in types.items() if kind not in ACTUATORS
    ]
    present = {block.joint: block for block in robot.actuators}
    unread = set(robot.unread)
    blocks = []
    for name in names:
        # The drive of a joint also moves the joints that follow it, so a follower gets an actuator only by an entry with its
        # name.
        entry = types.get(name, None if name in robot.followers else types.get("*"))
        if entry is not None and entry[0] in ACTUATORS:
            blocks.append(block_for(name, *entry, namespace=present[name].namespace if name in present else ""))
            unread.discard(name)
        elif entry is not None:
            unread.add(name)
        elif name in present:
            blocks.append(present[name])
    known = {joint: values for joint, values in parameters.items() if joint == "*" or joint in moving}
    changed, faults = overridden(replace(robot, actuators=tuple(blocks), unread=frozenset(unread)), {}, known)
    problems += [replace(fault, key=_key(fault.key or "")) for fault in faults]
    return changed, problems


def _unmoved(robot: Robot, name: str, moving: tuple[str, ...]) -> Problem:
    """Error about an actuator on a joint that does not move or exist; a warning about the file may state why it does not
    move.
    """
    hint = did_you_mean(name, moving) or 'For all joints write "*"'
    message = "the robot has no such moving joint"
    if name in {joint.name for joint in robot.joints}:
        told = next((one for one in robot.findings if one.key == name), None)
        message, hint = (
            "this joint does not move" + (f": {told.message}" if told else ""),
            (told.hint if told else None) or hint,
        )
    return Problem(message, key=f"actuators.{name}", choices=moving, hint=hint, code="unknown-joint")


def _key(key: str) -> str:
    """Key in the scenario: `parameters.JOINT.NAME` becomes `actuators.JOINT.parameters.NAME`."""
    joint, _, name = key.removeprefix("parameters.").rpartition(".")
    return f"actuators.{joint or name}.parameters" + (f".{name}" if joint else "")


def equipped(
    robot: Robot,
    types: Mapping[str, tuple[str, int]],
    own: Mapping[str, Mapping[str, float]],
    *,
    modes: Mapping[str, int],
    parameters: Mapping[str, Mapping[str, float]],
    armature: Mapping[str, float],
    unread: Collection[str] = (),
) -> tuple[Robot, list[Problem]]:
    """Robot with all valid changes of a scenario to its drives, and the problems of the other changes.

    Args:
        robot: Robot of the file.
        types: Actuators (type, mode) by joint, as in `with_actuators`.
        own: Parameters of these actuators.
        modes: Modes by joint, as in `with_overrides`.
        parameters: Parameters by joint, as in `with_overrides`.
        armature: Rotor inertias by joint, as in `with_rotors`.
        unread: Joints whose actuator, mode or parameters are invalid in the scenario.
    """
    changed, problems = mounted(robot, types, own)
    changed, faults = overridden(replace(changed, unread=changed.unread.union(unread)), modes, parameters)
    problems += faults
    stated = {"modes": modes, "parameters": parameters}
    for fault in block_faults(changed, robot):
        section, _, joint = (fault.key or "").partition(".")
        table = stated.get(section, {})
        set_there = fault.file is not None or joint in table or "*" in table
        problems.append(fault if set_there else replace(fault, key=f"actuators.{joint}"))
    return with_rotors(changed, armature), problems


def sprung_joints(robot: Robot) -> frozenset[str]:
    """Joints behind the spring of an actuator, whose motors have separate inertias."""
    return frozenset(block.joint for block in robot.actuators if MODES[block.mode].spring)


def with_rotors(robot: Robot, armature: Mapping[str, float]) -> Robot:
    """Robot with the rotor inertias that move with the links. They are the rotor inertias of the file, except behind a spring,
    where the motors of the actuator have separate inertias. armature: inertias in kg m^2 (kg) that replace the inertias of the
    file, by joint; `"*"` stands for all joints.
    """
    sprung = sprung_joints(robot)
    common = armature.get("*")

    def inertia(joint: Joint) -> float:
        given = armature.get(joint.name, common)
        return given if given is not None else 0.0 if joint.name in sprung else joint.rotor_inertia

    moved = {joint.name: inertia(joint) for joint in robot.moving_joints}
    if all(joint.armature == moved.get(joint.name, 0.0) for joint in robot.joints):
        return robot
    return replace(robot, joints=tuple(_with_armature(joint, moved.get(joint.name, 0.0)) for joint in robot.joints))


def _with_armature(joint: Joint, armature: float) -> Joint:
    return joint if joint.armature == armature else replace(joint, armature=armature)


def drive_of(block: ActuatorBlock) -> Drive:
    """Drive of an actuator block with the block's parameters."""
    return Drive(joint=block.joint, actuator=ACTUATORS.get(block.actuator), mode=MODES[block.mode], values=block.values())


def reference_names(block: ActuatorBlock) -> tuple[str, ...]:
    """Names of the references of a block; an actuator with one motor and no adjuster has no second reference."""
    actuator = ACTUATORS.get(block.actuator)
    names = MODES[block.mode].references_of(actuator.motors)
    return names if actuator.motors > 1 or actuator.adjuster else names[:1]
