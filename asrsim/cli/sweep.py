"""`asrsim sweep`: runs a varied scenario many times, and writes rows, a table and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from asrsim.cli.options import Json, Overrides, Plugins, into_folder, load_plugins

if TYPE_CHECKING:
    from asrsim.sweeps import Table


def sweep(
    study: Annotated[
        Path,
        typer.Argument(
            metavar="STUDY",
            help="Scenario, study (a file with `scenario:` and `over:`), or folder of a study.",
            show_default=False,
        ),
    ],
    over: Annotated[
        list[str] | None,
        typer.Option(
            "--over",
            metavar="KEY=VALUES",
            help="Vary a key: [A, B], LOW:HIGH:COUNT, log:LOW:HIGH:COUNT, uniform(LOW, HIGH), normal(MEAN, DEVIATION), "
            "loguniform(LOW, HIGH), lognormal(MEDIAN, SIGMA). 'KEY & KEY' are tied. May be repeated.",
        ),
    ] = None,
    variant: Annotated[list[str] | None, typer.Option(help="This variant only; may be repeated.", show_default="all")] = None,
    overrides: Overrides = None,
    design: Annotated[str, typer.Option(help="Design of the draws: random, lhs, sobol, saltelli.")] = "random",
    samples: Annotated[int | None, typer.Option(min=1, help="Number of draws.", show_default="100")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the draws.")] = 0,
    fit: Annotated[
        Path | None,
        typer.Option(help="File with keys, mean and covariance: joint distribution of these keys.", show_default=False),
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", "-j", min=1, help="Number of processes.", show_default="one per core")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, whose workers do the runs.", show_default="none")
    ] = None,
    out: Annotated[Path | None, into_folder("Folder for the results.", "out/<name>/sweep")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Do only the runs that are missing in the folder.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Start again in a folder that contains rows.")] = False,
    run: Annotated[
        int | None, typer.Option(min=0, help="Repeat this run of a study's folder, with a log.", show_default=False)
    ] = None,
    result: Annotated[
        list[str] | None,
        typer.Option(metavar="JOINT.MEASURE", help="Draw this result; may be repeated.", show_default="the first that vary"),
    ] = None,
    plugin: Plugins = None,
    plot: Annotated[bool, typer.Option("--plot/--no-plot", help="Draw pictures.")] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")] = False,
    json: Json = False,
) -> None:
    """Vary keys of a scenario, run it on all cores, and show how much each key influences each result.

    Rows are in rows.parquet, written as runs end. Ctrl-C keeps the rows so far; --resume continues. Equal studies give equal
    rows on one core, on many, and on a cluster. Exit code: 0, 1 if nothing could be run or written, 130 after Ctrl-C; runs that
    diverge are rows, not failures of the command.

    Example: asrsim sweep examples/scenarios/step_2dof.yaml --variant soft --over references.joint_1.stiffness_preset=0.2:0.6:20

    On a cluster: asrsim sweep study.yaml --cluster tcp://host:8786
    """
    from asrsim.cli.console import json_errors

    given: dict[str, Any] = {
        "variants": variant or [], "overrides": overrides or [], "design": design, "samples": samples, "seed": seed,
        "fit": fit, "plugins": plugin or [],
    }  # fmt: skip
    with json_errors(json):
        load_plugins(plugin)
        if study.is_dir():
            table = _opened(study, run, out, given["plugins"], quiet=quiet or json)
            code = 0
        else:
            if run is not None:
                raise typer.BadParameter("requires the folder of a study", param_hint="--run")
            table, code = _swept(
                study, over or [], given, workers, cluster, out, resume=resume, overwrite=overwrite, quiet=quiet or json
            )
        if table is not None:
            _show(table, result or [], plot=plot and not code, quiet=quiet, json=json)
    if code:
        raise typer.Exit(code)


def _swept(
    path: Path, over: list[str], given: dict[str, Any], workers: int | None, cluster: str | None, out: Path | None,
    *, resume: bool, overwrite: bool, quiet: bool,
) -> tuple[Table, int]:  # fmt: skip
    from asrsim.cli.console import complain
    from asrsim.cli.interrupt import INTERRUPTED, Interruption
    from asrsim.cli.progress import SweepBar
    from asrsim.sweeps import sweep
    from asrsim.sweeps.run import study_of

    defaults = {"design": "random", "seed": 0}
    study = study_of(path, over, {name: value for name, value in given.items() if value and value != defaults.get(name)})
    for warning in study.joint.warnings if study.joint else ():
        complain(f"warning {warning}")
    folder = out or Path("out") / study.name / "sweep"
    message = "asrsim: stopping; finished rows are kept (Ctrl-C again to abort)"
    with Interruption(message) as interruption, SweepBar(study.name, show=not quiet) as progress:
        table = sweep(
            study, workers=workers, cluster=cluster, out=folder, resume=resume, overwrite=overwrite,
            progress=progress.update, stop=interruption.stop,
        )  # fmt: skip
    return table, INTERRUPTED if interruption.requested and table.missing else 0


def _opened(folder: Path, run: int | None, out: Path | None, plugins: list[Path], *, quiet: bool) -> Table | None:
    from asrsim.cli.report import print_run
    from asrsim.sweeps import Table
    from asrsim.sweeps.run import run_again

    table = Table(folder)
    if run is None:
        return table
    summary = run_again(table, run, out or folder / f"run_{run:06d}", plugins)
    print_run(summary, quiet=quiet, silent=quiet)
    return None


def _show(table: Table, results: list[str], *, plot: bool, quiet: bool, json: bool) -> None:
    from asrsim.cli.console import say, say_json, say_written
    from asrsim.sweeps.show import as_dict, say_summary

    files: list[Path] = []
    if plot and len(table):
        from asrsim.sweeps.pictures import draw_sweep

        files = draw_sweep(table, results=results)
    if json:
        say_json({**as_dict(table), "files": [str(path) for path in (*table.files, *files)]})
    elif not quiet:
        for line in say_summary(table):
            say(line)
        say_written([*table.files[:1], *files])
        if table.missing:
            say(f"{table.missing} runs are missing; --resume does them")
