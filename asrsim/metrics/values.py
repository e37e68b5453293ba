"""Measures of a single series: mean, extremes, last and steady value."""

from __future__ import annotations

import math

import numpy as np

from asrsim.metrics.rest import SHARE, motion_left
from asrsim.samples import Array


def final(_time: Array, values: Array) -> float:
    """Last value."""
    return float(values[-1])


def mean(time: Array, values: Array) -> float:
    """Mean over time, by the trapezoidal rule, so that uneven sampling has no effect."""
    span = float(time[-1] - time[0])
    return float(np.trapezoid(values, time)) / span if span > 0 else float(values[0])


def minimum(_time: Array, values: Array) -> float:
    """Smallest value."""
    return float(np.min(values))


def maximum(_time: Array, values: Array) -> float:
    """Largest value."""
    return float(np.max(values))


def peak(_time: Array, values: Array) -> float:
    """Largest magnitude; for `deflection` the peak deflection."""
    return float(np.max(np.abs(values)))


def rms(time: Array, values: Array) -> float:
    """Root of the mean square over time."""
    return math.sqrt(mean(time, values**2))


def root_mean_square(samples: Array) -> float:
    """Root of the mean square of all samples, each with the same weight; NaN without samples."""
    return float(np.sqrt(np.mean(samples**2))) if len(samples) else math.nan


def root_mean_squares(samples: Array) -> Array:
    """Root of the mean square (k,) of each column of samples (n, k)."""
    return np.asarray(np.sqrt(np.mean(samples**2, axis=0)))


def amplitude(_time: Array, values: Array) -> float:
    """Half of maximum minus minimum."""
    return 0.5 * float(np.ptp(values))


def at(time: Array, values: Array, *, when: float) -> float:
    """Value at the time `when` (s), interpolated; undefined outside the record."""
    return float(np.interp(when, time, values, left=math.nan, right=math.nan))


def steady_state(time: Array, values: Array, *, share: float = SHARE) -> float:
    """Mean over the last part of the record, the fraction `share` of its duration; undefined unless the series is at rest."""
    return math.nan if motion_left(time, values, share=share) else mean(*last_part(time, values, share))


def steady_state_error(
    time: Array, values: Array, reference: Array | None = None, *, target: float | None = None, share: float = SHARE
) -> float:
    """Mean of reference minus value over the last part of the record; undefined unless the error is at rest.

    The reference is the second series, or the constant `target`. The motion of the error is also compared with the range of the
    values.
    """
    if reference is None and target is None:
        return math.nan
    error = (np.full_like(values, target) if target is not None else np.asarray(reference)) - values
    moves = motion_left(time, error, share=share, extent=float(np.ptp(values)))
    return math.nan if moves else mean(*last_part(time, error, share))


def last_part(time: Array, values: Array, share: float) -> tuple[Array, Array]:
    """Samples of a series (n,) in the last fraction `share` of the duration, at least one."""
    start = min(int(time.searchsorted(time[-1] - share * (time[-1] - time[0]))), len(time) - 1)
    return time[start:], values[start:]
