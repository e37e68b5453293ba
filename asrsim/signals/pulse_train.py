"""A pulse train."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from asrsim.document.block import declare
from asrsim.document.kinds import POSITIVE, Integer, Optional
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import between, driven, require, start_time

MOST = 10**6
"""Pulses that are still worked out at once."""


@dataclass(frozen=True, kw_only=True)
class PulseTrain(Signal):
    """Rectangular pulses: `high` for `width`, then `low` until the period is over, again and again."""

    kind: ClassVar[str] = "pulse_train"

    low: float = driven("value between pulses and before the first", default=0.0)
    high: float = driven("value during a pulse")
    period: float = declare(POSITIVE, doc="time from pulse to pulse", unit="s")
    width: float = declare(POSITIVE, doc="length of a pulse, below the period", unit="s")
    start: float = start_time("time of the first pulse")
    count: int | None = declare(Optional(Integer(minimum=1)), doc="number of pulses", default=None, shown="without end")

    def __post_init__(self) -> None:
        require(self.period > 0.0, "must be larger than 0", key="period")
        require(0.0 < self.width < self.period, f"must lie between 0 and the period of {self.period:g} s", key="width")

    def _edges(self, start: float, end: float) -> tuple[Array, Array]:
        """Times of rising and falling edges of the pulses that touch [start, end], from one formula for all uses."""
        first = max(0, math.floor((start - self.start) / self.period) - 1)
        last = math.floor((end - self.start) / self.period) + 1
        if self.count is not None:
            last = min(last, self.count - 1)
        require(last - first < MOST, f"needs {last - first} pulses between {start:g} and {end:g} s", key="period")
        rising = self.start + self.period * np.arange(first, last + 1, dtype=np.float64)
        return rising, rising + self.width

    def values(self, time: Array) -> Array:
        time = np.asarray(time, dtype=np.float64)
        if time.size == 0:
            return np.empty(0)
        rising, falling = self._edges(float(time.min()), float(time.max()))
        inside = np.searchsorted(rising, time, side="right") > np.searchsorted(falling, time, side="right")
        return np.where(inside, self.high, self.low)

    def jumps(self, start: float, end: float) -> Array:
        if self.low == self.high:
            return np.empty(0)
        return between(np.sort(np.concatenate(self._edges(start, end))), start, end)
