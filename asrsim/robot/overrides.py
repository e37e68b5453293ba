"""Modes and parameters that a scenario sets in the place of the file's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import Problem, ScenarioError
from asrsim.robot.blocks import MODE_CHOICES, default_value
from asrsim.robot.model import UNREAD, ActuatorBlock, ParameterValue, Robot
from asrsim.robot.tags import parameter_name, tag_parameters
from asrsim.robot.values import parameter_fault, together_faults


def with_overrides(
    robot: Robot,
    *,
    modes: Mapping[str, int] | None = None,
    parameters: Mapping[str, Mapping[str, float]] | None = None,
) -> Robot:
    """The robot with modes and parameters replaced, per joint or for all joints by `"*"` (a joint's own entry wins).

    Parameters are named by our names or the toolbox's tags; under `"*"` those that an actuator does not have are passed
    over, if some actuator has them. Controller defaults follow a mode that changes to or from 1.
    Raises ScenarioError with every problem: unknown joints, modes, parameters, values out of range or that do not go together.
    """
    changed, problems = overridden(robot, modes or {}, parameters or {})
    problems += block_faults(changed, robot)
    if problems:
        raise ScenarioError(problems)
    return changed


def overridden(
    robot: Robot, modes: Mapping[str, int], parameters: Mapping[str, Mapping[str, float]]
) -> tuple[Robot, list[Problem]]:
    """As :func:`with_overrides`, as far as it goes, and what is wrong with each mode and parameter.

    A parameter that cannot be used becomes `UNREAD`, as one does that is it; whether the values of a block go together is left
    to :func:`block_faults`.
    """
    problems: list[Problem] = []
    joints = tuple(block.joint for block in robot.actuators)
    for section, keys in (("modes", modes), ("parameters", parameters)):
        problems.extend(
            Problem(
                "no actuator is on this joint",
                key=f"{section}.{joint}",
                choices=joints,
                meant=joint,
                code="unknown-joint",
            )
            for joint in keys
            if joint != "*" and joint not in joints and joint not in robot.unread
        )
    problems.extend(
        Problem(
            "there is no such operation mode",
            key=f"modes.{joint}",
            value=mode,
            choices=MODE_CHOICES,
            code="operation-mode",
        )
        for joint, mode in modes.items()
        if mode not in MODES
    )
    everyone = {name for block in robot.actuators for name in _names(block)}
    if not robot.unread:
        common = parameters.get("*", {})
        problems.extend(_unknown(f"parameters.*.{key}", key, everyone) for key in common if key not in everyone)
    blocks = []
    for block in robot.actuators:
        mode = modes.get(block.joint, modes.get("*", block.mode))
        changed = _with_mode(block, mode) if mode in MODES else block
        for scope in ("*", block.joint):
            changed = _with_parameters(changed, scope, parameters.get(scope, {}), problems)
        blocks.append(changed)
    return replace(robot, actuators=tuple(blocks)), problems


def block_faults(robot: Robot, before: Robot) -> list[Problem]:
    """What is wrong with the values of each block together. A fault that the joint's block has `before` too is the file's."""
    earlier = {block.joint: block for block in before.actuators}
    found = []
    for block in robot.actuators:
        if block.joint in robot.unread:
            continue
        old = earlier.get(block.joint)
        for fault in together_faults(block):
            if old is not None and old.actuator == block.actuator and fault in together_faults(old):
                fault = replace(fault, file=robot.path, line=fault.line or old.line, key=old.plugin_name or block.joint)
            found.append(fault)
    return found


def _with_mode(block: ActuatorBlock, mode: int) -> ActuatorBlock:
    if mode == block.mode:
        return block
    values = dict(block.parameters)
    for parameter in ACTUATORS.get(block.actuator).all_parameters():
        old = values[parameter.name]
        if old.origin in ("default", "mode default"):
            number, origin = default_value(parameter, mode)
            values[parameter.name] = replace(old, value=number, origin=origin)
    return replace(block, mode=mode, parameters=values)


def _with_parameters(block: ActuatorBlock, scope: str, given: Mapping[str, float], problems: list[Problem]) -> ActuatorBlock:
    actuator = ACTUATORS.get(block.actuator)
    declared = {parameter.name: parameter for parameter in actuator.all_parameters()}
    values: dict[str, ParameterValue] = dict(block.parameters)
    seen: dict[str, str] = {}
    for key, number in given.items():
        place = f"parameters.{scope}.{key}"
        name = parameter_name(actuator, key)
        if name in seen:
            twice = Problem(
                f"is the same parameter as {seen[name]}", key=place, hint=f"Give {seen[name]}", code="duplicate-parameter"
            )
            if twice not in problems:
                problems.append(twice)
            continue
        if name is None:
            if scope != "*":
                problems.append(_unknown(place, key, _names(block)))
            continue
        seen[name] = key
        fault = None if number is UNREAD else parameter_fault(declared[name], float(number))
        if fault:
            problem = Problem(fault, key=place, value=number, code="out-of-range")
            if problem not in problems:
                problems.append(problem)
            number = UNREAD
        values[name] = replace(values[name], value=float(number), origin="scenario", line=None, text="")
    return replace(block, parameters=values)


def _names(block: ActuatorBlock) -> set[str]:
    return {*block.parameters, *tag_parameters(ACTUATORS.get(block.actuator))}


def _unknown(place: str, key: str, known: set[str]) -> Problem:
    names = tuple(sorted(known))
    return Problem("no such parameter", key=place, meant=key, choices=names, code="unknown-parameter")
