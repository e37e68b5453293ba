"""Measures of a step response: rise time, overshoot, settling time.

The step goes from `initial` (default: first value of the window) to `target` (default: steady state, the mean of the last
tenth), as in Ogata, Modern Control Engineering, chapter 5. The steady state replaces the final value to reduce the effect
of noise. Without a target, the measures are undefined unless the series is at rest at its end.
"""

from __future__ import annotations

import math

import numpy as np

from asrsim.metrics.rest import SHARE
from asrsim.metrics.values import last_part, steady_state
from asrsim.samples import Array

ROUNDING = 1e-9
"""Relative change below which a series has no step. It is also the fraction of a step's height below which a response has no
overshoot."""


def _normalised(time: Array, values: Array, initial: float | None, target: float | None) -> Array:
    """Series (n,) scaled to 0 before and 1 after the step; NaN without a step."""
    start = float(values[0]) if initial is None else initial
    end = steady_state(time, values) if target is None else target
    steps = abs(end - start) > ROUNDING * max(1.0, abs(start), abs(end))
    return (values - start) / (end - start if steps else math.nan)


def _first_crossing(time: Array, x: Array, level: float) -> float:
    """Time at which x first reaches the level from below, interpolated."""
    above = np.flatnonzero(x >= level)
    if not len(above):
        return math.nan
    i = int(above[0])
    if i == 0:
        return float(time[0])
    return float(time[i - 1] + (level - x[i - 1]) / (x[i] - x[i - 1]) * (time[i] - time[i - 1]))


def rise(
    time: Array,
    values: Array,
    *,
    low: float = 0.1,
    high: float = 0.9,
    initial: float | None = None,
    target: float | None = None,
) -> float:
    """Time between the first crossings of `low` and `high` (fractions of the step), interpolated; undefined without a step."""
    x = _normalised(time, values, initial, target)
    return _first_crossing(time, x, high) - _first_crossing(time, x, low)


def overshoot(time: Array, values: Array, *, initial: float | None = None, target: float | None = None) -> float:
    """Peak beyond the steady state as a fraction of the step's height. It is 0 without overshoot, and undefined without a
    step."""
    beyond = float(np.max(_normalised(time, values, initial, target))) - 1.0
    return 0.0 if beyond <= ROUNDING else beyond


def settling(
    time: Array, values: Array, *, band: float = 0.02, initial: float | None = None, target: float | None = None
) -> float:
    """Time from the window's start until the value stays within +-`band` (2 %) of the step's height around the steady state.

    Undefined without a step, or if the value is outside the band in the last tenth (not settled).
    """
    x = _normalised(time, values, initial, target)
    if math.isnan(x[0]):
        return math.nan
    outside = np.flatnonzero(np.abs(x - 1.0) > band)
    if not len(outside):
        return 0.0
    i = int(outside[-1])
    if i + 1 == len(time) or time[i] >= last_part(time, time, SHARE)[0][0]:
        return math.nan
    edge = 1.0 + math.copysign(band, x[i] - 1.0)
    return float(time[i] + (edge - x[i]) / (x[i + 1] - x[i]) * (time[i + 1] - time[i]) - time[0])


def peak_time(time: Array, values: Array, *, initial: float | None = None, target: float | None = None) -> float:
    """Time from the window's start to the largest excursion in the step's direction; undefined without a step."""
    x = _normalised(time, values, initial, target)
    return math.nan if math.isnan(x[0]) else float(time[int(np.argmax(x))] - time[0])
