"""Problem of iterative learning control, its trials, the law with fixed gains (paper equation 13 with a zero-phase filter), and
the loop that simulates a trial, compares it with the desired motion and corrects the inputs until the errors are tolerable.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from math import exp
from typing import Literal, Protocol

import numpy as np

from asrsim.metrics.values import root_mean_square, root_mean_squares
from asrsim.progress import Stop, never
from asrsim.quantities import shown
from asrsim.samples import Array
from asrsim.scenario.goals import Learning

Simulate = Callable[[Array], Array]
"""Function from inputs (n, joints) to link positions (n, joints)."""
CREEP = 1.1
"""Ratio of the last error to the error `patience` trials before, below which learning continues, although the error grows."""
Outcome = Literal["converged", "growing", "stalled", "exhausted", "interrupted"]


@dataclass(frozen=True, kw_only=True)
class LearningProblem:
    """A desired motion that is to be learned, with the inputs of the first trial."""

    joints: tuple[str, ...]
    time: Array
    """Equidistant times (n,), s."""
    reference: Array
    """Desired link positions (n, joints), rad."""
    first_guess: Array
    """Inputs (n, joints) of trial 0, rad."""
    units: tuple[str, ...] = ()
    """Unit of each joint's position, `rad` or `m`; empty: `rad` for all joints. Other docstrings of this module write `rad`
    also where the unit of a prismatic joint is `m`.
    """

    @property
    def step(self) -> float:
        """Sampling interval, s."""
        return float(self.time[1] - self.time[0])

    @property
    def unit(self) -> str:
        """Unit of errors of all joints, as text."""
        return " or ".join(dict.fromkeys(self.units)) or "rad"

    def trial(self, number: int, inputs: Array, outputs: Array, seconds: float = 0.0) -> Trial:
        """Trial with inputs and outputs (n, joints)."""
        return Trial(number=number, inputs=inputs, outputs=outputs, error=self.reference - outputs, seconds=seconds)

    def worst(self, trial: Trial) -> str:
        """Largest error of a trial with its unit, as text."""
        unit = self.units[int(np.argmax(trial.largest))] if self.units else "rad"
        return shown(trial.worst, unit, 4)

    def worst_place(self, trial: Trial) -> str:
        """Joint and time of the largest error, as text."""
        column = int(np.argmax(trial.largest))
        return f"{self.joints[column]} at {int(np.argmax(np.abs(trial.error[:, column]))) * self.step:.3g} s"


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A trial. The input of trial 0 is the first guess; the input of trial i is the result of i updates."""

    number: int
    inputs: Array = field(repr=False)
    """Inputs (n, joints), rad."""
    outputs: Array = field(repr=False)
    """Link positions (n, joints), rad."""
    error: Array = field(repr=False)
    """Desired minus measured positions (n, joints), rad."""
    seconds: float = 0.0
    """Wall-clock time of the simulation, s."""

    @cached_property
    def largest(self) -> tuple[float, ...]:
        """Largest absolute error of each joint, rad."""
        return tuple(np.abs(self.error).max(axis=0).tolist())

    @cached_property
    def rms(self) -> tuple[float, ...]:
        """Root mean square error of each joint, rad."""
        return tuple(root_mean_squares(self.error).tolist())

    @cached_property
    def norm(self) -> float:
        """Largest 2-norm of the joints' errors over time, rad (paper figure 15)."""
        return float(np.linalg.norm(self.error, axis=1).max())

    @property
    def total(self) -> float:
        """Root mean square error over all joints and the whole time, rad."""
        return root_mean_square(self.error)

    @property
    def worst(self) -> float:
        """Largest error of all joints, rad."""
        return max(self.largest)


class LearningLaw(Protocol):
    """A learning law. Its updates depend only on the trials so far, so a resumed run gives the same trials as an uninterrupted
    one.
    """

    def propose(self, trials: Sequence[Trial]) -> Array:
        """Next inputs (n, joints), rad."""

    def verdict(self, trials: Sequence[Trial], patience: int) -> tuple[Outcome, str] | None:
        """Outcome and reason if this law ends learning after the last trial; None to continue."""


