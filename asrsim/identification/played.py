"""Recorded commands as the simulation takes them: smooth in time and in a delay, but for a few large jumps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np

from asrsim.identification.data import Command
from asrsim.samples import Array
from asrsim.signals.base import Signal

JUMP = 8.0
"""A change of a command that is so many times those beside it is a jump, at the later sample."""
LARGE, MANY = 0.05, 40
"""Share of a command's range from which on a jump is large, and number of these beyond which they are stairs."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Played(Signal):
    """A recorded command: its mean over each step, so that results are smooth in a delay, but for a few large jumps.

    These are cut out of the means, and the loop splits its steps at them: a motor at its torque limit does not see a mean.
    """

    kind: ClassVar[str] = "played"

    command: Command
    step: float
    """s over which means are taken."""
    gain: float = 1.0
    offset: float = 0.0
    delay: float = 0.0

    def values(self, time: Array) -> Array:
        """gain (recorded - offset), `delay` s later."""
        at = time - self.delay
        ends = self._integral(np.stack([at - 0.5 * self.step, at + 0.5 * self.step]))
        means = (ends[1] - ends[0]) / self.step
        for jump, size in zip(*self._jumps, strict=True):
            # A mean over a jump takes the value on its own side.
            near = np.abs(at - jump) < 0.5 * self.step
            share = (at[near] - jump) / self.step + 0.5
            means[near] += size * np.where(at[near] >= jump - 1e-9, 1.0 - share, -share)
        return np.asarray(self.gain * (means - self.offset), dtype=np.float64)

    def jumps(self, start: float, end: float) -> Array:
        """Times of large jumps."""
        times = self._jumps[0] + self.delay
        return np.asarray(times[(times >= start) & (times <= end)])

    @cached_property
    def _jumps(self) -> tuple[Array, Array]:
        """Times and sizes of large jumps, none where they are many: stairs are small."""
        known, values = self.command.time, self.command.values
        found = np.flatnonzero(self._jumping) + 1
        found = found[np.abs(values[found] - values[found - 1]) > LARGE * np.ptp(values)]
        if len(found) > MANY:
            found = found[:0]
        return known[found], values[found] - values[found - 1]

    @cached_property
    def _jumping(self) -> Array:
        """(n - 1,) whether the command holds after a sample and jumps at the next."""
        steps = np.diff(self.command.values)
        if self.command.hold:
            return np.asarray(steps != 0.0)
        beside = np.maximum(np.concatenate([[0.0], np.abs(steps[:-1])]), np.concatenate([np.abs(steps[1:]), [0.0]]))
        return np.asarray(np.abs(steps) > np.maximum(JUMP * beside, 1e-3 * np.ptp(self.command.values)))

    @cached_property
    def _pieces(self) -> tuple[Array, Array]:
        """Integral up to each sample (n,), and coefficients (n, 4) of the cubic after it, from the constant on.

        Between jumps a smooth command goes through Akima's cubics: lines would cut off its summits.
        """
        from scipy.interpolate import Akima1DInterpolator

        known, values = self.command.time, self.command.values
        widths = np.diff(known)
        cubics = np.zeros((len(known), 4))
        cubics[:, 0] = values
        edges = [0, *(np.flatnonzero(self._jumping) + 1).tolist(), len(known)]
        for first, last in pairwise(edges) if not self.command.hold else ():
            inner = slice(first, last - 1)
            if last - first > 4:
                found = Akima1DInterpolator(known[first:last], values[first:last])
                cubics[inner] = np.asarray(found.c)[::-1].T
            elif last - first > 1:
                cubics[inner, 1] = np.diff(values[first:last]) / widths[inner]
        areas = np.cumsum(_area(cubics[:-1], widths))
        return np.concatenate([[0.0], areas]), cubics

    def _integral(self, time: Array) -> Array:
        """From the first sample to `time`; the ends hold."""
        known = self.command.time
        areas, cubics = self._pieces
        place = np.clip(np.searchsorted(known, time, side="right") - 1, 0, len(known) - 1)
        after = time - known[place]
        before = after < 0.0
        return np.asarray(areas[place] + np.where(before, after * cubics[0, 0], _area(cubics[place], after)))


def _area(cubics: Array, width: Array) -> Array:
    """Integrals of cubics (..., 4) over widths (...)."""
    a, b, c, d = np.moveaxis(cubics, -1, 0)
    return np.asarray(width * (a + width * (b / 2.0 + width * (c / 3.0 + width * d / 4.0))))
