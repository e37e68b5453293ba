"""Write a starter scenario beside its JSON Schema, never over another file unless told to."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from asrsim.errors import OutputError
from asrsim.outfile import check_output, make_folder, write_text
from asrsim.robot import load_robot, with_overrides
from asrsim.scenario.schema import schema_text
from asrsim.scenario.starter import starter_text

SCHEMA_FILE = "asrsim.schema.json"


def write_starter(
    robot: Path,
    out: Path,
    *,
    mode: int | None = None,
    force: bool = False,
    schema: bool = True,
    arguments: Mapping[str, str] | None = None,
    packages: Mapping[str, Path] | None = None,
) -> tuple[Path, ...]:
    """Write a starter scenario for the robot to `out`, and the schema beside it; gives the files written.

    mode: replaces the robot file's modes. arguments, packages: xacro arguments and folders of ROS packages.
    Raises RobotError for a robot that cannot be read, OutputError where a file is in the way or cannot be written.
    """
    loaded = load_robot(robot, xacro_arguments=arguments or {}, package_paths=packages or {})
    if mode is not None:
        loaded = with_overrides(loaded, modes={"*": mode})
    text = starter_text(
        loaded,
        robot_file=relative_path(robot, out.parent),
        schema=SCHEMA_FILE if schema else None,
        mode=mode,
        arguments=arguments,
        packages={name: relative_path(folder, out.parent) for name, folder in (packages or {}).items()},
    )
    beside = out.parent / SCHEMA_FILE
    if schema and is_foreign(beside):
        raise OutputError(f"{beside} is there and is no schema of asrsim; use --no-schema")
    check_output(out, "schema", inputs=[robot], replace=True)
    write_new(out, text, force=force)
    if not schema:
        return (out,)
    write_new(beside, schema_text(), force=True)
    return out, beside


def write_new(path: Path, text: str, *, force: bool) -> None:
    """Write a text file with the folders above it; OutputError if it is there (unless `force`) or cannot be written."""
    if path.exists() and not force:
        raise OutputError(f"{path} is there already; use --force to replace it, or --out for another file")
    make_folder(path.parent)
    write_text(path, text, "schema", replace=force)


def relative_path(target: Path, folder: Path) -> str:
    """`target` as seen from `folder`, with forward slashes; absolute if no way leads there."""
    try:
        return Path(os.path.relpath(target, folder)).as_posix()
    except ValueError:
        return target.absolute().as_posix()


def is_foreign(path: Path) -> bool:
    """Whether a file that is no schema of ours stands there."""
    try:
        return path.exists() and '"asrsim scenario"' not in path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return True
