"""Frequency response of a periodic excitation from its whole periods, without leakage or smoothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from asrsim.metrics.spectra import Spectra
from asrsim.samples import Array

_POOLED = 12
"""Smallest number of complex degrees of freedom of a variance, pooled over neighbouring lines."""
_SPARSE = 6
"""Distance of the lines in bins from which two periods suffice: other estimators cannot use such sparse lines."""
_ROUNDING = 1e-11
"""Relative difference of two periods below which they count as equal."""
_AS_GOOD = 2.0
"""The first periods count as a transient if omitting them reduces the error by this factor."""


def by_periods(u: Array, y: Array, step: float, period: int, lines: NDArray[np.intp]) -> Spectra | None:
    """Response at the harmonics `lines` of a period (samples), from the last whole periods of the record.

    The first periods, in which the output has not settled, are omitted; their number minimises the error of the mean. The
    deviation follows from the spread between periods. None: fewer than three periods, or fewer than two settled periods for
    sparse lines.
    """
    count = len(u) // period
    if count < 2 or not len(lines) or (count == 2 and count * np.min(np.diff(lines, prepend=0)) < _SPARSE):
        return None
    start = len(u) - count * period
    transforms = [np.fft.rfft(series[start:].reshape(count, period), axis=1)[:, lines] for series in (u, y)]
    errors = np.array([_error(transforms[1][first:]) for first in range(count - 1)])
    rounding = _ROUNDING**2 * float(np.sum(np.abs(transforms[1]) ** 2)) / count
    first = int(np.flatnonzero(errors <= _AS_GOOD * max(float(errors.min()), rounding))[0])
    if count == 2 and _settles(y[start:], period):
        return None
    input_, output = (values[first:] for values in transforms)
    mean = input_.mean(axis=0)
    response = output.mean(axis=0) / mean
    used = len(input_)
    spread = np.sum(np.abs(output - response * input_) ** 2, axis=0)
    # Neighbouring lines have similar noise: pool them.
    width = min(len(lines), 2 * (_POOLED // (2 * (used - 1))) + 1)
    around = np.clip(np.arange(len(lines)) - width // 2, 0, len(lines) - width)[:, None] + np.arange(width)
    freedom = width * (used - 1)
    variance = spread[around].sum(axis=1) / freedom / used / np.abs(mean) ** 2
    relative = variance / np.maximum(np.abs(response) ** 2, 1e-300)
    return Spectra(
        frequency=lines / (period * step), response=response, coherence=1 / (1 + used * relative), deviation=np.sqrt(relative),
        freedom=float(freedom), averages=float(used), resolution=1 / (period * step),
    )  # fmt: skip


def _error(values: NDArray[np.complex128]) -> float:
    """Squared error of the mean over the rows of (m, lines), summed over the lines."""
    rows = len(values)
    return float(np.sum(np.abs(values - values.mean(axis=0)) ** 2)) / (rows * (rows - 1))


def _settles(y: Array, period: int) -> bool:
    """Whether the output settles: the first of two periods differs from the second more at its beginning than at its end."""
    apart = (y[period:] - y[:period]) ** 2
    half = period // 2
    return float(np.sum(apart[:half])) > 1.5 * float(np.sum(apart[half:]))