@dataclass(frozen=True)
class FixedGain:
    """Learning law of equation 13, with the filter and the gains of the settings."""

    problem: LearningProblem
    settings: Learning

    def propose(self, trials: Sequence[Trial]) -> Array:
        """Input u(n) = Q[u(n-1) + K exp(-n / gain_decay) e(n-1)], n from 0: the input of the last trial, corrected by the error
        of this trial.
        """
        last, settings = trials[-1], self.settings
        fading = 1.0 if settings.gain_decay is None else exp(-last.number / settings.gain_decay)
        gains = [settings.joint_gains.get(joint, settings.gain) * fading for joint in self.problem.joints]
        learned = last.inputs + np.array(gains) * last.error
        if settings.filter is not None:
            learned = zero_phase(learned, settings.filter.cutoff, settings.filter.order, self.problem.step)
        return learned

    def verdict(self, trials: Sequence[Trial], patience: int) -> tuple[Outcome, str] | None:
        """Reason to stop if a trial diverged or the error grew `patience` times in a row, beyond `CREEP`; None to continue."""
        last = trials[-1]
        if not np.isfinite(last.worst):
            return "growing", f"trial {last.number} has no finite error: the simulation diverged"
        run = [trial.worst for trial in trials[-patience - 1 :]]
        if len(run) <= patience or run[-1] < CREEP * run[0] or any(later <= earlier for earlier, later in pairwise(run)):
            return None
        return "growing", (
            f"stopped: the largest error has grown in {patience} iterations in a row, from {run[0]:.4g} to "
            f"{self.problem.worst(last)} (now {self.problem.worst_place(last)}); law: auto continues from the best trial"
        )


def zero_phase(values: Array, cutoff: float, order: int, step: float) -> Array:
    """Values (n, joints) after a low-pass filter forwards and backwards, which causes no delay.

    cutoff: frequency at which the whole filter halves the amplitude (each pass: -3 dB), Hz. order: order of the Butterworth
    filter. A cutoff above half the sampling rate has no effect.
    """
    from scipy.signal import butter, sosfiltfilt

    if cutoff >= 0.5 / step:
        return values
    sections = butter(order, cutoff, fs=1.0 / step, output="sos")
    # The padding is long enough for the filter's transient to decay; the odd extension keeps the end values.
    padding = min(len(values) - 1, int(3.0 / (cutoff * step)))
    return np.asarray(sosfiltfilt(sections, values, axis=0, padlen=padding), dtype=float)


@dataclass(frozen=True, kw_only=True)
class LearningResult:
    """Result of learning."""

    outcome: Outcome
    reason: str
    """Sentence that says why learning ended."""
    trials: tuple[Trial, ...]

    @property
    def converged(self) -> bool:
        """Whether the errors of all joints are within the tolerance."""
        return self.outcome == "converged"

    @property
    def iterations(self) -> int:
        """Number of updates, which is the number of the last trial."""
        return self.trials[-1].number

    @property
    def best(self) -> Trial:
        """Trial with the smallest error, whose inputs are the result."""
        return best_of(self.trials)

    @property
    def inputs(self) -> Array:
        """Learned inputs (n, joints), rad."""
        return self.best.inputs


def iterate(
    problem: LearningProblem,
    simulate: Simulate,
    settings: Learning,
    on_trial: Callable[[Trial], None] | None = None,
    *,
    law: LearningLaw,
    finished: Sequence[Trial] = (),
    stop: Stop = never,
) -> LearningResult:
    """Learn the inputs whose outputs follow the reference, and return the result.

    on_trial: receives each new trial. finished: trials of an interrupted run, which this run continues. stop: called after each
    new trial; True ends learning.
    """
    trials = list(finished)
    outcome = verdict(problem, trials, settings, law) if trials else None
    while outcome is None:
        inputs = law.propose(trials) if trials else problem.first_guess
        started = clock.perf_counter()
        outputs = np.asarray(simulate(inputs), dtype=float)
        trials.append(problem.trial(len(trials), inputs, outputs, clock.perf_counter() - started))
        if on_trial is not None:
            on_trial(trials[-1])
        outcome = verdict(problem, trials, settings, law)
        if outcome is None and stop():
            best = best_of(trials)
            error = f"the largest error of the best trial, number {best.number}, is {problem.worst(best)}"
            outcome = "interrupted", f"interrupted; {error}"
    return LearningResult(outcome=outcome[0], reason=outcome[1], trials=tuple(trials))


def best_of(trials: Sequence[Trial]) -> Trial:
    """Trial whose largest error is smallest; if several trials have equal errors, the first of these trials."""
    return min(trials, key=lambda trial: trial.worst if np.isfinite(trial.worst) else np.inf)


def verdict(
    problem: LearningProblem, trials: Sequence[Trial], settings: Learning, law: LearningLaw
) -> tuple[Outcome, str] | None:
    """Outcome and reason if learning stops after the last trial; None to continue."""
    last = trials[-1]
    if last.worst <= settings.tolerance:
        return "converged", (
            f"converged after {last.number} iterations: the largest error, {problem.worst(last)}, is within "
            f"{shown(settings.tolerance, problem.unit, 6)} in every joint"
        )
    given_up = law.verdict(trials, settings.patience)
    if given_up is not None:
        return given_up
    if last.number >= settings.max_iterations:
        best = best_of(trials)
        return "exhausted", (
            f"not converged after {last.number} iterations: the largest error of the best trial, number {best.number}, is "
            f"{problem.worst(best)} ({problem.worst_place(best)}); tolerance {shown(settings.tolerance, problem.unit, 6)}"
        )
    return None
