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
    plugin: Annotated[list[Path] | None, typer.Option(help="Python file with your own actuators; may be repeated.")] = None,
    argument: Annotated[
        list[str] | None, typer.Option("--arg", metavar="NAME=VALUE", help="A xacro argument; may be repeated.")
    ] = None,
    package: Annotated[
        list[str] | None, typer.Option(metavar="NAME=FOLDER", help="Where a ROS package is; may be repeated.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing.")] = False,
) -> None:
    """Write a commented starter scenario for a robot.

    Example: asrsim init arm.urdf --mode 6 --out step.yaml
    """
    # `--experiment lab.csv` (a scenario from a recording) belongs here; it branches off before write_starter.
    from asrsim.actuators.user import load_plugin_file
    from asrsim.cli.check import _pairs
    from asrsim.scenario.start_file import write_starter

    for path in plugin or []:
        load_plugin_file(path)
    packages = {name: Path(folder) for name, folder in _pairs(package, "--package").items()}
    written = write_starter(
        robot, out, mode=mode, force=force, schema=schema, arguments=_pairs(argument, "--arg"), packages=packages
    )
    if not quiet:
        typer.echo(f"Wrote {', '.join(map(str, written))}. Run it: asrsim run {out}")
