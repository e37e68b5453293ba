"""Waypoints: a curve through points."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from asrsim.document.block import declare
from asrsim.document.composite import ListOf
from asrsim.document.kinds import NUMBER, Choice
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import INTERPOLATIONS, hold_jumps, interpolate, require

Point = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Waypoints(Signal):
    """A curve through points; it rests at the first before them and at the last after them."""

    kind: ClassVar[str] = "waypoints"
    main_field: ClassVar[str] = "points"

    points: tuple[Point, ...] = declare(
        ListOf(of=ListOf(of=NUMBER, length=2, names=("time", "value")), minimum=1),
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
