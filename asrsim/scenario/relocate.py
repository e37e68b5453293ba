"""Data of a scenario for a file in another folder: the same scenario with changed paths."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from asrsim.document.kinds import File, walk
from asrsim.document.node import node_from_data
from asrsim.document.reading import DocumentReading
from asrsim.scenario.data import SCENARIO, Scenario


def relocated(scenario: Scenario, folder: Path) -> dict[str, Any]:
    """Copy of a scenario's data for a file in another folder: with changed paths, and without name, variant and claims."""
    root = node_from_data({key: value for key, value in scenario.resolved.items() if key not in ("name", "variant", "expect")})
    reading = DocumentReading(base=scenario.path.parent if scenario.path else Path(), files=scenario.attachments)
    paths: dict[int, object] = {
        id(node): relative_path(reading.locate(str(node.value), folder=kind.folder), folder)
        for _, kind, node in walk(SCENARIO, root)
        if isinstance(kind, File) and node.value is not None
    }
    # Change the paths of robot and packages here, since these files are not among the attachments.
    return {
        **root.plain(paths),
        "robot": robot_key(scenario.robot, folder, scenario.xacro_arguments, scenario.package_paths),
    }


def relative_path(target: Path, folder: Path) -> str:
    """Path of `target` relative to `folder`, with forward slashes; absolute where no relative path exists."""
    try:
        return Path(os.path.relpath(target, folder)).as_posix()
    except ValueError:
        return target.absolute().as_posix()


def robot_key(robot: Path, folder: Path, arguments: Mapping[str, str] | None, packages: Mapping[str, Path] | None) -> Any:
    """Value of the key `robot` of a scenario file in `folder`."""
    file = relative_path(robot, folder)
    if not arguments and not packages:
        return file
    paths = {name: relative_path(path, folder) for name, path in (packages or {}).items()}
    parts = {"arguments": dict(arguments or {}), "packages": paths}
    return {"file": file, **{key: part for key, part in parts.items() if part}}
