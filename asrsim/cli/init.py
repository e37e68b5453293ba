"""`asrsim init`: a starter scenario for a robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from asrsim.cli.command import Done, command
from asrsim.cli.console import say, say_columns, say_problems
from asrsim.cli.options import Arguments, ColumnMap, Packages, Rate, Texts, argument, folders, into_file, option, pairs
from asrsim.errors import Problem

if TYPE_CHECKING:
    from asrsim.recordings import Recording


@command("Print nothing.")
def init(
    robot: Annotated[Path | None, argument("[ROBOT]", "URDF or xacro file of the robot.")] = None,
    out: Annotated[
        Path | None, into_file("The file to write.", ".yaml", ".yml", default="scenario.yaml; for a recording alone FILE.yaml")
    ] = None,
    mode: Annotated[
        int | None, option("Operation mode of all joints, instead of the modes in the robot file.", "--mode", min=0, max=8)
    ] = None,
    actuator: Annotated[
        Texts,
        option(
            "Put this actuator on every joint, or on one joint. The actuator is written into the scenario; the robot's file "
            "stays unchanged.",
            "--actuator",
            "-a",
            metavar="[JOINT=]NAME",
        ),
    ] = None,
    experiment: Annotated[
        Path | None,
        option(
            "Recording whose commands are played and whose motion is compared. Without ROBOT, propose how to read the "
            "recording.",
            "--experiment",
            "-e",
            metavar="FILE",
        ),
    ] = None,
    mapping: ColumnMap = None,
    rate: Rate = None,
    overwrite: Annotated[bool, option("Replace the file if it exists.", "--overwrite")] = False,
    arg: Arguments = None,
    package: Packages = None,
    *,
    plugin: list[Path],
) -> Done:
    """Write a commented starter scenario for a robot, with or without a recording of the robot; or propose how to read a
    recording.

    Example: asrsim init examples/urdf/plain_arm.urdf --actuator qbmove --out arm.yaml

    Example: asrsim init examples/urdf/dof2_vertical.urdf --experiment examples/recordings/two_joints.csv --out lab.yaml

    Example: asrsim init --experiment examples/recordings/bench_motion.csv --out bench_motion.csv.yaml
    """
    from asrsim.plugins import command_line

    columns, target = mapping or [], out or Path("scenario.yaml")
    if robot is None:
        if experiment is None:
            raise typer.BadParameter("give a robot, a recording by --experiment, or both", param_hint="ROBOT")
        from asrsim.recordings.propose import propose
        from asrsim.recordings.reading import ENDING
        from asrsim.starter.robot import write_new

        document = out or experiment.with_name(experiment.name + ENDING)
        text, read = propose(experiment, mapping=columns, rate=rate)
        write_new({document: text}, force=overwrite)
        asked = "answer the questions, marked `# ?`" if "  # ?" in text else "check this file"
        hints = [f"wrote {document}: {asked}; every command reads {experiment.name} as this file states"]
        return _done([document], read.findings, hints, recording=read)
    mounted = dict(item.rpartition("=")[::2] if "=" in item else ("*", item) for item in actuator or ())
    options: dict[str, Any] = {
        "mode": mode,
        "actuators": mounted,
        "force": overwrite,
        "arguments": pairs(arg, "--arg"),
        "packages": folders(package, "--package"),
    }
    run = f"run it: {command_line('run', target, plugin)}"
    if experiment is None:
        if mapping or rate is not None:
            raise typer.BadParameter("belongs to --experiment", param_hint="--map" if mapping else "--rate")
        from asrsim.starter.robot import write_starter

        files, notes = write_starter(robot, target, **options)
        return _done(files, notes, [f"wrote {', '.join(map(str, files))}; {run}"])
    from asrsim.starter.recording import write_from_recording

    made = write_from_recording(robot, experiment, target, mapping=columns, rate=rate, plugins=plugin, **options)
    remarks = [Problem(text, file=experiment, code="starter") for text in made.remarks]
    hints = [f"wrote {', '.join(map(str, made.files))}; {run}"]
    if made.fit is not None:
        hints.append(f"find the robot's parameters: {command_line('identify', made.fit, plugin)}")
    return _done(made.files, [*made.recording.findings, *remarks], hints, recording=made.recording)


def _done(files: Sequence[Path], notes: Sequence[Problem], hints: Sequence[str], *, recording: Recording | None = None) -> Done:
    def text() -> None:
        if recording is not None:
            say(f"{recording.path}: {recording.format}, {len(recording.time)} samples", "bold")
            say_columns(recording)
        say_problems(notes, "warning" if recording is None else "note")
        for hint in hints:
            say(hint)

    return Done(
        data={"ok": True, "files": files, "findings": notes},
        text=text,
    )
