"""The loop of iterative learning control: try, compare, correct, until the error is within the tolerance."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from pathlib import Path

import numpy as np

from asrsim.learning.law import FixedGain
from asrsim.learning.state import fingerprint, load_state, save_state
from asrsim.learning.trial import (
    Law,
    LearningProblem,
    LearningResult,
    Outcome,
    Simulate,
    Trial,
    trial_of,
    worst,
    worst_place,
)  # fmt: skip
from asrsim.scenario.learning_keys import Learning


def learn(
    problem: LearningProblem,
    simulate: Simulate,
    settings: Learning,
    on_trial: Callable[[Trial], None] | None = None,
    *,
    law: Law | None = None,
    state: Path | None = None,
    resume: bool = False,
) -> LearningResult:
    """Learn inputs whose outputs follow the reference.

    on_trial: told of each new trial as it ends. law: how to go on (None: equation 13 without a model). state: file that is
    replaced after each trial, in one move; with `resume` the learning goes on from it exactly (or begins, if it is not
    there). Raises InputError if the state belongs to another problem, OutputError if it cannot be written.
    """
    law = law or FixedGain(problem, settings)
    digest = fingerprint(problem, settings)
    trials: list[Trial] = load_state(state, digest) if resume and state is not None and state.exists() else []
    outcome = verdict(problem, trials, settings, law) if trials else None
    while outcome is None:
        inputs = law.propose(trials) if trials else problem.first_guess
        started = clock.perf_counter()
        outputs = np.asarray(simulate(inputs), dtype=float)
        seconds = clock.perf_counter() - started
        trial = trial_of(problem, inputs, outputs, before=trials[-1] if trials else None, seconds=seconds)
        trials.append(trial)
        if state is not None:
            save_state(state, digest, trials, origin=problem.origin)
        if on_trial is not None:
            on_trial(trial)
        outcome = verdict(problem, trials, settings, law)
    name, reason = outcome
    return LearningResult(outcome=name, reason=reason, trials=tuple(trials), best=best_of(trials))


def best_of(trials: list[Trial]) -> int:
    """Number of the trial with the least largest error; of equal ones the first."""
    return min(range(len(trials)), key=lambda index: trials[index].worst if np.isfinite(trials[index].worst) else np.inf)


def verdict(problem: LearningProblem, trials: list[Trial], settings: Learning, law: Law) -> tuple[Outcome, str] | None:
    """Why to stop after the last trial, or None to go on."""
    last = trials[-1]
    if last.worst <= settings.tolerance:
        return "converged", (
            f"converged after {last.number} iterations: the largest error, {worst(problem, last)}, is within "
            f"{settings.tolerance:g} {problem.unit} in every joint"
        )
    given_up = law.verdict(trials, settings.patience)
    if given_up is not None:
        return given_up
    if last.number >= settings.max_iterations:
        best = trials[best_of(trials)]
        return "exhausted", (
            f"not converged after {last.number} iterations: {worst_place(problem, best)} is still {worst(problem, best)} off "
            f"in the best trial, number {best.number}; tolerance {settings.tolerance:g} {problem.unit}"
        )
    return None
