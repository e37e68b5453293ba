"""Values between the samples of a series, alike for waypoints and playback."""

from __future__ import annotations

import numpy as np

from asrsim.samples import Array
from asrsim.signals.common import between

INTERPOLATIONS = ("linear", "hold")
SLACK = 1e-9
"""s by which a held sample may come before its time."""


def interpolate(time: Array, times: Array, values: Array, interpolation: str) -> Array:
    """Values at `time`; `times` ascend; the ends hold."""
    if interpolation == "hold":
        # Rounding of a clock must not put a step off by one sample: 100.2 - 100 is 2.8e-15 more than 0.2.
        index = np.searchsorted(times, time + SLACK, side="right") - 1
        return np.asarray(values[np.clip(index, 0, None)], dtype=np.float64)
    return np.asarray(np.interp(time, times, values), dtype=np.float64)


def hold_jumps(times: Array, values: Array, start: float, end: float) -> Array:
    """Times in [start, end] at which a held series changes its value."""
    return between(times[1:][np.diff(values) != 0.0], start, end)
