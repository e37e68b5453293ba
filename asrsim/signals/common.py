"""Functions that several kinds of signals use, for declared fields, the time since the start, and interpolation."""

from __future__ import annotations

from typing import Any

import numpy as np

from asrsim.document.block import declare
from asrsim.document.kinds import NUMBER, REQUIRED
from asrsim.errors import ScenarioError
from asrsim.samples import Array

VALUE = "value"
"""Placeholder for the unit of the quantity that a signal drives, such as rad for a position or N m for a torque."""

INTERPOLATIONS = ("linear", "hold")
SLACK = 1e-9
"""Time by which a held sample may take effect early, so that rounding does not delay it by a whole sample, s."""


def driven(doc: str, *, default: Any = REQUIRED, key: str = "") -> Any:
    """Field of a signal, in the unit of the quantity that the signal drives."""
    return declare(NUMBER, doc=doc, unit=VALUE, default=default, key=key)


def start_time(doc: str = "time of the start; before it, the signal has its first value") -> Any:
    """Field `start` of a signal: the time at which the signal starts, s."""
    return declare(NUMBER, doc=doc, unit="s", default=0.0)


def since(time: Array, start: float) -> Array:
    """Time since `start` at each of the times (n,), s; 0 before the start."""
    return np.maximum(np.asarray(time, dtype=np.float64) - start, 0.0)


def minimum_jerk(share: Array) -> Array:
    """Fraction of a motion from rest to rest that is done after the fraction s of its time: 10 s^3 - 15 s^4 + 6 s^5 (Flash and
    Hogan 1985).
    """
    return share * share * share * (10.0 + share * (6.0 * share - 15.0))


def require(condition: bool, message: str, *, key: str) -> None:
    """Raise ScenarioError with this message for the field `key` unless the condition is true."""
    if not condition:
        raise ScenarioError(message, key=key, code="signal")


def rounded(times: Array) -> Array:
    """Times rounded like the times of steps (`asrsim.samples.grid`), so that an edge at 0.1 + 0.02 s equals the step 0.12 s."""
    return np.round(times, 12)


def between(times: Array, start: float, end: float) -> Array:
    """The times among the ascending `times` that lie from `start` to `end`, both included, s."""
    return times[(times >= start) & (times <= end)]


def interpolate(time: Array, times: Array, values: Array, interpolation: str) -> Array:
    """Values (n,) at the times `time` (n,), from samples at ascending `times`; constant beyond the first and last sample."""
    if interpolation == "hold":
        # Add a small time, so that rounding does not delay a sample until the next time step. For example, 100.2 - 100 is
        # 2.8e-15 larger than 0.2.
        index = np.searchsorted(times, time + SLACK, side="right") - 1
        return np.asarray(values[np.clip(index, 0, None)], dtype=np.float64)
    return np.asarray(np.interp(time, times, values), dtype=np.float64)


def hold_jumps(times: Array, values: Array, start: float, end: float) -> Array:
    """Times in s from `start` to `end`, both included, at which a series in zero-order hold changes its value."""
    return between(times[1:][np.diff(values) != 0.0], start, end)
