"""Measures of a difference: a series against a reference on the same time base.

`values` is the evaluated series (the simulation), and `reference` is its target (the recording, the reference signal).
"""

from __future__ import annotations

import math

import numpy as np

from asrsim.metrics.lag import estimate_lag
from asrsim.metrics.values import mean, rms
from asrsim.samples import Array


def rmse(time: Array, values: Array, reference: Array) -> float:
    """Root mean square of the difference over time."""
    return rms(time, values - reference)


def nrmse(time: Array, values: Array, reference: Array) -> float:
    """RMSE divided by the range (maximum minus minimum) of the reference; undefined for a constant reference."""
    extent = float(np.ptp(reference))
    return rmse(time, values, reference) / extent if extent > 0 else math.nan


def maximum_error(_time: Array, values: Array, reference: Array) -> float:
    """Largest magnitude of the difference."""
    return float(np.max(np.abs(values - reference)))


def bias(time: Array, values: Array, reference: Array) -> float:
    """Mean of value minus reference over time."""
    return mean(time, values - reference)


def r2(time: Array, values: Array, reference: Array) -> float:
    """Coefficient of determination 1 - mean (r - v)^2 / mean (r - mean r)^2 over time. It is 1 for equal series, 0 if the
    values are as close to the reference as the mean of the reference is, and negative if they are less close. It is
    undefined for a constant reference.
    """
    # Test the range and not the variance, since the mean of equal values may differ from them by rounding.
    if not np.ptp(reference) > 0.0:
        return math.nan
    total = mean(time, (reference - mean(time, reference)) ** 2)
    return 1.0 - mean(time, (reference - values) ** 2) / total if total > 0 else math.nan


def delay(time: Array, values: Array, reference: Array, *, limit: float | None = None) -> float:
    """Delay of the values behind the reference, at the peak of their normalised cross-correlation; undefined if the correlation
    is below 0.6, or if the peak lies at the limit of the search.

    limit: largest delay in either direction, s; a quarter of the record by default.
    """
    lag = estimate_lag(time, reference, time, values, limit=limit)
    return lag.seconds if lag is not None and lag.is_trusted else math.nan
