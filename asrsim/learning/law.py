"""The update of iterative learning control: paper equation 13 with a zero-phase filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import exp

import numpy as np

from asrsim.learning.trial import LearningProblem, Outcome, Trial
from asrsim.samples import Array
from asrsim.scenario.blocks import Learning

CREEP = 1.1
"""Relative growth of the error over `patience` trials below which learning continues."""


@dataclass(frozen=True)
class FixedGain:
    """Learning law of equation 13, with the filter and the gains of the settings."""

    problem: LearningProblem
    settings: Learning

    def propose(self, trials: Sequence[Trial]) -> Array:
        """Input u(n) = Q[u(n-1) + K exp(-n / gain_decay) e(n-1)], n from 0: the last trial's input, corrected by its error."""
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
