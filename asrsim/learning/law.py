"""The update of iterative learning control: paper equation 13 with derivative term, forgetting and zero-phase filter."""

from __future__ import annotations

import numpy as np

from asrsim.learning.settings import LearningSettings
from asrsim.samples import Array


def updated(inputs: Array, error: Array, first_guess: Array, update: int, settings: LearningSettings, step: float) -> Array:
    """Inputs of the next trial, (n, joints).

    u(n) = Q[(1 - f) u(n-1) + f u(0) + K(n) (e(n-1) + T de(n-1)/dt)], K(n) = K exp(-n / decay), n = `update` from 0.
    inputs, error, first_guess: (n, joints) in rad; step: s between samples.
    """
    gain = np.array(settings.gain_at(update))
    correction = error
    if settings.derivative:
        correction = error + settings.derivative * np.gradient(error, step, axis=0)
    # In this order, so that without the extras the numbers are those of equation 13 to the last bit.
    learned = inputs + gain * correction
    if settings.forgetting:
        learned = learned + settings.forgetting * (first_guess - inputs)
    if settings.filter_cutoff is not None:
        learned = zero_phase(learned, settings.filter_cutoff, settings.filter_order, step)
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
