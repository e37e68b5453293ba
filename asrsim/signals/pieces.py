"""Piecewise signals: constant, step, ramp, minimum jerk, waypoints and pulse train."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from asrsim.document.block import declare
from asrsim.document.kinds import NUMBER, POSITIVE, Choice, Integer, ListOf
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import (
    INTERPOLATIONS,
    between,
    driven,
    hold_jumps,
    interpolate,
    minimum_jerk,
    require,
    rounded,
    since,
    start_time,
)


@dataclass(frozen=True, kw_only=True)
class Constant(Signal):
    """Constant value. A plain number in a scenario is short for this signal."""

    kind: ClassVar[str] = "constant"
    main_field: ClassVar[str] = "value"

    value: float = driven("the value")

    def values(self, time: Array) -> Array:
        return np.full(np.shape(time), self.value)


@dataclass(frozen=True, kw_only=True)
class Step(Signal):
    """Jump from one value to another. At the time of the jump, the signal has the new value."""

    kind: ClassVar[str] = "step"

    at: float = declare(NUMBER, doc="time of the jump", unit="s", default=0.0)
    before: float = driven("value before the jump", default=0.0, key="from")
    after: float = driven("value after the jump", key="to")

    def values(self, time: Array) -> Array:
        return np.where(np.asarray(time) >= self.at, self.after, self.before)

    def jumps(self, start: float, end: float) -> Array:
        return between(np.array([self.at] if self.before != self.after else []), start, end)


@dataclass(frozen=True, kw_only=True)
class Ramp(Signal):
    """Straight line from one value to another, constant before and after it."""

    kind: ClassVar[str] = "ramp"

    start: float = start_time()
    duration: float = declare(POSITIVE, doc="length of the ramp", unit="s")
    initial: float = driven("value at the start", default=0.0, key="from")
    final: float = driven("value at the end and after it", key="to")

    def __post_init__(self) -> None:
        require(self.duration > 0.0, "must be larger than 0", key="duration")

    def values(self, time: Array) -> Array:
        share = self._way((since(time, self.start) / self.duration).clip(max=1.0))
        return self.initial * (1.0 - share) + self.final * share

    def _way(self, s: Array) -> Array:
        """Fraction (n,) of the change in value that is done after the fractions `s` (n,) of the duration."""
        return s


@dataclass(frozen=True, kw_only=True)
class MinimumJerk(Ramp):
    """Fifth-order polynomial 10 s^3 - 15 s^4 + 6 s^5 from rest to rest (Flash and Hogan 1985)."""

    kind: ClassVar[str] = "minimum_jerk"

    duration: float = declare(POSITIVE, doc="length of the motion", unit="s")

    def _way(self, s: Array) -> Array:
        return minimum_jerk(s)


Point = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Waypoints(Signal):
    """Curve through points, constant before the first point and after the last point."""

    kind: ClassVar[str] = "waypoints"
    main_field: ClassVar[str] = "points"

    points: tuple[Point, ...] = declare(
        ListOf(of=ListOf(of=NUMBER, names=("time", "value")), minimum=1),
        doc="the points, in ascending time",
        unit="[s, value]",
    )
    interpolation: str = declare(
        Choice((*INTERPOLATIONS, "cubic")),
        doc="between points: a line, the earlier point's value, or a smooth spline that rests at both ends",
        default="linear",
    )

    def __post_init__(self) -> None:
        require(len(self.points) > 0, "needs at least one point", key="points")
        times = [point[0] for point in self.points]
        for before, after in pairwise(times):
            require(before < after, f"times must ascend, but {after:g} follows {before:g}", key="points")
        require(self.interpolation in (*INTERPOLATIONS, "cubic"), "must be linear, hold or cubic", key="interpolation")

    def values(self, time: Array) -> Array:
        knots = np.array(self.points, dtype=np.float64)
        if self.interpolation == "cubic" and len(knots) > 1:
            from scipy.interpolate import CubicSpline

            spline = CubicSpline(knots[:, 0], knots[:, 1], bc_type="clamped")
            return np.asarray(spline(np.clip(time, knots[0, 0], knots[-1, 0])), dtype=np.float64)
        return interpolate(np.asarray(time), knots[:, 0], knots[:, 1], self.interpolation)

    def jumps(self, start: float, end: float) -> Array:
        if self.interpolation != "hold":
            return np.empty(0)
        knots = np.array(self.points, dtype=np.float64)
        return hold_jumps(knots[:, 0], knots[:, 1], start, end)


MOST = 10**6
"""Largest number of pulses that one evaluation of a pulse train may cover."""


@dataclass(frozen=True, kw_only=True)
class PulseTrain(Signal):
    """Periodic rectangular pulses: `high` for `width`, then `low` until the end of the period."""

    kind: ClassVar[str] = "pulse_train"

    low: float = driven("value between pulses and before the first pulse", default=0.0)
    high: float = driven("value during a pulse")
    period: float = declare(POSITIVE, doc="time from pulse to pulse", unit="s")
    width: float = declare(POSITIVE, doc="length of a pulse, below the period", unit="s")
    start: float = start_time("time of the first pulse")
    count: int | None = declare(Integer(minimum=1), doc="number of pulses", default=None, shown="without end")

    def __post_init__(self) -> None:
        require(self.period > 0.0, "must be larger than 0", key="period")
        require(0.0 < self.width < self.period, f"must lie between 0 and the period of {self.period:g} s", key="width")

    def _edges(self, start: float, end: float) -> tuple[Array, Array]:
        """Times of the rising edges and of the falling edges of all pulses that overlap the time from `start` to `end`, s."""
        first = max(0, math.floor((start - self.start) / self.period) - 1)
        last = math.floor((end - self.start) / self.period) + 1
        if self.count is not None:
            last = min(last, self.count - 1)
        require(last - first < MOST, f"needs {last - first} pulses between {start:g} and {end:g} s", key="period")
        rising = self.start + self.period * np.arange(first, last + 1, dtype=np.float64)
        return rounded(rising), rounded(rising + self.width)

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
