"""Hashes of all inputs of a result. The hashes must be unchanged when a result is continued or repeated."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from asrsim.actuators import ACTUATORS
from asrsim.actuators.declaration import file_of
from asrsim.errors import InputError
from asrsim.robot.model import Robot
from asrsim.robot.packages import packages_of
from asrsim.scenario.data import Scenario


def input_hashes(
    scenario: Scenario, robot: Robot, *, plugins: Collection[Path] = (), without: Mapping[str, Collection[str]] | None = None
) -> dict[str, str]:
    """Hash of each input of the runs of a scenario, by a name for messages: the scenario; the robot's text, in which xacro is
    expanded; meshes of collisions; files of signals and other files that the scenario names; files of actuators and plugins.

    robot: the robot, with or without the scenario's changes. plugins: further Python files. without: keys that do not
    matter, by the key of their block. Raises InputError if a file cannot be read.
    """
    resolved: dict[str, Any] = dict(scenario.resolved)
    for block, keys in (without or {}).items():
        resolved[block] = {key: value for key, value in (resolved.get(block) or {}).items() if key not in keys}
    hashes = {
        "the scenario": _hashed(json.dumps(resolved, sort_keys=True, default=str).encode()),
        robot.path.name: _hashed(robot.text.encode()),
    }
    names = {*(block.actuator for block in robot.actuators), *(given.type for given in scenario.actuators.values())}
    laws = (file_of(ACTUATORS.get(name)) for name in sorted(names) if name in ACTUATORS)
    files = {**scenario.attachments, **{path.name: path for path in (*filter(None, laws), *plugins)}}
    return hashes | mesh_hashes(scenario, robot) | {name: digest_of(path) for name, path in files.items()}


def mesh_hashes(scenario: Scenario, robot: Robot) -> dict[str, str]:
    """Hash of each mesh of the robot's collisions, by its name in the robot's file; empty for a mesh that is not found."""
    packages = packages_of(robot.path, scenario.package_paths)
    names = {shape.mesh for link in robot.links for shape in link.collisions if shape.mesh}
    found = {name: packages.resolve(name) for name in sorted(names)}
    return {name: digest_of(path) if isinstance(path, Path) else "" for name, path in found.items()}


def digest_of(path: Path) -> str:
    """Hash of a file, or of all files in a folder. Raises InputError if a file cannot be read."""
    files = sorted(item for item in path.rglob("*") if item.is_file()) if path.is_dir() else [path]
    try:
        return _hashed(b"".join(hashlib.sha256(file.read_bytes()).digest() for file in files))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path, code="no-file") from None


def _hashed(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
