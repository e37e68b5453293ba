"""Entries for all joints (`*`) without effect, since every joint has an entry of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from asrsim.robot.model import Robot
from asrsim.robot.mounting import reference_names
from asrsim.scenario.data import Scenario

OF_ALL_THAT_MOVE = ("initial", "external_torques", "desired", "motion")
"""Tables of all moving joints; others are of driven ones."""
BY_NAME = ("references", "parameters")
"""Tables in which what an own entry does not say is that for all."""
TABLES = (
    ("initial",), ("external_torques",), ("link_damping",), ("effects", "commands"), ("effects", "sensors"), ("modes",),
    ("desired",), ("motion",),
)  # fmt: skip
"""Further tables in which such an entry gets a warning."""


def shadowed(parts: Sequence[str], scenario: Scenario, robot: Robot) -> bool:
    """Whether a path of keys leads through an entry for all joints that is without effect. robot: with the scenario's modes."""
    if "*" not in parts:
        return False
    place = parts.index("*")
    entries = _table(scenario, parts[:place])
    joints = [block.joint for block in robot.actuators]
    if parts[0] in OF_ALL_THAT_MOVE:
        joints = [joint.name for joint in robot.moving_joints]
    if parts[0] not in BY_NAME:
        return bool(joints) and all(joint in entries for joint in joints)
    name = parts[place + 1]
    users = [
        block.joint for block in robot.actuators
        if name in (reference_names(block) if parts[0] == "references" else block.values())
    ]  # fmt: skip
    return bool(joints) and all(name in entries.get(joint, {}) for joint in users or joints)


def shadowed_entries(scenario: Scenario, robot: Robot) -> Iterator[str]:
    """Keys of such entries in the scenario."""
    paths = [(*table, "*") for table in TABLES if "*" in _table(scenario, table)]
    paths += [(table, "*", name) for table in BY_NAME for name in _table(scenario, (table,)).get("*", {})]
    return (".".join(path) for path in paths if shadowed(path, scenario, robot))


def _table(scenario: Scenario, path: Sequence[str]) -> Mapping[str, Any]:
    entries: Any = scenario.resolved
    for part in path:
        entries = entries.get(part, {}) if isinstance(entries, Mapping) else {}
    return entries if isinstance(entries, Mapping) else {}
