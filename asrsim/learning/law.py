"""The update of iterative learning control: paper equation 13 with a zero-phase filter."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from asrsim.learning.settings import gains_at
from asrsim.learning.trial import LearningProblem, Outcome, Trial, worst, worst_place
from asrsim.samples import Array
from asrsim.scenario.learning_keys import Learning

CREEP = 1.1
"""Growth of the error over the trials of `patience` below which learning goes on."""


class FixedGain:
    """Equation 13 and what the settings add to it."""

    def __init__(self, problem: LearningProblem, settings: Learning) -> None:
        self.problem = problem
        self.settings = settings

    def propose(self, trials: Sequence[Trial]) -> Array:
        """The last trial's input, corrected by its error."""
        last = trials[-1]
        return updated(self.problem, last.inputs, self.problem.reference - last.outputs, last.number, self.settings)

    def verdict(self, trials: Sequence[Trial], patience: int) -> tuple[Outcome, str] | None:
        """Gives up when a trial diverged, or the error has grown `patience` times in a row, by more than a creep."""
        last = trials[-1]
        if not np.isfinite(last.worst):
            return "growing", f"trial {last.number} has no finite error: the simulation diverged"
        run = [trial.worst for trial in trials[-patience - 1 :]]
        if len(run) <= patience or run[-1] < CREEP * run[0] or any(later <= earlier for earlier, later in pairwise(run)):
            return None
        helps = "law: auto goes on from the best trial"
        if self.settings.filter is None:
            helps += "; law: filtered learns only in the band in which errors shrink"
        return "growing", (
            f"stopped: the largest error has grown in {patience} iterations in a row, from {run[0]:.4g} to "
            f"{worst(self.problem, last)} (now {worst_place(self.problem, last)}); {helps}"
        )


def updated(problem: LearningProblem, inputs: Array, error: Array, update: int, settings: Learning) -> Array:
    """Inputs of the next trial, (n, joints): u(n) = Q[u(n-1) + K exp(-n / decay) e(n-1)], n = `update` from 0.

    inputs, error: (n, joints) in rad.
    """
    learned = inputs + np.array(gains_at(settings, problem.joints, update)) * error
    if settings.filter is not None:
        learned = zero_phase(learned, settings.filter.cutoff, settings.filter.order, problem.step)
    return learned


def zero_phase(values: Array, cutoff: float, order: int, step: float) -> Array:
    """`values` (n, joints) low-passed forwards and backwards, so without delay.

    cutoff: Hz, where the whole filter has half the amplitude (each pass -3 dB); order: of the Butterworth filter.
    A cutoff beyond the sampling's half filters nothing.
    """
    from scipy.signal import butter, sosfiltfilt

    if cutoff >= 0.5 / step:
        return values
    sections = butter(order, cutoff, fs=1.0 / step, output="sos")
    # Long enough for the filter to forget its start; the odd extension keeps the ends where they are.
    padding = min(len(values) - 1, int(3.0 / (cutoff * step)))
    return np.asarray(sosfiltfilt(sections, values, axis=0, padlen=padding), dtype=float)
