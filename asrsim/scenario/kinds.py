"""Kinds of values that several parts of a scenario share."""

from __future__ import annotations

from typing import Any

from asrsim.document.composite import ListOf, MapOf
from asrsim.document.kinds import Number
from asrsim.signals.parse import SIGNAL

Keys = dict[str, Any]
"""A block that is kept as a plain mapping."""

NUMBER = Number()
POSITIVE = Number(above=0.0)
NOT_NEGATIVE = Number(minimum=0.0)
SHARE = Number(minimum=0.0, maximum=1.0)
POSITION = ListOf(of=NUMBER, length=3, names=("x", "y", "z"))
RPY = ListOf(of=NUMBER, length=3, names=("roll", "pitch", "yaw"))
SIGNALS_BY_JOINT = MapOf(of=SIGNAL)
ORIGIN = (0.0, 0.0, 0.0)
