"""`asrsim ilc`: iterative learning control of a scenario, with a live table and resumption, and on the real robot."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from asrsim.cli.completion import variants
from asrsim.cli.options import Align, ColumnMap, Json, Overrides, Plugins, into_folder, lag_of, load_plugins, mapping_of

if TYPE_CHECKING:
    from asrsim.learning.plant import Plant
    from asrsim.learning.prepared import Prepared
    from asrsim.learning.trial import LearningProblem, Trial
    from asrsim.recordings.align import LagChoice


def ilc(
    scenario: Annotated[
        Path, typer.Argument(metavar="SCENARIO", help="Scenario file (YAML) with a block `ilc`.", show_default=False)
    ],
    variant: Annotated[
        str | None, typer.Option(help="Variant to learn.", show_default="the only one", autocompletion=variants)
    ] = None,
    overrides: Overrides = None,
    out: Annotated[Path | None, into_folder("Folder for the results.", "out/<scenario>/ilc")] = None,
    recording: Annotated[
        Path | None,
        typer.Option(
            "--next",
            metavar="RECORDING",
            help="Learn on the real robot: compute its next input (next.csv) from this recorded trial.",
        ),
    ] = None,
    mapping: ColumnMap = None,
    align: Align = "off",
    resume: Annotated[bool, typer.Option("--resume", help="Continue an interrupted learning exactly.")] = False,
    plugin: Plugins = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Also replace the results of another scenario.")] = False,
    plot: Annotated[bool, typer.Option("--plot/--no-plot", help="Draw errors and trajectories.")] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print only the result.")] = False,
    json: Json = False,
) -> None:
    """Learn the inputs that make the joints follow `ilc.trajectory`, trial by trial (paper section 4.3).

    Writes the learned inputs (learned.csv), a scenario that plays them (learned.yaml), the numbers (ilc.json), a picture
    (ilc.png), and the state to resume from. What an earlier run of the same scenario left there is replaced, and the command
    says so; that of another one is kept unless --overwrite is given. Exit code: 0, 1 if learning did not converge or a run
    failed, 130 after Ctrl-C.

    Example: asrsim ilc examples/scenarios/ilc_2dof.yaml

    Example: asrsim ilc examples/scenarios/ilc_2dof.yaml --set ilc.law=auto

    Example: asrsim ilc examples/scenarios/ilc_2dof.yaml --next trial_7.mcap
    """
    from asrsim.cli.console import complain, json_errors, say_json
    from asrsim.cli.interrupt import INTERRUPTED
    from asrsim.learning.plant import make_plant
    from asrsim.scenario import load_scenario, only_variant

    folder: Path | None = None
    try:
        with json_errors(json):
            load_plugins(plugin or [])
            chosen = only_variant(load_scenario(scenario, variant=variant, overrides=overrides or []))
            folder, plant = out or Path("out") / chosen.name / "ilc", make_plant(chosen)
            if recording is not None:
                data = _next(plant, folder, recording, mapping_of(mapping), lag_of(align), silent=json)
            else:
                data = _learn(plant, folder, plugin or [], resume, overwrite, plot, quiet=quiet or json, silent=json)
    except KeyboardInterrupt:
        where = f"; the trials so far are in {folder / 'state.npz'}: continue with --resume" if folder else ""
        complain(f"\nasrsim: interrupted{where}")
        raise typer.Exit(INTERRUPTED) from None
    if json:
        say_json(data)
    if not data["converged"] and data.get("outcome"):
        raise typer.Exit(1)


def _learn(
    plant: Plant, folder: Path, plugins: list[Path], resume: bool, overwrite: bool, plot: bool, *, quiet: bool, silent: bool
) -> dict[str, Any]:  # fmt: skip
    from asrsim.actuators.user import command_line
    from asrsim.cli.console import say
    from asrsim.learning.session import run_session, session_data

    def start(prepared: Prepared) -> None:
        for line in prepared.before:
            say(line, "yellow" if line.startswith("beyond") else "")
        _headings(prepared.problem)

    session = run_session(
        plant, folder, on_start=None if quiet else start, on_trial=None if quiet else _row, resume=resume, overwrite=overwrite,
        picture=plot,
    )  # fmt: skip
    data = {"ok": session.result.converged, "folder": str(folder), **session_data(session)}
    if not silent:
        say(session.result.reason, "green" if session.result.converged else "red")
        for text in filter(None, (session.reach, session.replaced)):
            say(text)
        say(f"wrote {folder}{os.sep}: {', '.join(sorted(path.name for path in folder.iterdir()))}")
        say(f"play what was learned: {command_line('run', folder / 'learned.yaml', plugins)}")
    return data


def _next(
    plant: Plant, folder: Path, recording: Path, mapping: tuple[str, ...] | Path | None, lag: LagChoice, *, silent: bool
) -> dict[str, Any]:
    from asrsim.cli.console import say, say_problems
    from asrsim.cli.recording_table import say_columns
    from asrsim.learning.hardware import NEXT, next_input
    from asrsim.learning.session import trial_data
    from asrsim.plain import finite_or_none

    step = next_input(plant, folder, recording, mapping=mapping, lag=lag)
    if not silent:
        say_columns(step.recording)
        say_problems(step.findings, "note")
        _headings(step.prepared.problem)
        for trial in step.trials:
            _row(trial)
        if step.twin is not None:
            left = f"{step.twin.residual:.2g} rad, {step.twin.before:.2g} before"
            say(f"masses, stiffnesses, losses and a delay were fitted to the recorded trials; what they do not explain: {left}")
        if step.warning:
            say(step.warning, "yellow")
        if step.outcome:
            say(step.outcome, "green" if step.converged else "red")
            say(f"wrote {folder / NEXT}, the best input")
        else:
            say(f"play {folder / NEXT} on the robot, record it, and give the recording to --next again")
    return {
        "ok": True, "folder": str(folder), "converged": step.converged, "outcome": step.outcome, "clock": step.clock,
        "findings": [problem.as_dict() for problem in step.findings],
        "foretold_ratio": finite_or_none(step.foretold), "warning": step.warning,
        "trial": trial_data(step.trials[-1], plant.joints),
    }  # fmt: skip


def _headings(problem: LearningProblem) -> None:
    """Print the heading above the trials."""
    from asrsim.cli.console import say

    say(f"largest error of each joint and largest 2-norm in {problem.unit}")
    _cells("trial", problem.joints, "2-norm", "s", style="bold")


def _row(trial: Trial) -> None:
    """Print the row of a trial."""
    largest = [f"{value:.4f}" for value in trial.largest]
    _cells(str(trial.number), largest, f"{trial.norm:.4f}", f"{trial.seconds:.2f}")


def _cells(number: str, largest: Any, norm: str, seconds: str, style: str = "") -> None:
    import sys

    from asrsim.cli.console import say

    say("  ".join(cell.rjust(8) for cell in (number, *largest, norm, seconds)), style)
    sys.stdout.flush()
