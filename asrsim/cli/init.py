"""`asrsim init`: a starter scenario for a robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def init(
    robot: Annotated[Path, typer.Argument(help="URDF or xacro file of the robot.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The scenario file to write.")] = Path("scenario.yaml"),
    mode: Annotated[
        int | None, typer.Option("--mode", min=0, max=6, help="Operation mode of all joints instead of the robot file's.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", "-f", help="Replace the file if it is there.")] = False,
    schema: Annotated[bool, typer.Option(help="Also write the JSON Schema beside it, so that editors complete keys.")] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing.")] = False,
) -> None:
    """Write a commented starter scenario for a robot.

    Example: asrsim init arm.urdf --mode 6 --out step.yaml
    """
    # `--experiment lab.csv` (a scenario from a recording) belongs here; it branches off before write_starter.
    from asrsim.scenario.start_file import write_starter

    written = write_starter(robot, out, mode=mode, force=force, schema=schema)
    if not quiet:
        typer.echo(f"Wrote {', '.join(map(str, written))}. Run it: asrsim run {out}")
