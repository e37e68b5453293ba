"""What learning is about, as data: the problem, a trial, the result, and a law."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from asrsim.samples import Array

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
    """Text that tells one plant from another: a resumed state of another plant is refused."""
    origin: tuple[str, str] = ("", "")
    """Scenario file and variant that it comes from: kept in the state."""

    @property
    def step(self) -> float:
        """s between samples."""
        return float(self.time[1] - self.time[0])

    @property
    def unit(self) -> str:
        """Of errors over all joints, for people."""
        return " or ".join(dict.fromkeys(self.units)) or "rad"


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One trial: number 0 is the first guess, number i follows i updates."""

    number: int
    largest: tuple[float, ...]
    """rad, largest absolute error of each joint."""
    norm: float
    """rad, largest 2-norm of the joints' error over time (paper figure 15)."""
    rms: tuple[float, ...]
    """rad, root mean square error of each joint."""
    seconds: float
    """Wall-clock time of the simulation."""
    ratio: float | None = None
    """Measured: `norm` over the trial's before; None for the first."""
    inputs: Array = field(repr=False)
    """(n, joints) rad."""
    outputs: Array = field(repr=False)
    """(n, joints) rad."""

    @property
    def total(self) -> float:
        """rad, root mean square error over all joints and the whole time."""
        return float(np.sqrt(np.mean(np.square(self.rms))))

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
    best: int
    """Number of the trial whose inputs are the result: the one with the least error."""

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

    @property
    def best_trial(self) -> Trial:
        """The trial whose inputs are the result."""
        return self.trials[self.best]


def trial_of(
    problem: LearningProblem,
    inputs: Array,
    outputs: Array,
    *,
    before: Trial | None,
    seconds: float = 0.0,
) -> Trial:
    """The trial in which `inputs` gave `outputs`, (n, joints) each."""
    error = problem.reference - outputs
    norm = float(np.linalg.norm(error, axis=1).max())
    return Trial(
        number=0 if before is None else before.number + 1,
        largest=tuple(float(value) for value in np.abs(error).max(axis=0)),
        norm=norm,
        rms=tuple(float(value) for value in np.sqrt(np.mean(error**2, axis=0))),
        seconds=seconds,
        ratio=None if before is None or before.norm == 0.0 else norm / before.norm,
        inputs=inputs,
        outputs=outputs,
    )


def worst(problem: LearningProblem, trial: Trial) -> str:
    """The largest error with its unit."""
    unit = problem.units[int(np.argmax(trial.largest))] if problem.units else "rad"
    return f"{trial.worst:.4g} {unit}"


def worst_place(problem: LearningProblem, trial: Trial) -> str:
    """Joint and time of the largest error."""
    column = int(np.argmax(trial.largest))
    error = np.abs(problem.reference - trial.outputs)[:, column]
    return f"{problem.joints[column]} at {int(np.argmax(error)) * problem.step:.3g} s"
