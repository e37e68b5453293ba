"""`asrsim ilc`: iterative learning control of a scenario, with a live table and resumption, and on the real robot."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from asrsim.cli.command import Done, command
from asrsim.cli.console import say, say_columns, say_problems
from asrsim.cli.interrupt import INTERRUPTED, Interruption
from asrsim.cli.options import Align, ColumnMap, Overrides, Overwrite, Plot, Scenario, Variant, into_folder, lag_of, option

if TYPE_CHECKING:
    from asrsim.learning.plant import Plant
    from asrsim.learning.prepared import PreparedLearning
    from asrsim.learning.trial import LearningProblem, Trial
    from asrsim.recordings.align import LagChoice
    from asrsim.simulation.examine import Plan


@command("Print only the result.")
def ilc(
    scenario: Scenario,
    variant: Variant = None,
    overrides: Overrides = None,
    out: Annotated[Path | None, into_folder("Folder for the results.", "out/<scenario>/ilc")] = None,
    recording: Annotated[
        Path | None,
        option(
            "Learn on the real robot: compute the next input (next.csv) from this recorded trial.",
            "--experiment",
            "-e",
            metavar="RECORDING",
        ),
    ] = None,
    mapping: ColumnMap = None,
    align: Align = "off",
    resume: Annotated[bool, option("Continue interrupted learning in simulation exactly.", "--resume")] = False,
    overwrite: Overwrite = False,
    plot: Plot = True,
    *,
    plugin: list[Path],
    quiet: bool,
) -> Done:
    """Learn the inputs that make the joints follow `ilc.trajectory` of a scenario, trial by trial (paper section 4.3).

    The command writes the learned inputs (learned.csv), a scenario that plays them (learned.yaml), the results (ilc.json), a
    picture (ilc.png), and the trials (state.npz). Files of an earlier run of the same scenario are replaced, with a message;
    files of another scenario are kept unless --overwrite is given. Ctrl-C keeps the best trial so far; --resume continues. Exit
    code: 0; 1 if learning did not converge or a run failed; 130 after Ctrl-C.

    Example: asrsim ilc examples/scenarios/ilc_2dof.yaml

    Example: asrsim ilc examples/scenarios/ilc_2dof.yaml --set ilc.law=auto

    Example: asrsim ilc examples/scenarios/ilc_2dof.yaml --set ilc.law=auto --resume
    """
    from asrsim.learning.plant import make_plant
    from asrsim.simulation.examine import examine

    plan = examine(scenario, variant=variant, overrides=overrides or [], plugins=plugin)
    folder = out or Path("out") / plan.scenario.name / "ilc"
    if recording is not None:
        return _next(make_plant(plan), folder, recording, mapping, lag_of(align))
    return _learn(plan, folder, plugin, resume, overwrite, plot, quiet=quiet)


def _learn(plan: Plan, folder: Path, plugins: list[Path], resume: bool, overwrite: bool, plot: bool, *, quiet: bool) -> Done:
    from asrsim.learning.session import learn, session_data
    from asrsim.plugins import command_line

    def start(prepared: PreparedLearning) -> None:
        for line in prepared.before:
            say(line, "yellow" if line.startswith("beyond") else "")
        _headings(prepared.problem)

    with Interruption(
        "asrsim: stopping; the best trial so far is kept, and --resume continues (Ctrl-C again to abort)"
    ) as interruption:
        session = learn(
            plan,
            folder,
            on_start=None if quiet else start,
            on_trial=None if quiet else _row,
            stop=interruption.stop,
            resume=resume,
            overwrite=overwrite,
            picture=plot,
        )
    good = session.result.converged
    code = INTERRUPTED if session.result.outcome == "interrupted" else int(not good)

    def text() -> None:
        say(session.result.reason, "green" if good else "red")
        for line in filter(None, (session.reach, session.replaced)):
            say(line)
        say(f"wrote {folder}{os.sep}: {', '.join(sorted(path.name for path in folder.iterdir()))}")
        say(f"play the learned inputs: {command_line('run', folder / 'learned.yaml', plugins)}")

    return Done(data={"ok": good, "folder": str(folder), **session_data(session)}, always=text, code=code)


def _next(plant: Plant, folder: Path, recording: Path, mapping: list[str] | None, lag: LagChoice) -> Done:
    from asrsim.learning.hardware import NEXT, next_input
    from asrsim.learning.session import trial_data
    from asrsim.plain import finite_or_none

    step = next_input(plant, folder, recording, mapping=mapping, lag=lag)

    def text() -> None:
        say_columns(step.recording)
        say_problems(step.findings, "note")
        _headings(step.prepared.problem)
        for trial in step.trials:
            _row(trial)
        if step.twin is not None:
            left = f"{step.twin.residual:.2g} rad, {step.twin.before:.2g} before"
            say(f"masses, stiffnesses, losses and a delay were fitted to the recorded trials; remaining error: {left}")
        if step.warning:
            say(step.warning, "yellow")
        if step.outcome:
            say(step.outcome, "green" if step.converged else "red")
            say(f"wrote {folder / NEXT}, the best input")
        else:
            say(f"play {folder / NEXT} on the robot, record it, and give the new recording to --experiment")

    data = {
        "ok": True,
        "folder": str(folder),
        "converged": step.converged,
        "outcome": step.outcome,
        "clock": step.clock,
        "findings": step.findings,
        "foretold_ratio": finite_or_none(step.foretold),
        "warning": step.warning,
        "trial": trial_data(step.trials[-1], plant.joints),
    }
    return Done(data=data, always=text, code=int(bool(step.outcome) and not step.converged))


def _headings(problem: LearningProblem) -> None:
    """Print the heading above the trials."""
    say(f"largest error of each joint, and largest 2-norm of the errors of all joints, in {problem.unit}")
    _cells("trial", problem.joints, "2-norm", "s", style="bold")


def _row(trial: Trial) -> None:
    """Print the row of a trial in the table."""
    largest = [f"{value:.4f}" for value in trial.largest]
    _cells(str(trial.number), largest, f"{trial.norm:.4f}", f"{trial.seconds:.2f}")


def _cells(number: str, largest: Any, norm: str, seconds: str, style: str = "") -> None:
    say("  ".join(cell.rjust(8) for cell in (number, *largest, norm, seconds)), style)
    sys.stdout.flush()
