"""Measures of a step response: rise time, overshoot, settling time.

The step goes from `initial` (default: first value of the window) to `target` (default: steady state, the mean of the last
tenth), as in Ogata, Modern Control Engineering, chapter 5. The steady state replaces the final value to reduce the effect
of noise.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from asrsim.metrics.values import SHARE, last_part, steady_state
from asrsim.samples import Array

ROUNDING = 1e-9
"""Relative difference below which a value does not step, and fraction of a step below which an excess is not an overshoot."""


def _normalised(time: Array, values: Array, initial: float | None, target: float | None) -> Array:
    """Series (1, n), scaled to 0 before and 1 after the step; NaN without a step."""
    start = float(values[0]) if initial is None else initial
    end = steady_state(time, values, share=SHARE) if target is None else target
    return normalised(values[None], np.array([start]), np.array([end]))


def normalised(values: Array, start: Array, end: Array) -> Array:
    """Series (m, n) scaled to 0 before and 1 after their steps from `start` to `end`, (m,); NaN without a step."""
    height = end - start
    none = np.abs(height) <= ROUNDING * np.maximum(1.0, np.maximum(np.abs(start), np.abs(end)))
    return np.asarray((values - start[:, None]) / np.where(none, math.nan, height)[:, None])


def _first_crossing(time: Array, x: Array, level: float) -> float:
    """Time at which x first reaches the level from below, interpolated."""
    above = np.flatnonzero(x >= level)
    if not len(above):
        return math.nan
    i = int(above[0])
    if i == 0:
        return float(time[0])
    return float(time[i - 1] + (level - x[i - 1]) / (x[i] - x[i - 1]) * (time[i] - time[i - 1]))


def rise(time: Array, values: Array, *, low: float = 0.1, high: float = 0.9,
         initial: float | None = None, target: float | None = None) -> float:  # fmt: skip
    """Time from `low` to `high` of the step, between first crossings, interpolated; undefined without a step."""
    x = _normalised(time, values, initial, target)[0]
    return _first_crossing(time, x, high) - _first_crossing(time, x, low)


def overshoot(time: Array, values: Array, *, initial: float | None = None, target: float | None = None) -> float:
    """Peak beyond the steady state as a fraction of the step's height, 0 without overshoot; undefined without a step."""
    return float(overshoots(_normalised(time, values, initial, target))[0])


def overshoots(x: Array) -> Array:
    """Overshoots (m,), as from `overshoot`, of normalised series (m, n). Rounding errors count as 0."""
    beyond = x.max(axis=1) - 1.0
    return np.asarray(np.where(beyond <= ROUNDING, 0.0, beyond))


def settling(time: Array, values: Array, *, band: float = 0.02,
             initial: float | None = None, target: float | None = None) -> float:  # fmt: skip
    """Time from the window's start until the value stays within +-`band` (2 %) of the step's height around the steady state.

    Undefined without a step, or if the value is outside the band in the last tenth (not settled).
    """
    return settlings(time, _normalised(time, values, initial, target), band)[0]


def settlings(time: Array, x: Array, band: float = 0.02) -> list[float]:
    """Settling times, as from `settling`, of normalised series (m, n)."""
    outside: Any = np.abs(x - 1.0) > band
    last = x.shape[1] - 1 - outside[:, ::-1].argmax(axis=1)
    end = last_part(time, time, SHARE)[0][0]
    return [
        _settled(time, row, i, band, end) if out else math.nan if math.isnan(row[0]) else 0.0
        for row, i, out in zip(x, last.tolist(), outside.any(axis=1).tolist(), strict=True)
    ]


def _settled(time: Array, x: Array, i: int, band: float, end: float) -> float:
    """Time at which a series that is outside the band for the last time at sample `i` enters it; NaN if after `end`."""
    if time[i] >= end or i + 1 >= len(time):
        return math.nan
    edge = 1.0 + math.copysign(band, x[i] - 1.0)
    share = (edge - x[i]) / (x[i + 1] - x[i])
    return float(time[i] + share * (time[i + 1] - time[i]) - time[0])


def peak_time(time: Array, values: Array, *, initial: float | None = None, target: float | None = None) -> float:
    """Time from the window's start to the largest excursion in the step's direction; undefined without a step."""
    x = _normalised(time, values, initial, target)[0]
    return math.nan if math.isnan(x[0]) else float(time[int(np.argmax(x))] - time[0])
