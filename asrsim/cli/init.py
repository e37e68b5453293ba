"""`asrsim init`: writes a starter scenario for a robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asrsim.cli.completion import mountings
from asrsim.cli.options import Arguments, ColumnMap, Packages, Plugins, Rate, folders, into_file, load_plugins, pairs

if TYPE_CHECKING:
    from asrsim.runs.from_recording import Written


def init(
    robot: Annotated[
        Path | None, typer.Argument(metavar="[ROBOT]", help="URDF or xacro file of the robot.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None, into_file("The file to write.", ".yaml", ".yml", default="scenario.yaml; of a recording alone FILE.yaml")
    ] = None,
    mode: Annotated[
        int | None, typer.Option("--mode", min=0, max=8, help="Operation mode of all joints instead of the robot file's.")
    ] = None,
    actuator: Annotated[
        list[str] | None,
        typer.Option(
            "--actuator",
            "-a",
            metavar="[JOINT=]NAME",
            autocompletion=mountings,
            help="Put this actuator on every joint, or on one; the scenario has it, the robot's file stays.",
        ),
    ] = None,
    experiment: Annotated[
        Path | None,
        typer.Option(
            "--experiment",
            "-e",
            metavar="FILE",
            help="Play this recording's commands, compare with its motion; without ROBOT, propose how it is read.",
        ),
    ] = None,
    mapping: ColumnMap = None,
    rate: Rate = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", "--force", "-f", help="Replace an existing file.")] = False,
    schema: Annotated[bool, typer.Option(help="Also write the JSON Schema beside it, so that editors complete keys.")] = True,
    plugin: Plugins = None,
    argument: Arguments = None,
    package: Packages = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing.")] = False,
) -> None:
    """Write a commented starter scenario for a robot, or one from a recording of it; or propose how a recording is read.

    Example: asrsim init examples/urdf/plain_arm.urdf --actuator qbmove --out arm.yaml

    Example: asrsim init examples/urdf/dof2_vertical.urdf --experiment examples/recordings/two_joints.csv --out lab.yaml

    Example: asrsim init --experiment examples/recordings/bench_motion.csv --out bench_motion.csv.yaml
    """
    load_plugins(plugin)
    if robot is None:
        _propose(experiment, out, mapping or (), rate, overwrite=overwrite, quiet=quiet)
        return
    out = out or Path("scenario.yaml")
    packages = folders(package, "--package")
    arguments = pairs(argument, "--arg")
    given = dict(item.rpartition("=")[::2] if "=" in item else ("*", item) for item in actuator or ())
    if experiment is not None:
        from asrsim.runs.from_recording import write_from_recording

        made = write_from_recording(
            robot, experiment, out, mapping=mapping or (), rate=rate, mode=mode, actuators=given, plugins=plugin or (),
            force=overwrite, schema=schema, arguments=arguments, packages=packages,
        )  # fmt: skip
        if not quiet:
            _print(made, out, plugin)
        return
    if mapping or rate is not None:
        raise typer.BadParameter("requires --experiment", param_hint="--map" if mapping else "--rate")
    from asrsim.scenario.starter import write_starter

    written, notes = write_starter(
        robot, out, mode=mode, actuators=given, force=overwrite, schema=schema, arguments=arguments, packages=packages
    )
    if not quiet:
        from asrsim.actuators.user import command_line
        from asrsim.cli.console import say, say_problems

        say_problems(notes, "warning")
        say(f"wrote {', '.join(map(str, written))}; run it: {command_line('run', out, plugin)}")


def _propose(
    experiment: Path | None, out: Path | None, mapping: Sequence[str], rate: float | None, *, overwrite: bool, quiet: bool
) -> None:
    """Document that describes how a recording is read."""
    if experiment is None:
        raise typer.BadParameter("give a robot, a recording by --experiment, or both", param_hint="ROBOT")
    from asrsim.recordings.propose import propose

    written, recording = propose(experiment, out, mapping=mapping, rate=rate, force=overwrite)
    if not quiet:
        from asrsim.cli.console import say, say_problems
        from asrsim.cli.recording_table import say_columns

        say_columns(recording)
        say_problems(recording.findings, "note")
        say(f"wrote {written}: check it; every command that reads {experiment.name} obeys it")


def _print(made: Written, scenario: Path, plugins: list[Path] | None) -> None:
    from asrsim.actuators.user import command_line
    from asrsim.cli.console import say, say_problems
    from asrsim.cli.recording_table import say_columns

    say(f"{made.recording.path}: {made.recording.format}, {len(made.recording.time)} samples", "bold")
    say_columns(made.recording)
    say_problems(made.recording.findings, "note")
    for text in made.remarks:
        say(f"note: {text}", "yellow")
    say(f"wrote {', '.join(map(str, made.files))}; run it: {command_line('run', scenario, plugins)}")
    if made.fit is not None:
        say(f"find the robot's parameters: {command_line('identify', made.fit, plugins)}")
