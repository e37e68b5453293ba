"""`asrsim export`: writes the robot with its motors and springs for other simulators."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from asrsim.cli.command import Done, command
from asrsim.cli.console import say, say_table, say_written
from asrsim.cli.options import Overrides, Plot, Scenario, Variant, into_file, option
from asrsim.tables import TableColumn


@command()
def export(
    scenario: Scenario,
    program: Annotated[
        str, option("Program that the file is made for; a plugin can add programs.", "--for", metavar="mujoco|warp|mjx|mjlab")
    ] = "mujoco",
    file_format: Annotated[str, option("Format of the file.", "--format", metavar="mjcf")] = "mjcf",
    out: Annotated[Path, into_file("Model file; meshes, picture and ranges are written next to it.", ".xml")] = Path(
        "soft.xml"
    ),
    knots: Annotated[
        int | None,
        option(
            "Knots on each side of the spline that stands for a spring's law in the file.",
            min=0,
            max=50,
            default="error below 0.1 mrad",
        ),
    ] = None,
    step: Annotated[float | None, option("Time step of the model, s.", default="half of the scenario's step")] = None,
    fit: Annotated[
        Path | None,
        option(
            "fit.json of `identify`: the model gets the fitted values, and their intervals are written as ranges.",
            metavar="FILE",
        ),
    ] = None,
    variant: Variant = None,
    overrides: Overrides = None,
    plot: Plot = True,
) -> Done:
    """Write the robot with motors and springs as MJCF for MuJoCo, MuJoCo Warp, MuJoCo XLA or mjlab, without any plugin.

    The command replays the scenario in this program, or in MuJoCo if the program is not installed. It prints and draws the
    error of each joint, and lists the parts of the scenario that the file lacks. It refuses a scenario that the program would
    simulate wrongly.

    Example: asrsim export examples/scenarios/sine_2dof.yaml --variant soft --for mujoco --out soft.xml
    """
    if file_format != "mjcf":
        raise typer.BadParameter(f"'{file_format}' is not a known format; choose from: mjcf", param_hint="--format")
    if step is not None and not 1e-6 <= step <= 1.0:
        raise typer.BadParameter("must be from 1e-6 to 1 s", param_hint="--step")
    from asrsim.exports import export as exported

    found = exported(
        scenario, out, variant=variant, overrides=overrides or (), program=program, knots=knots, step=step, fit=fit, plot=plot
    )
    replay = found.replay

    def text() -> None:
        rows = found.as_dict()["joints"]
        springs = ["-" if row["spring_error"] is None else f"{row['spring_error']:.3g} {row['unit']}" for row in rows.values()]
        say_table(
            [
                TableColumn("joint", list(rows)),
                TableColumn("RMS from asrsim", [f"{row['rms']:.3g} {row['unit']}" for row in rows.values()], right=True),
                TableColumn("largest difference", [f"{row['largest']:.3g} {row['unit']}" for row in rows.values()], right=True),
                TableColumn("error of the spring's spline", springs, right=True),
            ]
        )
        tried = f", not in {found.made_for}: {replay.untried}" if replay.untried else ""
        say(f"Replayed in {replay.program}{tried}.")
        if found.remarks:
            say("Not in the file:")
        for remark in found.remarks:
            say(f"  {remark}")
        say_written(found.files)

    return Done(data={"ok": found.good, **found.as_dict()}, text=text, code=int(not found.good))
