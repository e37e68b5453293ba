"""Values between the samples of a series, alike for waypoints and playback."""

from __future__ import annotations

import numpy as np

from asrsim.samples import Array
from asrsim.signals.common import between

INTERPOLATIONS = ("linear", "hold")


def interpolate(time: Array, times: Array, values: Array, interpolation: str) -> Array:
    """Values at `time`; `times` ascend; the ends hold."""
    if interpolation == "hold":
        index = np.searchsorted(times, time, side="right") - 1
        return np.asarray(values[np.clip(index, 0, None)], dtype=np.float64)
    return np.asarray(np.interp(time, times, values), dtype=np.float64)


def hold_jumps(times: Array, values: Array, start: float, end: float) -> Array:
    """Times in [start, end] at which a held series changes its value."""
    return between(times[1:][np.diff(values) != 0.0], start, end)
