"""`asrsim run`: simulates a scenario's variants and writes log, summary and plots."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from asrsim.cli.command import Done, command
from asrsim.cli.console import error_as_dict
from asrsim.cli.interrupt import INTERRUPTED, Interruption
from asrsim.cli.options import Overrides, Overwrite, Plot, Scenario, Variants, into_folder, option

if TYPE_CHECKING:
    from asrsim.errors import AsrsimError
    from asrsim.runs.execute import Executed
    from asrsim.scenario import Scenario as LoadedScenario


@command("Print errors, warnings and failed claims only.")
def run(
    scenario: Scenario,
    variant: Variants = None,
    overrides: Overrides = None,
    out: Annotated[
        Path | None,
        into_folder("Folder for the results; each of several variants gets a subfolder.", "out/<scenario>/<variant>"),
    ] = None,
    plot: Plot = True,
    report: Annotated[bool, option("Also write a page for the browser.", "--report")] = False,
    certify: Annotated[
        bool,
        option(
            "Run again with half and a quarter of the step and report the numerical error. Includes --cross-check if a second "
            "engine is installed, except for an engine of your own.",
            "--certify",
        ),
    ] = False,
    cross_check: Annotated[
        bool, option("Run again in another engine and report the differences of each joint.", "--cross-check")
    ] = False,
    engine: Annotated[
        str | None,
        option("Physics engine, like --set engine=NAME.", default="the scenario's engine"),
    ] = None,
    overwrite: Overwrite = False,
    *,
    plugin: list[Path],
    quiet: bool,
    json: bool,
) -> Done:
    """Simulate a scenario: write a log, a summary and plots of every variant, and check the scenario's claims.

    Results of an earlier run of the same scenario are replaced, with a message; results of another scenario are kept
    unless --overwrite is given. Ctrl-C ends the run with a readable log. Exit code: 0; 1 if a run failed, diverged, did not
    satisfy a claim of the scenario, or is contradicted by a cross-check; 130 after Ctrl-C.

    Example: asrsim run examples/scenarios/step_2dof.yaml

    Example: asrsim run examples/scenarios/step_2dof.yaml --variant soft --set references.joint_1.stiffness_preset=0.3
    """
    from asrsim.cli.progress import RunBar
    from asrsim.cli.report import print_run
    from asrsim.errors import AsrsimError
    from asrsim.runs.execute import execute, write_summary
    from asrsim.runs.folder import default_folder, folder_problems
    from asrsim.runs.lock import owned
    from asrsim.simulation.examine import examine_all

    settings = [*(overrides or []), *([f"engine={engine}"] if engine else [])]

    def folder_of(one: LoadedScenario, variants: int) -> Path:
        return default_folder(one) if out is None else (out / one.variant if variants > 1 else out)

    plans = examine_all(
        scenario,
        variants=variant or (),
        overrides=settings,
        plugins=plugin,
        beside=lambda own: folder_problems(own, lambda one: folder_of(one, len(own)), overwrite=overwrite),
    )
    done: list[Executed] = []
    printed: set[str] = set()
    failure: tuple[str, AsrsimError] | None = None
    with Interruption() as interruption:
        for plan in plans:
            one, folder = plan.scenario, folder_of(plan.scenario, len(plans))
            title, before = f"{one.name} / {one.variant}", len(done)
            try:
                with owned(folder):
                    with RunBar(title, one.duration, show=not quiet) as progress:
                        executed = execute(
                            plan,
                            folder,
                            overwrite=overwrite,
                            certify=certify,
                            cross_check=cross_check,
                            started=progress.start,
                            progress=progress.update,
                            stop=interruption.stop,
                        )
                    # Print and write the results of each variant now, so that they are not lost if drawing fails later.
                    done.append(write_summary(executed))
                    for wanted, add in ((plot, _drawn), (report, _reported)):
                        if wanted and executed.run.status != "interrupted":
                            done[-1] = write_summary(add(done[-1]))
            except AsrsimError as error:
                # This variant could not be built or written. Stop here, since the other variants would probably fail for the
                # same reason.
                failure = (title, error)
            if len(done) > before and not json:
                print_run(done[-1].summary, quiet=quiet, printed=printed)
                # Flush the output now, so that a program that reads it gets the line at once, and so that a closed pipe raises
                # its error here.
                sys.stdout.flush()
            if failure is not None or interruption.requested:
                break
    if failure is not None and not json:
        if len(plans) > 1:
            failure[1].add_note(f"{failure[0]} could not be run; the variants after it were not tried")
        raise failure[1]
    good = failure is None and all(entry.summary.ok for entry in done)
    errors = [] if failure is None else [{"variant": failure[0], **error_as_dict(failure[1])}]
    return Done(
        data={"ok": good, "runs": [entry.summary for entry in done], "errors": errors},
        code=INTERRUPTED if interruption.requested else int(not good),
    )


def _with_files(executed: Executed, **files: Any) -> Executed:
    return replace(executed, summary=replace(executed.summary, files={**executed.summary.files, **files}))


def _drawn(executed: Executed) -> Executed:
    from asrsim.plots import draw_run
    from asrsim.plots.output import load_undocumented
    from asrsim.runs.folder import LOG

    load_undocumented()
    folder = _folder_of(executed)
    return _with_files(executed, plots=tuple(draw_run(folder / LOG, folder, brief=True)))


def _reported(executed: Executed) -> Executed:
    from asrsim.report import write_report

    folder = _folder_of(executed)
    return _with_files(executed, report=write_report(folder, folder / "report.html"))


def _folder_of(executed: Executed) -> Path:
    assert executed.folder is not None
    return executed.folder
