"""`asrsim sweep`: runs a varied scenario many times, and writes rows, a table and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from asrsim.cli import complete
from asrsim.cli.command import Done, command
from asrsim.cli.console import complain, say, say_table, say_written
from asrsim.cli.interrupt import INTERRUPTED, Interruption
from asrsim.cli.options import Overrides, Plot, Texts, Variants, argument, into_folder, option
from asrsim.tables import from_rows

if TYPE_CHECKING:
    from asrsim.sweeps import Table


@command()
def sweep(
    study: Annotated[
        Path,
        argument("STUDY", "Scenario, study (a file with `scenario:` and `over:`), or folder of a study."),
    ],
    over: Annotated[
        Texts,
        option(
            "Vary a key: [A, B], LOW:HIGH:COUNT, log:LOW:HIGH:COUNT, uniform(LOW, HIGH), normal(MEAN, DEVIATION), "
            "loguniform(LOW, HIGH), lognormal(MEDIAN, SIGMA). 'KEY & KEY' are tied. May be repeated.",
            "--over",
            metavar="KEY=VALUES",
            autocompletion=complete.robot_keys,
        ),
    ] = None,
    variant: Variants = None,
    overrides: Overrides = None,
    sampler: Annotated[
        str | None, option("Sampler of the draws: random, lhs, sobol, saltelli, or your own sampler.", default="random")
    ] = None,
    samples: Annotated[int | None, option("Number of draws.", min=1, default="100")] = None,
    seed: Annotated[int | None, option("Seed of the draws.", min=0, default="0")] = None,
    fit: Annotated[
        Path | None,
        option("File with keys, mean and covariance: joint distribution of these keys.", default=""),
    ] = None,
    workers: Annotated[int | None, option("Number of processes.", "--workers", "-j", min=1, default="one per core")] = None,
    cluster: Annotated[
        str | None, option("Address of a Dask scheduler, whose workers simulate the runs.", default="none")
    ] = None,
    out: Annotated[Path | None, into_folder("Folder for the results.", "out/<name>/sweep")] = None,
    resume: Annotated[bool, option("Simulate only the runs that are missing in the folder.", "--resume")] = False,
    overwrite: Annotated[bool, option("Start again in a folder that contains rows.", "--overwrite")] = False,
    run: Annotated[int | None, option("Repeat this run of a study's folder, with a log.", min=0, default="")] = None,
    result: Annotated[
        Texts,
        option("Show and draw this result; may be repeated.", metavar="JOINT.MEASURE", default="the first results that vary"),
    ] = None,
    plot: Plot = True,
    *,
    plugin: list[Path],
    quiet: bool,
) -> Done:
    """Vary keys of a scenario, run the variations on all cores, and show how much each key influences each result.

    Each run is a row of rows.parquet, written when the run ends. Ctrl-C keeps the rows so far; --resume continues. The rows do
    not depend on the number of cores or on the cluster. Exit code: 0; 1 if nothing could be run or written; 130 after Ctrl-C. A
    run that diverges is a row, not a failure of the command.

    Example: asrsim sweep examples/scenarios/step_2dof.yaml --variant soft --over references.joint_1.stiffness_preset=0.2:0.6:20

    On a cluster: asrsim sweep study.yaml --cluster tcp://host:8786
    """
    given: dict[str, Any] = {
        "variants": variant or [],
        "overrides": overrides or [],
        "sampler": sampler,
        "samples": samples,
        "seed": seed,
        "fit": fit,
        "plugins": plugin,
    }
    if run is not None:
        return _repeated(study, run, out, plugin, quiet=quiet)
    if study.is_dir():
        from asrsim.sweeps import Table

        table, code = Table(study), 0
    else:
        table, code = _swept(study, over or [], given, workers, cluster, out, resume=resume, overwrite=overwrite, quiet=quiet)
    files: list[Path] = []
    if len(table) and plot and not code:
        from asrsim.sweeps.pictures import draw_sweep

        files += draw_sweep(table, results=result or [])
    from asrsim.sweeps.show import HEADS, chosen_results, remarks, result_rows, study_data, study_headline
    from asrsim.sweeps.store import MANIFEST

    chosen = chosen_results(table, result, len(result)) if result else []
    manifest = table.folder / MANIFEST

    def text() -> None:
        say(study_headline(table))
        if rows := result_rows(table, chosen):
            say_table(from_rows(HEADS, rows, right=range(1, len(HEADS))))
        for line in remarks(table):
            say(f"  {line}")
        say_written([manifest, *table.files[:1], *files])
        if table.missing:
            say(f"{table.missing} runs are missing; --resume simulates them")

    data = {**study_data(table, chosen), "files": [manifest, *table.files, *files]}
    return Done(data=data, text=text, code=code)


def _swept(
    path: Path,
    over: list[str],
    given: dict[str, Any],
    workers: int | None,
    cluster: str | None,
    out: Path | None,
    *,
    resume: bool,
    overwrite: bool,
    quiet: bool,
) -> tuple[Table, int]:
    from asrsim.cli.progress import SweepBar
    from asrsim.sweeps import sweep
    from asrsim.sweeps.run import study_of

    study = study_of(path, over, {name: value for name, value in given.items() if value not in (None, [])})
    for warning in study.joint.warnings if study.joint else ():
        complain(f"warning {warning}")
    folder = out or Path("out") / study.name / "sweep"
    message = "asrsim: stopping; finished rows are kept (Ctrl-C again to abort)"
    with Interruption(message) as interruption, SweepBar(study.name, show=not quiet) as progress:
        table = sweep(
            study,
            workers=workers,
            cluster=cluster,
            out=folder,
            resume=resume,
            overwrite=overwrite,
            progress=progress.update,
            stop=interruption.stop,
        )
    return table, INTERRUPTED if interruption.requested and table.missing else 0


def _repeated(folder: Path, number: int, out: Path | None, plugins: list[Path], *, quiet: bool) -> Done:
    """Repeat one run of a study, this time with a log."""
    from asrsim.cli.report import print_run
    from asrsim.sweeps import Table
    from asrsim.sweeps.run import run_again

    if not folder.is_dir():
        raise typer.BadParameter("requires the folder of a study", param_hint="--run")
    summary = run_again(Table(folder), number, out or folder / f"run_{number:06d}", plugins)
    return Done(data=summary.as_dict(), always=lambda: print_run(summary, quiet=quiet))
