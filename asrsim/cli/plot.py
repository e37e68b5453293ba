"""`asrsim plot`: draws logs, alone or beside experiments, with metrics and verdicts."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asrsim.cli import complete
from asrsim.cli.command import Done, command
from asrsim.cli.console import complain, say, say_columns, say_problems, say_table, say_written, styled
from asrsim.cli.options import (
    Align,
    ColumnMap,
    End,
    Files,
    Rate,
    Start,
    Texts,
    argument,
    check_window,
    into_folder,
    lag_of,
    option,
)

if TYPE_CHECKING:
    from asrsim.plots.job import PlotResult


@command("Print failed claims and problems only.")
def plot(
    logs: Annotated[
        Files,
        argument(
            "[LOG]...",
            "Logs (MCAP) of runs, or folders of runs or variants; each run has a separate colour. Without logs, --bode draws "
            "recordings alone.",
        ),
    ] = None,
    experiment: Annotated[
        Texts,
        option(
            "Recording to draw with the run (CSV, MCAP, ROS bag, .mat). May be repeated: recordings of the same motion are "
            "drawn as one shaded band.",
            "--experiment",
            "-e",
            metavar="[VARIANT=]FILE",
        ),
    ] = None,
    mapping: ColumnMap = None,
    joint: Annotated[Texts, option("Only this joint; may be repeated.", autocompletion=complete.joints)] = None,
    quantity: Annotated[Texts, option("Only this quantity; may be repeated.", autocompletion=complete.quantities)] = None,
    figure: Annotated[
        Texts, option("Only this figure of the runs; may be repeated.", metavar="NAME", autocompletion=complete.figures)
    ] = None,
    measure: Annotated[
        Texts,
        option(
            "Also show this measure of run and recording, of the link position unless --quantity or --experiment name other "
            "quantities; may be repeated.",
            metavar="NAME[:OPTION=VALUE,...]",
            autocompletion=complete.measures,
        ),
    ] = None,
    align: Align = "auto",
    rate: Rate = None,
    bode: Annotated[bool, option("Draw frequency responses with coherence.", "--bode")] = False,
    band: Annotated[
        tuple[float, float] | None,
        option("Frequency band of the Bode plot, Hz.", metavar="LOW HIGH", default="the excited frequencies"),
    ] = None,
    given: Annotated[
        str | None,
        option("Input of the Bode plot.", "--input", metavar="[JOINT.]QUANTITY", default="the position's reference"),
    ] = None,
    output: Annotated[
        str | None, option("Output of the Bode plot.", metavar="[JOINT.]QUANTITY", default="link_position")
    ] = None,
    start: Start = None,
    end: End = None,
    out: Annotated[Path | None, into_folder("Folder for the pictures.", "beside the log")] = None,
    formats: Annotated[Texts, option("Format of the pictures; may be repeated.", "--format", metavar="png|pdf|svg")] = None,
    *,
    quiet: bool,
) -> Done:
    """Draw runs, alone or beside experiments, and check the claims of their scenario.

    Exit code: 0, or 1 if a claim of the scenario does not hold.

    Example: asrsim plot out/step_2dof --format pdf --end 2

    Example: asrsim plot out/step_2dof/soft --bode --input equilibrium_position --output link_position

    Example: asrsim plot --experiment examples/recordings/two_joints.csv --bode --input joint_1.reference_1

    Example: asrsim plot out/step_2dof/soft/log.mcap --experiment examples/recordings/two_joints.csv --align start -o compared
    """
    from asrsim.cli.progress import FractionBar
    from asrsim.plots.job import PlotJob
    from asrsim.plots.job import plot as draw
    from asrsim.runs.folder import find_logs

    check_window(start, end)
    if (given or output) and not bode:
        raise typer.BadParameter("requires --bode", param_hint="--input" if given else "--output")
    found: list[Path] = []
    for place in logs or ():
        own, problems = find_logs(place)
        found += own
        say_problems(problems, "warning")
    job = PlotJob(
        logs=tuple(found), folder=out or _folder(found, experiment or [], alone=not experiment and not bode),
        experiments=tuple(experiment or ()), mapping=tuple(mapping or ()) or None, rate=rate,
        joints=tuple(joint) if joint else None, quantities=tuple(quantity) if quantity else None,
        figures=tuple(figure) if figure else None, measures=tuple(measure or ()),
        lag=lag_of(align), formats=tuple(formats or ("png",)),
        bode=bode, band=band, given=given, output=output, start=start, end=end,
    )  # fmt: skip
    if job.empty:
        hint = "name a log; without one, the response of a recording can be drawn: --experiment FILE --bode"
        raise typer.BadParameter(hint, param_hint="LOG")
    with FractionBar(show=not quiet) as progress:
        result = draw(job, progress.update)
    return Done(data=result.as_dict(), always=lambda: _print(result, quiet=quiet), code=int(not result.ok))


def _folder(logs: list[Path], experiments: list[str], *, alone: bool) -> Path:
    """Default folder of the pictures: the folder of a single log, a subfolder for several logs, `out` for recordings alone."""
    if not logs:
        return Path("out") / Path(experiments[0] if experiments else "").stem
    if len(logs) == 1:
        return logs[0].parent if alone else logs[0].parent / "compared"
    parents = [path.parent.absolute() if any(log.is_absolute() for log in logs) else path.parent for path in logs]
    return Path(os.path.commonpath(parents)) / ("variants" if alone else "compared")


def _print(result: PlotResult, *, quiet: bool) -> None:
    if not quiet:
        _print_experiments(result)
        if result.rows:
            _print_rows(result)
    say_problems(result.findings, "note")
    for label, claim in result.claims:
        who = f"{label}: " if len(result.runs) > 1 else ""
        if not claim.holds:
            complain(f"FAIL {who}{claim.text}", "red")
        elif not quiet:
            say(f"{styled('pass', 'green')} {who}{claim.text}")
    for run in result.runs:
        if run.status != "complete":
            said = "" if run.status == "truncated" else "; its claims are not evaluated"
            complain(f"{run.path}: the run is {run.status}, drawn up to its last sample{said}", "yellow")
    if not quiet:
        say_written(result.files, f" ({result.replaced} replaced)" if result.replaced else "")


def _print_experiments(result: PlotResult) -> None:
    shown: list[tuple[str, str, str, str]] = []
    for (path, label), recording in zip(result.assigned, result.recordings, strict=True):
        whose = "" if len(result.runs) <= 1 else f" -> {label}"
        say(f"{path}{whose}: {recording.format}, {len(recording.time)} samples", "bold")
        columns = [(one.source, one.meaning, one.conversion, one.origin) for one in recording.channels.values()]
        if shown == columns:
            say("  columns as above", "dim")
        else:
            say_columns(recording)
        shown = columns
    for one in result.compared:
        for name, alignment in one.alignments.items():
            found = f", correlation {alignment.found.correlation:.4f}" if alignment.found else ""
            say(f"{Path(name).name} beside {one.label}: {alignment.said} ({alignment.how}{found})")


def _print_rows(result: PlotResult) -> None:
    from asrsim.plots.rows import metric_tables

    for columns in metric_tables(result.rows):
        say_table(columns)
