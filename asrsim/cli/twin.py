"""`asrsim twin`: a twin follows a recording of the robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from asrsim.cli.completion import variants
from asrsim.cli.options import ColumnMap, Json, Overrides, Plugins, Rate, into_folder, load_plugins, mapping_of


def twin(
    scenario: Annotated[Path, typer.Argument(metavar="SCENARIO", help="Scenario of the robot.", show_default=False)],
    experiment: Annotated[
        Path, typer.Option("--experiment", "-e", metavar="FILE", help="Recording of commands and link positions.")
    ],
    bandwidth: Annotated[
        float | None, typer.Option(help="Bandwidth of the observer, Hz.", show_default="8, at most a twentieth of the rate")
    ] = None,
    mapping: ColumnMap = None,
    rate: Rate = None,
    lag: Annotated[
        float, typer.Option(help="Time by which the clock of the positions is ahead of the clock of the commands, s.")
    ] = 0.0,
    variant: Annotated[
        str | None, typer.Option(help="Variant of the scenario.", show_default="the only one", autocompletion=variants)
    ] = None,
    overrides: Overrides = None,
    out: Annotated[Path, into_folder("Folder for table and picture.")] = Path("out/twin"),
    plugin: Plugins = None,
    plot: Annotated[bool, typer.Option("--plot/--no-plot", help="Draw a picture.")] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")] = False,
    json: Json = False,
) -> None:
    """Find the external torques on a robot, and the stiffness of its joints, from a recording of commands and link positions.

    A simulation gets the commands and is pulled to the measured positions. An alarm means contact, or a robot that differs from
    its model.

    Example: asrsim twin lab.yaml --experiment examples/recordings/two_joints.csv
    """
    from asrsim.cli.console import json_errors, say, say_json, say_table, say_written

    with json_errors(json):
        from asrsim.cli.interrupt import INTERRUPTED, Interruption
        from asrsim.cli.progress import FractionBar
        from asrsim.twin.follow import follow, write

        load_plugins(plugin)
        with (
            Interruption("asrsim: stopping; the results so far are kept (Ctrl-C again to abort)") as interruption,
            FractionBar(show=not quiet and not json) as bar,
        ):
            found = follow(
                scenario, experiment, bandwidth=bandwidth, mapping=mapping_of(mapping), rate=rate, lag=lag, variant=variant,
                overrides=overrides or (), progress=lambda share: bar.update("twin", share), stop=interruption.stop,
            )  # fmt: skip
        files = write(found, out, plot=plot)
    rows = found.rows()
    if json:
        say_json({"ok": True, "joints": rows, "notes": list(found.notes), "files": [str(path) for path in files]})
    elif not quiet:
        say_table([
            ("joint", [row["joint"] for row in rows], False),
            ("external torque", [_number(row["external_torque_rms"], "{:.3g} N m rms") for row in rows], True),
            ("largest", [_number(row["largest"], "{:.3g} N m") for row in rows], True),
            ("at", [_number(row["largest_at"], "{:.2f} s") for row in rows], True),
            ("residual", [_number(row["residual_rms"], "{:.2g} rad rms") for row in rows], True),
            ("alarms", [str(len(row["alarms"])) for row in rows], True),
            ("stiffness [N m/rad]", [_range(row["stiffness"]) for row in rows], True),
        ])  # fmt: skip
        for note in found.notes[:20]:
            say(note)
        if len(found.notes) > 20:
            say(f"and {len(found.notes) - 20} further notes (--json prints all)")
        say_written(files)
    if found.interrupted:
        raise typer.Exit(INTERRUPTED)


def _range(ends: list[float] | None) -> str:
    return f"{ends[0]:.3g} to {ends[1]:.3g}" if ends else "not shown"


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else form.format(value)
