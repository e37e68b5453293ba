"""`asrsim examples`: copies the bundled robots, scenarios, recordings and plugin, which every command can use."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from asrsim.cli.options import Json, into_folder


def examples(
    out: Annotated[Path, into_folder("Folder for the copies.")] = Path("examples"),
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace existing files with these names.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing.")] = False,
    json: Json = False,
) -> None:
    """Copy the bundled examples: robots, scenarios, recordings, and a custom actuator.

    Example: asrsim examples
    """
    from asrsim.actuators.user import command_line
    from asrsim.cli.console import json_errors, say, say_json

    with json_errors(json):
        from asrsim.runs.examples import copy_examples

        written = copy_examples(out, overwrite=overwrite)
    if json:
        say_json({"ok": True, "files": [str(path) for path in written]})
    elif not quiet:
        run = command_line("run", out / "scenarios" / "step_2dof.yaml")
        say(f"wrote {len(written)} files into {out}; run one: {run}")
