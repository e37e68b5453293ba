"""Iterative learning control: problem, trials, learning law with fixed gains (equation 13 of the paper, with a zero-phase
filter), and loop. The loop simulates a trial, compares it with the desired motion, and corrects the inputs. It ends when the
errors are within the tolerance, or when the law or the settings stop it.
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
"""Learning continues although the error grows, as long as the last error is below this multiple of the error `patience` trials
before.
"""
Outcome = Literal["converged", "growing", "stalled", "exhausted", "interrupted"]


@dataclass(frozen=True, kw_only=True)
class LearningProblem:
    """A desired motion to learn, and the inputs of the first trial."""

    joints: tuple[str, ...]
    time: Array
    """Equidistant times (n,), s."""
    reference: Array
    """Desired link positions (n, joints), rad."""
    first_guess: Array
    """Inputs (n, joints) of trial 0, rad."""
    units: tuple[str, ...] = ()
    """Unit of each joint's position, `rad` or `m`; empty: `rad` for all joints. For a prismatic joint, read `m` instead of
    `rad` in the other docstrings of this module.
    """

    @property
    def step(self) -> float:
        """Sampling interval, s."""
        return float(self.time[1] - self.time[0])

    @property
    def unit(self) -> str:
        """Unit of the joints' errors, as text."""
        return " or ".join(dict.fromkeys(self.units)) or "rad"

    def trial(self, number: int, inputs: Array, outputs: Array, seconds: float = 0.0) -> Trial:
        """Trial with given inputs and outputs, (n, joints) each."""
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
    """A trial. The input of trial 0 is the first guess. The input of trial i is the result of i updates."""

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
        """Largest 2-norm over time of the vector of the joints' errors, rad (figure 15 of the paper)."""
        return float(np.linalg.norm(self.error, axis=1).max())

    @property
    def total(self) -> float:
        """Root mean square of the errors of all joints over the whole time, rad."""
        return root_mean_square(self.error)

    @property
    def worst(self) -> float:
        """Largest error of all joints, rad."""
        return max(self.largest)


class LearningLaw(Protocol):
    """A learning law. Its updates depend only on the trials so far, so that a resumed run gives the same trials as an
    uninterrupted run.
    """

    def propose(self, trials: Sequence[Trial]) -> Array:
        """Next inputs (n, joints), rad."""

    def verdict(self, trials: Sequence[Trial], patience: int) -> tuple[Outcome, str] | None:
        """Outcome and reason if the law ends learning after the last trial; None to continue."""


@dataclass(frozen=True)
class FixedGain:
    """Learning law of equation 13 of the paper, with the filter and the gains of the settings."""

    problem: LearningProblem
    settings: Learning

    def propose(self, trials: Sequence[Trial]) -> Array:
        """Input u(n+1) = Q[u(n) + K exp(-n / gain_decay) e(n)]: the input of the last trial n, corrected by the error of this
        trial.
        """
        last, settings = trials[-1], self.settings
        fading = 1.0 if settings.gain_decay is None else exp(-last.number / settings.gain_decay)
        gains = [settings.joint_gains.get(joint, settings.gain) * fading for joint in self.problem.joints]
        learned = last.inputs + np.array(gains) * last.error
        if settings.filter is not None:
            learned = zero_phase(learned, settings.filter.cutoff, settings.filter.order, self.problem.step)
        return learned

    def verdict(self, trials: Sequence[Trial], patience: int) -> tuple[Outcome, str] | None:
        """Outcome and reason if the last trial diverged, or if the error grew `patience` times in a row and beyond `CREEP`;
        None to continue.
        """
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
    """Values (n, joints) after a low-pass filter, which runs forwards and then backwards so that it causes no delay.

    cutoff: frequency at which the two passes together halve the amplitude (-3 dB in each pass), Hz; order: order of the
    Butterworth filter; step: sampling interval, s. A cutoff of half the sampling rate or more has no effect.
    """
    from scipy.signal import butter, sosfiltfilt

    if cutoff >= 0.5 / step:
        return values
    sections = butter(order, cutoff, fs=1.0 / step, output="sos")
    # The padding is so long that the transient of the filter decays. It is an odd extension, so that the end values are kept.
    padding = min(len(values) - 1, int(3.0 / (cutoff * step)))
    return np.asarray(sosfiltfilt(sections, values, axis=0, padlen=padding), dtype=float)


@dataclass(frozen=True, kw_only=True)
class LearningResult:
    """Result of learning."""

    outcome: Outcome
    reason: str
    """Sentence with the reason why learning ended."""
    trials: tuple[Trial, ...]

    @property
    def converged(self) -> bool:
        """Whether the errors of all joints are within the tolerance."""
        return self.outcome == "converged"

    @property
    def iterations(self) -> int:
        """Number of updates. It is equal to the number of the last trial."""
        return self.trials[-1].number

    @property
    def best(self) -> Trial:
        """Trial with the smallest error. Its inputs are the result."""
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
    """Learn the inputs with which the outputs follow the reference, and return the result.

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
    """Trial whose largest error is smallest. If several trials have the same largest error, it is the first of them."""
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
