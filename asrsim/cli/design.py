"""`asrsim design`: computes the experiment that gives the most information about unknown parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from asrsim.cli import complete
from asrsim.cli.command import Done, command
from asrsim.cli.console import say, say_table, say_written
from asrsim.cli.interrupt import INTERRUPTED, Interruption
from asrsim.cli.options import Files, Overrides, Plot, Texts, Variant, argument, option


@command()
def design(
    scenario: Annotated[Path, argument("SCENARIO", "Scenario of the robot, or a fit file.")],
    limits: Annotated[Path, option("File with limits of joints, noise of sensors, and gains to choose from.", metavar="FILE")],
    duration: Annotated[float, option("Length of the experiment.", metavar="SECONDS")] = 10.0,
    free: Annotated[
        Texts,
        option(
            "Parameter to identify, as in `identify`; may be repeated.",
            "--free",
            metavar="KEY",
            autocompletion=complete.robot_keys,
        ),
    ] = None,
    tie: Annotated[
        Texts,
        option("A parameter that is a multiple of another parameter, as in `identify`.", "--tie", metavar="KEY=[FACTOR*]KEY"),
    ] = None,
    experiment: Annotated[
        Files,
        option(
            "A recording that will be fitted together with the designed motion; may be repeated.",
            "--experiment",
            "-e",
            metavar="FILE",
        ),
    ] = None,
    robust: Annotated[
        int,
        option(
            "Number of further robots for which the motion is also designed; their free parameters are drawn within a "
            "factor of 2 of the robot's parameters.",
            min=0,
        ),
    ] = 0,
    variant: Variant = None,
    overrides: Overrides = None,
    out: Annotated[Path, option("CSV of the motion; scenario and picture are written beside it.", metavar="FILE")] = Path(
        "excite.csv"
    ),
    seed: Annotated[int, option("Seed of the search.", min=0)] = 0,
    plot: Plot = True,
    *,
    plugin: list[Path],
    quiet: bool,
) -> Done:
    """Design the most informative experiment for the free parameters, within limits.

    The command writes the motion as CSV with the headings that `identify` reads, a scenario that plays this motion, and a
    picture. It prints the predicted interval of each parameter, for this motion, for a step and for a chirp. Ctrl-C keeps the
    best motion so far.

    Example: asrsim design lab.yaml --set initial=equilibrium --free 'joint_1.spring_*' --limits
    examples/recordings/limits.yaml --duration 4
    """
    from asrsim.cli.progress import FractionBar
    from asrsim.designs.run import design as designed
    from asrsim.designs.write import interval_columns, write_design
    from asrsim.outfile import check_output, make_folder
    from asrsim.plain import finite_or_none, mapped

    options: dict[str, Any] = {"free": free, "ties": tie, "variant": variant, "overrides": overrides, "plugins": plugin}
    # The search takes minutes, so refuse paths that cannot be written before it starts.
    make_folder(out.parent)
    check_output(out, "designed motion")
    message = "asrsim: stopping; the best motion so far is kept (Ctrl-C again to abort)"
    with Interruption(message) as interruption, FractionBar(show=not quiet) as bar:
        found = designed(
            scenario,
            limits,
            duration=duration,
            experiments=experiment or (),
            robust=robust,
            seed=seed,
            stop=interruption.stop,
            progress=bar.update,
            **{name: value for name, value in options.items() if value not in (None, [])},
        )
        files = write_design(found, out, plot=plot)

    def text() -> None:
        say_table(interval_columns(found))
        for remark in (*found.remarks, *(["interrupted: this is the best motion so far"] if found.interrupted else [])):
            say(remark)
        say_written(files)

    intervals = {name: dict(zip(found.keys, halves.tolist(), strict=True)) for name, halves in found.intervals.items()}
    data = {
        "ok": not found.interrupted,
        "files": files,
        "findings": [{"message": remark} for remark in found.remarks],
        "intervals": mapped(intervals, finite_or_none),
    }
    return Done(data=data, text=text, code=INTERRUPTED if found.interrupted else 0)
