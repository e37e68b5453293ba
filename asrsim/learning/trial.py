"""The problem of iterative learning control, its trials, and the loop: try, compare, correct, until the error is tolerated."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from asrsim.learning.state import load_state, save_state
from asrsim.samples import Array
from asrsim.scenario.learning_keys import Learning

Simulate = Callable[[Array], Array]
"""Inputs (n, joints) -> link positions (n, joints)."""
Outcome = Literal["converged", "growing", "stalled", "exhausted"]


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
    units: tuple[str, ...] = ()
    """Of each joint's position, `rad` or `m`; none: all `rad`. Elsewhere here `rad` stands for both."""
    identity: str = ""
    """Text that distinguishes plants: a saved state of another plant is refused."""
    origin: tuple[str, str] = ("", "")
    """Scenario file and variant, kept in the state."""

    @property
    def step(self) -> float:
        """s between samples."""
        return float(self.time[1] - self.time[0])

    @property
    def unit(self) -> str:
        """Of errors over all joints, for people."""
        return " or ".join(dict.fromkeys(self.units)) or "rad"

    def trial(self, number: int, inputs: Array, outputs: Array, seconds: float = 0.0) -> Trial:
        """The trial in which `inputs` gave `outputs`, (n, joints) each."""
        return Trial(number=number, inputs=inputs, outputs=outputs, error=self.reference - outputs, seconds=seconds)

    def worst(self, trial: Trial) -> str:
        """The largest error with its unit."""
        unit = self.units[int(np.argmax(trial.largest))] if self.units else "rad"
        return f"{trial.worst:.4g} {unit}"

    def worst_place(self, trial: Trial) -> str:
        """Joint and time of the largest error."""
        column = int(np.argmax(trial.largest))
        return f"{self.joints[column]} at {int(np.argmax(np.abs(trial.error[:, column]))) * self.step:.3g} s"


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One trial: number 0 is the first guess, number i follows i updates."""

    number: int
    inputs: Array = field(repr=False)
    """(n, joints) rad."""
    outputs: Array = field(repr=False)
    """(n, joints) rad."""
    error: Array = field(repr=False)
    """(n, joints) rad, desired less measured."""
    seconds: float = 0.0
    """Wall-clock time of the simulation."""

    @cached_property
    def largest(self) -> tuple[float, ...]:
        """rad, largest absolute error of each joint."""
        return tuple(np.abs(self.error).max(axis=0).tolist())

    @cached_property
    def rms(self) -> tuple[float, ...]:
        """rad, root mean square error of each joint."""
        return tuple(np.sqrt(np.mean(self.error**2, axis=0)).tolist())

    @cached_property
    def norm(self) -> float:
        """rad, largest 2-norm of the joints' error over time (paper figure 15)."""
        return float(np.linalg.norm(self.error, axis=1).max())

    @property
    def total(self) -> float:
        """rad, root mean square error over all joints and the whole time."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def worst(self) -> float:
        """rad, largest error of all joints."""
        return max(self.largest)


class Law(Protocol):
    """How learning goes on: a function of the trials so far, so that a resumed run goes on exactly where it was."""

    def propose(self, trials: Sequence[Trial]) -> Array:
        """(n, joints) rad, the next inputs."""

    def verdict(self, trials: Sequence[Trial], patience: int) -> tuple[Outcome, str] | None:
        """Why this law would give up after the last trial, or None to go on."""


@dataclass(frozen=True, kw_only=True)
class LearningResult:
    """What was learned, and how it went."""

    outcome: Outcome
    reason: str
    """Why it ended, a sentence for people."""
    trials: tuple[Trial, ...]

    @property
    def converged(self) -> bool:
        """Whether every joint came within the tolerance."""
        return self.outcome == "converged"

    @property
    def iterations(self) -> int:
        """Updates made: the number of the last trial."""
        return self.trials[-1].number

    @property
    def best(self) -> Trial:
        """The trial whose inputs are the result."""
        return best_of(self.trials)

    @property
    def inputs(self) -> Array:
        """(n, joints) rad, the learned inputs."""
        return self.best.inputs


def learn(
    problem: LearningProblem,
    simulate: Simulate,
    settings: Learning,
    on_trial: Callable[[Trial], None] | None = None,
    *,
    law: Law,
    state: Path | None = None,
    resume: bool = False,
) -> LearningResult:
    """Learn inputs whose outputs follow the reference.

    on_trial: receives each new trial as it ends. state: file that is replaced after each trial, in one move; with `resume` the
    learning goes on from it exactly, or begins if there is no file. Raises InputError if the state belongs to another problem,
    OutputError if it cannot be written.
    """
    trials: list[Trial] = []
    if resume and state is not None and state.exists():
        trials = load_state(state, problem, settings)
    outcome = verdict(problem, trials, settings, law) if trials else None
    while outcome is None:
        inputs = law.propose(trials) if trials else problem.first_guess
        started = clock.perf_counter()
        outputs = np.asarray(simulate(inputs), dtype=float)
        trials.append(problem.trial(len(trials), inputs, outputs, clock.perf_counter() - started))
        if state is not None:
            save_state(state, problem, settings, trials)
        if on_trial is not None:
            on_trial(trials[-1])
        outcome = verdict(problem, trials, settings, law)
    return LearningResult(outcome=outcome[0], reason=outcome[1], trials=tuple(trials))


def best_of(trials: Sequence[Trial]) -> Trial:
    """The trial with the least largest error; of equal ones the first."""
    return min(trials, key=lambda trial: trial.worst if np.isfinite(trial.worst) else np.inf)


def verdict(problem: LearningProblem, trials: Sequence[Trial], settings: Learning, law: Law) -> tuple[Outcome, str] | None:
    """Why to stop after the last trial, or None to go on."""
    last = trials[-1]
    if last.worst <= settings.tolerance:
        return "converged", (
            f"converged after {last.number} iterations: the largest error, {problem.worst(last)}, is within "
            f"{settings.tolerance:g} {problem.unit} in every joint"
        )
    given_up = law.verdict(trials, settings.patience)
    if given_up is not None:
        return given_up
    if last.number >= settings.max_iterations:
        best = best_of(trials)
        return "exhausted", (
            f"not converged after {last.number} iterations: {problem.worst_place(best)} is still {problem.worst(best)} off "
            f"in the best trial, number {best.number}; tolerance {settings.tolerance:g} {problem.unit}"
        )
    return None
