"""Checks names of joints and links in a scenario, and finds entries for all joints (`*`) without effect."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from asrsim.errors import Problem
from asrsim.robot import Robot
from asrsim.robot.mounting import reference_names
from asrsim.scenario.data import Scenario

MOVING = ("initial", "armature", "external_torques", "desired", "motion", "reference_ranges", "expect")
"""Keys whose entries may name any moving joint; entries of other keys name joints with an actuator."""
CHECKED_WITH_VALUES = ("actuators", "modes", "parameters")
"""Keys whose joints are checked when the scenario is applied to the robot."""
TABLES = {
    "initial_positions": "initial",
    "initial_velocities": "initial",
    "initial_motor_positions": "initial",
    "initial_motor_velocities": "initial",
    "external_torques": "external_torques",
    "desired": "desired",
    "motion": "motion",
    "references": "references",
    "armature": "armature",
    "reference_ranges": "reference_ranges",
    "link_damping": "link_damping",
}
"""Fields of the scenario that code may set, with their keys in a file; their names are checked even without a file."""
BY_NAME = ("references", "parameters")
"""Tables in which the entry for all joints supplies values that the entry of a joint lacks."""


def unknown_names(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Errors for joints and links that the robot lacks, and for joints without a required actuator."""
    moving = tuple(joint.name for joint in robot.moving_joints)
    actuated = (*(block.joint for block in robot.actuators), *sorted(robot.unread))
    links = tuple(link.name for link in robot.links)
    # Only keys of mappings have lines, so report entries of lists at their list.
    found = [
        (path[:-1] if path[-1].isdecimal() and path[-1] != name else path, name, noun)
        for path, name, noun in scenario.named
        if noun in ("joint", "link")
    ]
    found += ((("manager",), name, "joint") for name in scenario.joint_order)
    for field, key in TABLES.items():
        found += (((key, name), name, "joint") for name in getattr(scenario, field))
    for path, name, noun in dict.fromkeys(found):
        all_moving = path[0] in (*MOVING, "manager")
        known = links if noun == "link" else moving if all_moving else actuated
        if path[0] not in CHECKED_WITH_VALUES and name != "*" and name not in known:
            kind = "" if noun == "link" else "moving " if all_moving else "actuated "
            message = f"the robot has no {kind}{noun} '{name}'"
            yield Problem(message, key=".".join(path), choices=known, meant=name, code=f"unknown-{noun}")


def shadowed(parts: Sequence[str], scenario: Scenario, robot: Robot) -> bool:
    """Whether a path of keys contains an entry for all joints that has no effect, because every joint has a separate entry.

    robot: Robot with the scenario's modes.
    """
    if "*" not in parts:
        return False
    place = parts.index("*")
    entries = _table(scenario, parts[:place])
    joints = [block.joint for block in robot.actuators]
    if parts[0] in MOVING:
        joints = [joint.name for joint in robot.moving_joints]
    if parts[0] not in BY_NAME:
        return bool(joints) and all(joint in entries for joint in joints)
    name = parts[place + 1]
    users = [
        block.joint
        for block in robot.actuators
        if name in (reference_names(block) if parts[0] == "references" else block.values())
    ]
    return bool(joints) and all(name in entries.get(joint, {}) for joint in users or joints)


def shadowed_entries(scenario: Scenario, robot: Robot) -> Iterator[str]:
    """Keys of the entries for all joints without effect."""
    for path, name, noun in scenario.named:
        if name == "*" and noun == "joint" and path[0] not in ("actuators", "expect", "ilc", "task"):
            inner = [(*path, name) for name in _table(scenario, path)] if path[0] in BY_NAME else [path]
            yield from (".".join(one) for one in inner if shadowed(one, scenario, robot))


def _table(scenario: Scenario, path: Sequence[str]) -> Mapping[str, Any]:
    entries: Any = scenario.resolved
    for part in path:
        entries = entries.get(part, {}) if isinstance(entries, Mapping) else {}
    return entries if isinstance(entries, Mapping) else {}
