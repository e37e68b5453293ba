"""Measures of a step response: rise, overshoot, settling.

The step goes from `initial` (default: the first value of the window) to `target` (default: the steady state, the mean of
the last tenth), as in Ogata, Modern Control Engineering, chapter 5, with the steady state in place of the final value so
that noise does not decide.
"""

from __future__ import annotations

import math

import numpy as np

from asrsim.metrics.values import last_part, steady_state
from asrsim.samples import Array

_SHARE = 0.1


def _ends(time: Array, values: Array, initial: float | None, target: float | None) -> tuple[float, float]:
    return (
        float(values[0]) if initial is None else initial,
        steady_state(time, values, share=_SHARE) if target is None else target,
    )


def _normalised(time: Array, values: Array, initial: float | None, target: float | None) -> Array | None:
    """0 before and 1 after the step; None where there is no step."""
    start, end = _ends(time, values, initial, target)
    height = end - start
    if abs(height) <= 1e-9 * max(1.0, abs(start), abs(end)):
        return None
    return (values - start) / height


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
    """Time from `low` to `high` of the step, first crossings, interpolated; undefined where there is no step."""
    x = _normalised(time, values, initial, target)
    return math.nan if x is None else _first_crossing(time, x, high) - _first_crossing(time, x, low)


def overshoot(time: Array, values: Array, *, initial: float | None = None, target: float | None = None) -> float:
    """Peak beyond the steady state as a fraction of the step's height, 0 if there is none; undefined without a step."""
    x = _normalised(time, values, initial, target)
    return math.nan if x is None else max(float(np.max(x)) - 1.0, 0.0)


def settling(time: Array, values: Array, *, band: float = 0.02,
             initial: float | None = None, target: float | None = None) -> float:  # fmt: skip
    """Time from the window's start until the value stays within +-`band` (2 %) of the step's height around the steady state.

    Undefined where there is no step, or where the value is still outside the band in the last tenth (not settled).
    """
    x = _normalised(time, values, initial, target)
    if x is None:
        return math.nan
    outside = np.flatnonzero(np.abs(x - 1.0) > band)
    if not len(outside):
        return 0.0
    i = int(outside[-1])
    if time[i] >= last_part(time, values, _SHARE)[0][0] or i + 1 >= len(time):
        return math.nan
    edge = 1.0 + math.copysign(band, x[i] - 1.0)
    share = (edge - x[i]) / (x[i + 1] - x[i])
    return float(time[i] + share * (time[i + 1] - time[i]) - time[0])


def peak_time(time: Array, values: Array, *, initial: float | None = None, target: float | None = None) -> float:
    """Time from the window's start to the largest excursion in the step's direction; undefined without a step."""
    x = _normalised(time, values, initial, target)
    return math.nan if x is None else float(time[int(np.argmax(x))] - time[0])
