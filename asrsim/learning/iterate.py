"""The loop of iterative learning control: try, compare, correct, until the error is within the tolerance."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from asrsim.learning.law import updated
from asrsim.learning.settings import LearningSettings
from asrsim.learning.state import fingerprint, load_state, save_state
from asrsim.samples import Array

Simulate = Callable[[Array], Array]
"""Inputs (n, joints) -> link positions (n, joints), or (plants, n, joints) when several plants are tried at once."""
Predict = Callable[[Array, Array, Array], float]
"""Inputs, mean outputs, next inputs -> predicted ratio of the next 2-norm error to the present one."""
Outcome = Literal["converged", "growing", "exhausted"]


@dataclass(frozen=True, kw_only=True)
class LearningProblem:
    """What is to be learned."""

    joints: tuple[str, ...]
    time: Array
    """(n,) s, equidistant."""
    reference: Array
    """(n, joints) rad, the desired link positions."""
    first_guess: Array
    """(n, joints) rad, inputs of trial 0."""
    identity: str = ""
    """Text that tells one plant from another: a resumed state of another plant is refused."""
    origin: str = ""
    """Where the problem comes from, for people: kept in the state."""

    @property
    def step(self) -> float:
        """s between samples."""
        return float(self.time[1] - self.time[0])


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One trial: number 0 is the first guess, number i follows i updates."""

    number: int
    largest: tuple[float, ...]
    """rad, largest absolute error of each joint (over all plants)."""
    norm: float
    """rad, largest 2-norm of the joints' error over time (paper figure 15)."""
    rms: tuple[float, ...]
    """rad, root mean square error of each joint (over all plants)."""
    seconds: float
    """Wall-clock time of the simulation."""
    ratio: float | None = None
    """Measured: `norm` over the trial's before; None for the first."""
    predicted: float | None = None
    """The same ratio as the model predicted it before the trial; None without a model."""
    inputs: Array = field(repr=False)
    """(n, joints) rad."""
    outputs: Array = field(repr=False)
    """(n, joints) rad, mean over the plants."""


@dataclass(frozen=True, kw_only=True)
class LearningResult:
    """What was learned, and how it went."""

    outcome: Outcome
    reason: str
    """Why it ended, a sentence for people."""
    trials: tuple[Trial, ...]
    best: int
    """Number of the trial whose inputs are the result: the last one if converged, else the one with the least error."""

    @property
    def converged(self) -> bool:
        """Whether every joint came within the tolerance."""
        return self.outcome == "converged"

    @property
    def iterations(self) -> int:
        """Updates made: the number of the last trial."""
        return self.trials[-1].number

    @property
    def inputs(self) -> Array:
        """(n, joints) rad, the learned inputs."""
        return self.trials[self.best].inputs


def learn(
    problem: LearningProblem,
    simulate: Simulate,
    settings: LearningSettings,
    on_trial: Callable[[Trial], None] | None = None,
    *,
    predict: Predict | None = None,
    state: Path | None = None,
    resume: bool = False,
) -> LearningResult:
    """Learn inputs whose outputs follow the reference.

    on_trial: told of each new trial as it ends. predict: a model's guess at each trial's error. state: file that is
    replaced after each trial, in one move; with `resume` the learning goes on from it exactly (or begins, if it is not
    there). Raises InputError if the state belongs to another problem, OutputError if it cannot be written.
    """
    mark = fingerprint(problem, settings)
    trials: list[Trial] = load_state(state, mark) if resume and state is not None and state.exists() else []
    if trials:
        outcome = _verdict(problem, trials, settings)
        inputs, predicted = _next(problem, trials[-1], settings, predict)
    else:
        outcome = None
        inputs, predicted = problem.first_guess, None
    while outcome is None:
        trial = _try(problem, simulate, inputs, trials[-1] if trials else None, predicted)
        trials.append(trial)
        if state is not None:
            save_state(state, mark, trials, origin=problem.origin)
        if on_trial is not None:
            on_trial(trial)
        outcome = _verdict(problem, trials, settings)
        if outcome is None:
            inputs, predicted = _next(problem, trial, settings, predict)
    name, reason = outcome
    best = len(trials) - 1 if name == "converged" else min(range(len(trials)), key=lambda index: max(trials[index].largest))
    return LearningResult(outcome=name, reason=reason, trials=tuple(trials), best=best)


def _try(problem: LearningProblem, simulate: Simulate, inputs: Array, before: Trial | None, predicted: float | None) -> Trial:
    started = clock.perf_counter()
    outputs = np.asarray(simulate(inputs), dtype=float)
    seconds = clock.perf_counter() - started
    error = problem.reference - outputs.reshape(-1, *problem.reference.shape)
    norm = float(np.linalg.norm(error, axis=2).max())
    return Trial(
        number=0 if before is None else before.number + 1,
        largest=tuple(float(value) for value in np.abs(error).max(axis=(0, 1))),
        norm=norm,
        rms=tuple(float(value) for value in np.sqrt(np.mean(error**2, axis=(0, 1)))),
        seconds=seconds,
        ratio=None if before is None or before.norm == 0.0 else norm / before.norm,
        predicted=predicted,
        inputs=inputs,
        outputs=problem.reference - error.mean(axis=0) if len(error) > 1 else outputs.reshape(problem.reference.shape),
    )


def _next(
    problem: LearningProblem, trial: Trial, settings: LearningSettings, predict: Predict | None
) -> tuple[Array, float | None]:
    """Inputs of the next trial and what the model expects of it."""
    error = problem.reference - trial.outputs
    inputs = updated(trial.inputs, error, problem.first_guess, trial.number, settings, problem.step)
    return inputs, None if predict is None else predict(trial.inputs, trial.outputs, inputs)


def _verdict(problem: LearningProblem, trials: list[Trial], settings: LearningSettings) -> tuple[Outcome, str] | None:
    """Why to stop after the last trial, or None to go on."""
    last = trials[-1]
    if not all(np.isfinite(last.largest)):
        return "growing", f"trial {last.number} has no finite error: the simulation diverged"
    if max(last.largest) <= settings.tolerance:
        return "converged", (
            f"converged after {last.number} iterations: the largest error, {max(last.largest):.4g} rad, is within "
            f"{settings.tolerance:g} rad in every joint"
        )
    run = trials[-settings.patience - 1 :]
    worst = [max(trial.largest) for trial in run]
    joint, when = problem.joints[int(np.argmax(last.largest))], _worst_time(problem, last)
    if len(run) > settings.patience and all(later > earlier for earlier, later in pairwise(worst)):
        return "growing", (
            f"stopped: the largest error has grown in {settings.patience} iterations in a row, from {worst[0]:.4g} to "
            f"{worst[-1]:.4g} rad (now in {joint} {when}); a smaller gain, a lower cutoff or less derivative helps"
        )
    if last.number >= settings.max_iterations:
        return "exhausted", (
            f"not converged after {last.number} iterations: {joint} is still {max(last.largest):.4g} rad off {when}, "
            f"tolerance {settings.tolerance:g} rad"
        )
    return None


def _worst_time(problem: LearningProblem, trial: Trial) -> str:
    """When the joint with the largest error is off most; of several plants, their mean."""
    error = np.abs(problem.reference - trial.outputs)[:, int(np.argmax(trial.largest))]
    return f"at {int(np.argmax(error)) * problem.step:.3g} s"
