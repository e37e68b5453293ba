"""What signal kinds share: declared fields, the rest before the start, values between samples."""

from __future__ import annotations

from typing import Any

import numpy as np

from asrsim.document.block import REQUIRED, declare
from asrsim.document.kinds import NUMBER
from asrsim.errors import ScenarioError
from asrsim.samples import Array

VALUE = "value"
"""Unit of what the signal drives: rad for a position, N m for a torque."""

INTERPOLATIONS = ("linear", "hold")
SLACK = 1e-9
"""s by which a held sample may come before its time."""


def driven(doc: str, *, default: Any = REQUIRED, key: str = "") -> Any:
    """A field in the unit of what the signal drives."""
    return declare(NUMBER, doc=doc, unit=VALUE, default=default, key=key)


def start_time(doc: str = "time of its beginning; before, the signal rests at its first value") -> Any:
    """The field `start`."""
    return declare(NUMBER, doc=doc, unit="s", default=0.0)


def since(time: Array, start: float) -> Array:
    """Seconds since `start`, 0 before it."""
    return np.maximum(np.asarray(time, dtype=np.float64) - start, 0.0)


def require(condition: bool, message: str, *, key: str) -> None:
    """Raise ScenarioError about a field unless the condition holds."""
    if not condition:
        raise ScenarioError(message, key=key, code="signal")


def between(times: Array, start: float, end: float) -> Array:
    """Those of ascending `times` that lie in [start, end]."""
    return times[(times >= start) & (times <= end)]


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
