"""Completes the description of a run, so that the log of the run suffices to repeat it bit for bit.

After a scenario and a robot have been read, the program may change them, for example by planned references or other masses.
They then differ from their files. These differences are written into the description.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from asrsim.document.block import declared_keys
from asrsim.outfile import csv_text
from asrsim.plain import mapped
from asrsim.robot import Robot, load_robot
from asrsim.runs.folder import origin_of
from asrsim.samples import RunInfo
from asrsim.scenario.data import Scenario
from asrsim.signals.base import Signal
from asrsim.signals.sampled import Sampled

UNREPEATABLE = "unrepeatable"
"""Metadata key under which a log stores the names of changes that neither a scenario nor a robot file can express."""
LIVE = "live"
"""Metadata key that marks the log of a live run, which contains the commands from outside."""
_NOT_OF_THE_RUN = {
    "name", "robot", "path", "text", "variant", "xacro_arguments", "package_paths", "expect", "learning", "attachments",
    "resolved", "as_read", "lines", "joint_order", "namespace", "desired",
}  # fmt: skip


_OTHER_FORM = ("log_every", "world")
"""Fields of a scenario whose values have another form than the values of their keys in a scenario file."""


def as_run(info: RunInfo, scenario: Scenario, robot: Robot | None = None) -> RunInfo:
    """Description of a run that contains all changes of the scenario and of the robot's actuators since they were read.

    References that were computed in Python are stored as a table, which the described scenario plays back. Other changes of the
    scenario are written under the keys to which they belong. A run whose robot has changes that cannot be described is marked
    as unrepeatable. The scenario's path becomes absolute, so that runs of different projects can be distinguished.

    Args:
        info: Description without the changes.
        scenario: Scenario of the run.
        robot: Robot of the run; None: the robot that the scenario names.
    """
    files: dict[str, bytes] = {}
    resolved = dict(scenario.resolved)
    lost: list[str] = []
    if scenario.as_read is not None:
        for name in (field.name for field in fields(Scenario) if field.name not in _NOT_OF_THE_RUN):
            value = getattr(scenario, name)
            if value != getattr(scenario.as_read, name):
                try:
                    _named(resolved, name, value, files)
                except TypeError:
                    lost.append(name)
        if not scenario.expect:
            resolved.pop("expect", None)
    if robot is not None:
        read = _robot_as_read(robot)
        if (robot.joints, robot.links) != (read.joints, read.links):
            lost.append("the robot's joints and links")
        for block, before in zip(robot.actuators, read.actuators, strict=True):
            if (block.mode, block.values()) != (before.mode, before.values()):
                joint, parameters = block.joint, resolved.get("parameters", {})
                resolved["modes"] = {joint: block.mode, **_by_joint(resolved.get("modes", {}))}
                own = {**block.values(), **parameters.get("*", {}), **parameters.get(joint, {})}
                resolved["parameters"] = {**parameters, joint: own}
    metadata = {**info.metadata, UNREPEATABLE: ", ".join(lost)} if lost else info.metadata
    return replace(
        info,
        resolved={**info.resolved, "scenario": resolved},
        attachments={**info.attachments, **files},
        scenario_path=origin_of(scenario),
        metadata=metadata,
    )


def _robot_as_read(robot: Robot) -> Robot:
    """Robot as its URDF text states it, without later changes."""
    with TemporaryDirectory(prefix="asrsim-") as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(robot.text, encoding="utf-8")
        return load_robot(path, locked=robot.locked)


def _value(value: Any, files: dict[str, bytes]) -> Any:
    """Value of a scenario's field as plain data for a scenario file. files: receives the content of files to which the data
    refer, by name. Raises TypeError for a value that scenario files cannot contain.
    """
    return mapped(value, lambda leaf: _leaf(leaf, files))


def _leaf(value: Any, files: dict[str, bytes]) -> Any:
    if isinstance(value, Sampled):
        name = f"computed_{len(files) + 1}.csv"
        files[name] = csv_text(("time", "value"), np.column_stack([value.times, value.samples])).encode()
        return {"playback": {"file": name, "column": "value"}}
    if is_dataclass(value) and (keys := declared_keys(type(value))):
        names = {field.name for field in fields(value) if field.init}
        items = {key.name: _value(getattr(value, key.argument), files) for key in keys if key.argument in names}
        items = {name: item for name, item in items.items() if item is not None}
        return {value.kind: items} if isinstance(value, Signal) else items
    if isinstance(value, Path):
        files[value.name] = value.read_bytes()
        return value.name
    if isinstance(value, np.ndarray):
        return value.tolist()
    if value is None or isinstance(value, str | int | float):
        return value
    raise TypeError(f"a document cannot contain {type(value).__name__}")


def _by_joint(modes: Any) -> dict[str, int]:
    return dict(modes) if isinstance(modes, Mapping) else {"*": modes}


def _named(resolved: dict[str, Any], name: str, value: Any, files: dict[str, bytes]) -> None:
    """Write the value of a scenario's field into `resolved` under the field's key, inside the key's group if it has one.

    Raises TypeError for a field without a key of its own, and for a value that scenario files cannot contain.
    """
    metadata = next(field.metadata for field in fields(Scenario) if field.name == name)
    if "key" not in metadata or metadata["key"].spread or name in _OTHER_FORM:
        raise TypeError(f"no key of a document sets {name} alone")
    group, dot, key = (metadata["key"].name or name).partition(".")
    if dot:
        whole = resolved.get(group, {})
        resolved[group] = {**(whole if isinstance(whole, Mapping) else {"file": whole}), key: _value(value, files)}
    else:
        resolved[group] = _value(value, files)
