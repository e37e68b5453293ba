"""Robot with other values of its parameters: parameters of actuators, damping and friction of joints, and inertias of links."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

from asrsim.actuators import ACTUATORS, Parameter
from asrsim.actuators.stages import STAGES
from asrsim.errors import Problem, RobotError
from asrsim.robot.inertia import principal_moments
from asrsim.robot.model import INERTIAS, ActuatorBlock, Joint, Link, ParameterValue, Robot
from asrsim.robot.values import parameter_fault, together_faults

JOINT_NAMES = {
    "damping": "damping",
    "friction": "friction",
    "stribeck_friction": "stribeck_friction",
    "stribeck_velocity": "stribeck_velocity",
    "load_friction": "load_friction",
    "passive_stiffness": "spring_stiffness",
    "passive_reference": "spring_reference",
    "armature": "armature",
}
"""Fields of a joint by name of the number; `passive_` marks the passive spring (Gazebo's)."""
CENTRES = ("x", "y", "z")
LINK_NAMES = ("mass", *CENTRES, *INERTIAS)
_INERTIAS = frozenset(INERTIAS)


def varied_robot(robot: Robot, parameters: Mapping[str, Mapping[str, float]]) -> Robot:
    """Robot with other values: joint or link -> name -> value. `physical` adapts the inertias.

    Raises RobotError with all unknown names and values that are not physical.
    """
    parameters = physical(robot, parameters)
    problems: list[Problem] = []
    blocks = {block.joint: block for block in robot.actuators}
    joints = {joint.name: joint for joint in robot.joints}
    links = {link.name: link for link in robot.links}
    for owner, values in parameters.items():
        if owner not in joints and owner not in links:
            known = (*joints, *links)
            problems.append(
                Problem("no joint or link has this name", key=owner, meant=owner, choices=known, code="unknown-joint")
            )
            continue
        of_joint: dict[str, Any] = {}
        of_block, of_link = dict[str, ParameterValue](), dict[str, float]()
        for name, value in values.items():
            fault: str | None = None
            if value != value:
                fault = "must be a number"
            elif owner in joints and name in JOINT_NAMES:
                of_joint[JOINT_NAMES[name]] = float(value)
                if value < 0.0 and name != "passive_reference":
                    fault = "must be at least 0"
                elif value == 0.0 and name == "stribeck_velocity":
                    fault = "must be larger than 0"
            elif owner in blocks and name in blocks[owner].parameters:
                of_block[name] = replace(blocks[owner].parameters[name], value=float(value), origin="scenario")
                actuator: Any = ACTUATORS.get(blocks[owner].actuator)
                fault = parameter_fault(_declared(actuator, STAGES.loaded())[name], value)
            elif owner in links and name in LINK_NAMES:
                of_link[name] = float(value)
                if value < 0.0 and name in ("mass", "ixx", "iyy", "izz"):
                    fault = "must be at least 0"
            else:
                known = names_of(owner, blocks, joints, links)
                message, key = "no parameter has this name", f"{owner}.{name}"
                problems.append(Problem(message, key=key, meant=name, choices=known, code="unknown-parameter"))
            if fault:
                problems.append(Problem(fault, key=f"{owner}.{name}", value=f"{value:g}", code="parameter-range"))
        # Copy each joint or link only once, since every evaluation of a fit calls this function.
        if of_joint:
            joints[owner] = replace(joints[owner], **of_joint)
        if of_block:
            blocks[owner] = replace(blocks[owner], parameters={**blocks[owner].parameters, **of_block})
        if of_link:
            links[owner] = _with_inertial(links[owner], of_link)
    if not problems:
        changed_blocks = (blocks[block.joint] for block in robot.actuators if blocks[block.joint] is not block)
        problems += (fault for block in changed_blocks for fault in together_faults(block))
    if problems:
        raise RobotError(problems)
    return replace(
        robot,
        joints=tuple(joints[joint.name] for joint in robot.joints),
        links=tuple(links[link.name] for link in robot.links),
        actuators=tuple(blocks[block.joint] for block in robot.actuators),
    )


def names_of(
    owner: str, blocks: Mapping[str, ActuatorBlock], joints: Mapping[str, Joint], links: Mapping[str, Link]
) -> tuple[str, ...]:
    """Names of the parameters of a joint or link that can be varied."""
    names: tuple[str, ...] = ()
    if owner in joints:
        names += (*(blocks[owner].parameters if owner in blocks else ()), *JOINT_NAMES)
    if owner in links:
        names += LINK_NAMES
    return names


@lru_cache
def _declared(actuator: Any, stages: tuple[Any, ...]) -> dict[str, Parameter]:
    """Parameters of the actuator by name; cached, since each evaluation of a fit needs them. stages: all stages, whose
    parameters are among them.
    """
    return {parameter.name: parameter for parameter in actuator.all_parameters()}


def _with_inertial(link: Link, numbers: Mapping[str, float]) -> Link:
    """The link with other values of mass, centre and inertia, by the names in `LINK_NAMES`; a missing inertia counts as 0."""
    x, y, z = (numbers.get(name, old) for name, old in zip(CENTRES, link.centre_of_mass, strict=True))
    inertia = link.inertia
    if not _INERTIAS.isdisjoint(numbers):
        moments = [numbers.get(name, old) for name, old in zip(INERTIAS, inertia or (0.0,) * 6, strict=True)]
        inertia = (moments[0], moments[1], moments[2], moments[3], moments[4], moments[5])
    return replace(link, mass=numbers.get("mass", link.mass), centre_of_mass=(x, y, z), inertia=inertia)


def physical(robot: Robot, changes: Mapping[str, Mapping[str, float]]) -> Mapping[str, Mapping[str, float]]:
    """Changes of inertias, completed by changes that keep the tensor physical. No principal moment may exceed the sum of the
    other two.

    Diagonal moments that are not among the changes are adapted as little as possible. Raises RobotError if this is impossible.
    """
    # Return early if no inertia changes. Every evaluation of a fit and every run of a sweep calls this function, but few of
    # them change an inertia.
    touched = [owner for owner, values in changes.items() if not _INERTIAS.isdisjoint(values)]
    if not touched:
        return changes
    links = {link.name: link for link in robot.links}
    result = {owner: dict(values) for owner, values in changes.items()}
    for owner in touched:
        if owner not in links:
            continue
        values = result[owner]
        old = dict(zip(INERTIAS, links[owner].inertia or (0.0,) * 6, strict=True))
        free = [name for name in ("ixx", "iyy", "izz") if name not in values]
        for _ in range(3):
            full = {**old, **values}
            moments = principal_moments([full[name] for name in INERTIAS])
            lack = max(moments[2] - moments[0] - moments[1], -2.0 * moments[0])
            if lack <= 1e-12 * abs(moments[2]):
                break
            if not free:
                raise RobotError(f"the inertia of '{owner}' is physically impossible", code="inertia")
            for name in free:
                values[name] = full[name] + lack / len(free) * (1.0 + 1e-9)
    return result
