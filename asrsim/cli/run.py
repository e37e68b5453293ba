"""`asrsim run`: simulates a scenario's variants and writes log, summary and plots."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from asrsim.cli.completion import engines, variants
from asrsim.cli.options import Json, Overrides, Plugins, into_folder, load_plugins

if TYPE_CHECKING:
    from asrsim.errors import AsrsimError
    from asrsim.runs.execute import Executed


def run(
    scenario: Annotated[Path, typer.Argument(metavar="SCENARIO", help="Scenario file (YAML).", show_default=False)],
    variant: Annotated[
        list[str] | None,
        typer.Option(help="Run this variant only; may be repeated.", show_default="all", autocompletion=variants),
    ] = None,
    overrides: Overrides = None,
    out: Annotated[
        Path | None,
        into_folder("Folder for the results; each of several variants gets a subfolder.", "out/<scenario>/<variant>"),
    ] = None,
    plugin: Plugins = None,
    plot: Annotated[bool, typer.Option("--plot/--no-plot", help="Draw the runs.")] = True,
    report: Annotated[bool, typer.Option("--report", help="Also write a page for the browser.")] = False,
    certify: Annotated[
        bool, typer.Option("--certify", help="Run again with half and a quarter of the step and report the numerical error.")
    ] = False,
    cross_check: Annotated[
        bool, typer.Option("--cross-check", help="Run again in another engine and report the differences of each joint.")
    ] = False,
    engine: Annotated[
        str | None,
        typer.Option(help="Physics engine, like --set engine=NAME.", show_default="the scenario's", autocompletion=engines),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the results of another scenario too.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors and failed claims only.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print every warning on its own line.")] = False,
    json: Json = False,
) -> None:
    """Simulate a scenario: write a log, a summary and plots of every variant, and check the scenario's claims.

    Results of an earlier run of the same scenario are replaced, and the command says so; those of another one are kept
    unless --overwrite is given. Ctrl-C ends the run with a readable log. Exit code: 0, 1 if a run failed, diverged, did not
    meet what the scenario expects, or is contradicted by a cross-check, 130 after Ctrl-C.

    Example: asrsim run examples/scenarios/step_2dof.yaml

    Example: asrsim run examples/scenarios/step_2dof.yaml --variant soft --set references.joint_1.stiffness_preset=0.3
    """  # fmt: skip
    from asrsim.cli.console import json_errors

    with json_errors(json):
        code = _run(
            scenario, variant or [], [*(overrides or []), *([f"engine={engine}"] if engine else [])], out, plugin or [],
            plot=plot, report=report, certify=certify, cross_check=cross_check, overwrite=overwrite, quiet=quiet or json,
            verbose=verbose, json=json,
        )  # fmt: skip
    if code:
        raise typer.Exit(code)


def _run(
    path: Path, chosen: list[str], overrides: list[str], out: Path | None, plugins: list[Path], *, plot: bool,
    report: bool, certify: bool, cross_check: bool, overwrite: bool, quiet: bool, verbose: bool, json: bool,
) -> int:  # fmt: skip
    import sys

    from asrsim.cli.console import error_as_dict, say_json
    from asrsim.cli.interrupt import INTERRUPTED, Interruption
    from asrsim.cli.report import print_run
    from asrsim.errors import AsrsimError
    from asrsim.runs.execute import execute, with_plugins, write_summary
    from asrsim.runs.folder import default_folder
    from asrsim.runs.lock import owned
    from asrsim.scenario import load_scenario

    load_plugins(plugins)
    names: list[str | None] = list(chosen) or [None]
    loaded = [one for name in names for one in load_scenario(path, variant=name, overrides=overrides)]
    scenarios = [with_plugins(one, plugins) for one in loaded]
    done: list[Executed] = []
    printed: set[str] = set()
    failure: tuple[str, AsrsimError] | None = None
    with Interruption() as interruption:
        for one in scenarios:
            folder = default_folder(one) if out is None else (out / one.variant if len(scenarios) > 1 else out)
            title = f"{one.name} / {one.variant}"
            before = len(done)
            try:
                from asrsim.cli.progress import RunBar

                with owned(folder):
                    with RunBar(title, one.duration, show=not quiet) as progress:
                        executed = execute(
                            one, folder, overwrite=overwrite, certify=certify, cross_check=cross_check,
                            started=progress.start, progress=progress.update, stop=interruption.stop,
                            certifying=progress.update_part,
                        )  # fmt: skip
                    # Print and write the results of each variant at once, so that none are lost if drawing fails.
                    done.append(executed)
                    done[-1] = write_summary(done[-1])
                    if plot and executed.run.status != "interrupted":
                        done[-1] = write_summary(_drawn(done[-1]))
                    if report and executed.run.status != "interrupted":
                        done[-1] = write_summary(_reported(done[-1]))
            except AsrsimError as error:
                # This variant could not be built or written: the others would probably fail in the same way.
                failure = (title, error)
            if len(done) > before:
                print_run(done[-1].summary, quiet=quiet, silent=json, verbose=verbose, printed=printed)
                # Flush now: a reader sees the line, and a closed pipe is noticed here.
                sys.stdout.flush()
            if failure is not None or interruption.requested:
                break
    if json:
        errors = [] if failure is None else [{"variant": failure[0], **error_as_dict(failure[1])}]
        ok = failure is None and all(entry.summary.ok for entry in done)
        say_json({"ok": ok, "runs": [entry.summary.as_dict() for entry in done], "errors": errors})
    elif failure is not None:
        _complain_of(failure[0], failure[1], alone=len(scenarios) == 1)
    if interruption.requested:
        return INTERRUPTED
    return 0 if failure is None and all(entry.summary.ok for entry in done) else 1


def _complain_of(title: str, error: AsrsimError, *, alone: bool) -> None:
    from asrsim.cli.console import complain, error_lines

    lines = error_lines(error)
    where = "" if alone else f"{title}: "
    complain(f"asrsim: {where}{lines[0]}" if len(lines) == 1 else f"asrsim: {where}{len(lines)} problems:")
    for line in lines if len(lines) > 1 else ():
        complain(line)
    for note in getattr(error, "__notes__", []):
        complain(f"asrsim: {note}")


def _with_files(executed: Executed, **files: Any) -> Executed:
    from dataclasses import replace

    return replace(executed, summary=replace(executed.summary, files={**executed.summary.files, **files}))


def _drawn(executed: Executed) -> Executed:
    from asrsim.plots import draw_run
    from asrsim.plots.output import load_undocumented
    from asrsim.runs.folder import LOG

    load_undocumented()
    folder = _folder_of(executed)
    plots = draw_run(folder / LOG, folder, brief=True)
    if executed.summary.certificate or executed.summary.cross_check:
        from asrsim.plots.accuracy import draw_accuracy

        plots += draw_accuracy(folder, executed.summary.certificate, executed.summary.cross_check)
    return _with_files(executed, plots=tuple(plots))


def _reported(executed: Executed) -> Executed:
    from asrsim.report import write_report

    folder = _folder_of(executed)
    return _with_files(executed, report=write_report(folder, folder / "report.html"))


def _folder_of(executed: Executed) -> Path:
    assert executed.folder is not None
    return executed.folder
