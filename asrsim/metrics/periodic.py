"""The frequency response of a periodic excitation, by its whole periods: neither leakage nor smoothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from asrsim.metrics.spectra import Spectra
from asrsim.samples import Array

_POOLED = 12
"""Complex degrees of freedom that a variance has at least, with those of neighbouring lines."""
_SPARSE = 6
"""Bins of the record between lines from which on two periods do: nothing else can be done with such lines."""
_ROUNDING = 1e-11
"""Share of the output below which periods do not differ."""
_AS_GOOD = 2.0
"""Error without a period over that with it, from which on the first periods count as a transient."""


def by_periods(u: Array, y: Array, step: float, period: int, lines: NDArray[np.intp]) -> Spectra | None:
    """Response at the harmonics `lines` of a period (samples), from the last whole periods of the record.

    The first periods, in which the output has not settled, are left out: as many as lessen the error of the mean of the
    others. The spread from period to period gives the deviation. None: fewer than three periods, or of sparse lines than two
    settled ones.
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
    # Noise is alike at neighbouring lines.
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
    """Squared error of the mean over the rows (m, lines), all lines together."""
    rows = len(values)
    return float(np.sum(np.abs(values - values.mean(axis=0)) ** 2)) / (rows * (rows - 1))


def _settles(y: Array, period: int) -> bool:
    """Of two periods: whether the first one differs from the second at its beginning more than at its end."""
    apart = (y[period:] - y[:period]) ** 2
    half = period // 2
    return float(np.sum(apart[:half])) > 1.5 * float(np.sum(apart[half:]))
