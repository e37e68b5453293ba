"""`asrsim design`: computes the experiment that gives the most information about unknown parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from asrsim.cli.options import Overrides, Plugins, load_plugins


def design(
    scenario: Annotated[
        Path, typer.Argument(metavar="SCENARIO", help="Scenario of the robot, or a fit file.", show_default=False)
    ],
    limits: Annotated[Path, typer.Option(metavar="FILE", help="Limits of joints, noise of sensors, gains to choose from.")],
    seconds: Annotated[float, typer.Option(metavar="SECONDS", help="Length of the experiment.")] = 10.0,
    free: Annotated[
        list[str] | None,
        typer.Option("--free", metavar="KEY", help="Parameter to identify, as in `identify`; may be repeated."),
    ] = None,
    tie: Annotated[list[str] | None, typer.Option("--tie", metavar="KEY=[FACTOR*]KEY", help="As in `identify`.")] = None,
    after: Annotated[list[Path] | None, typer.Option(metavar="FILE", help="An existing recording; may be repeated.")] = None,
    robust: Annotated[
        int, typer.Option(min=0, help="Further draws of the free numbers, within a factor of 2, that the motion is made for.")
    ] = 0,
    variant: Annotated[str | None, typer.Option(help="Variant of the scenario.")] = None,
    overrides: Overrides = None,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="CSV of the motion; scenario and picture are written beside it.")
    ] = Path("excite.csv"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the search.")] = 0,
    plugin: Plugins = None,
    plot: Annotated[bool, typer.Option("--plot/--no-plot", help="Draw a picture.")] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")] = False,
) -> None:
    """Design the most informative experiment for the free parameters, within limits.

    Writes the motion as CSV with the headings that `identify` reads, a scenario that plays it, and a picture; and says which
    interval each parameter is promised, beside one step and a chirp. Ctrl-C keeps the best so far.

    Example: asrsim design lab.yaml --free 'joint_1.spring_*' --limits examples/recordings/limits.yaml --seconds 4
    """
    from asrsim.cli.console import say, say_table, say_written
    from asrsim.cli.interrupt import INTERRUPTED, Interruption
    from asrsim.cli.progress import FractionBar
    from asrsim.design.run import design as designed
    from asrsim.design.write import columns, write_design

    load_plugins(plugin)
    options: dict[str, Any] = {"free": free, "ties": tie, "variant": variant, "overrides": overrides, "plugins": plugin}
    given = {name: value for name, value in options.items() if value not in (None, [])}
    with (
        Interruption("asrsim: stopping; the best so far is kept (Ctrl-C again to abort)") as interruption,
        FractionBar(show=not quiet) as bar,
    ):
        found = designed(
            scenario, limits, seconds=seconds, after=after or (), robust=robust, seed=seed, stop=interruption.stop,
            progress=lambda share: bar.update("search", share), **given,
        )  # fmt: skip
    files = write_design(found, out, plot=plot)
    if not quiet:
        say_table(columns(found))
        for text in found.remarks:
            say(text)
        if found.interrupted:
            say("interrupted: this is the best so far")
        say_written(files)
    if found.interrupted:
        raise typer.Exit(INTERRUPTED)
