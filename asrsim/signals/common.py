"""What signal kinds share: declared fields, number kinds, and the rest before the start."""

from __future__ import annotations

from typing import Any

import numpy as np

from asrsim.document.block import REQUIRED, declare
from asrsim.document.kinds import Number
from asrsim.errors import ScenarioError
from asrsim.samples import Array

VALUE = "value"
"""Unit of what the signal drives: rad for a position, N m for a torque."""

ANY = Number()
POSITIVE = Number(above=0.0)
NOT_NEGATIVE = Number(minimum=0.0)


def driven(doc: str, *, default: Any = REQUIRED, key: str = "") -> Any:
    """A field in the unit of what the signal drives."""
    return declare(ANY, doc=doc, unit=VALUE, default=default, key=key)


def start_time(doc: str = "time of its beginning; before, the signal rests at its first value") -> Any:
    """The field `start`."""
    return declare(ANY, doc=doc, unit="s", default=0.0)


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
