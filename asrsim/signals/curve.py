"""Smooth curve through the samples of a recorded series, with jumps where the series jumps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from asrsim.samples import Array

JUMP = 8.0
"""Ratio of the change from one sample to the next to the changes beside it above which the change counts as a jump."""
TORN, BESIDE = 4.0, 6
"""Numbers for jumps in a smooth motion. TORN: ratio of the size of a change to the third differences beside it above which the
change counts as a jump; BESIDE: number of third differences on each side that are compared."""
LATE, GAP = 1.7, 3.0
"""Ratios of an interval between two samples to the typical interval. LATE: above it, samples are missing, and the change is
compared by its rate; GAP: above it, no change counts as a jump, since nobody knows what the series did in between.
"""
LARGE, MANY = 0.05, 40
"""LARGE: smallest size of a jump that counts as large, as a fraction of the series' range; MANY: largest number of large jumps.
A series with more large jumps counts as stairs."""


@dataclass(frozen=True, eq=False)
class CubicCurve:
    """Curve of pieces: a cubic polynomial for each interval between two samples. It jumps where the series jumps."""

    time: Array
    """Start times of the pieces (n,), s; the curve is constant after the last start time."""
    cubics: Array
    """Polynomial coefficients of the pieces (n, 4), the constant first."""
    large: NDArray[np.intp]
    """Indices (m,) of the pieces that begin with a large jump; empty if the series counts as stairs."""

    @property
    def jumps(self) -> Array:
        """Times of the large jumps (m,), s."""
        return np.asarray(self.time[self.large])

    @cached_property
    def sizes(self) -> Array:
        """Sizes of the large jumps (m,), with sign."""
        before = self.large - 1
        return np.asarray(self.cubics[self.large, 0] - _value(self.cubics[before], self.time[self.large] - self.time[before]))

    def values(self, time: Array) -> Array:
        """Values (k,) at the times (k,) in s; constant beyond the ends. At a jump, the value after the jump is returned."""
        place, after = self._pieces_of(time)
        return _value(self.cubics[place], np.maximum(after, 0.0))

    def integral(self, time: Array) -> Array:
        """Integrals (k,) of the curve from the first sample to the times (k,) in s. The curve is constant beyond its ends."""
        place, after = self._pieces_of(time)
        before = after < 0.0
        return np.asarray(self._areas[place] + np.where(before, after * self.cubics[0, 0], _area(self.cubics[place], after)))

    @cached_property
    def _areas(self) -> Array:
        return np.concatenate([[0.0], np.cumsum(_area(self.cubics[:-1], np.diff(self.time)))])

    def _pieces_of(self, time: Array) -> tuple[NDArray[np.intp], Array]:
        place = np.maximum(np.searchsorted(self.time, time, side="right") - 1, 0)
        return place, time - self.time[place]


def curve_through(time: Array, values: Array, *, hold: bool = False) -> CubicCurve:
    """Curve through samples (n,) at ascending times (n,) in s. hold: zero-order hold in place of splines."""
    jumping = np.diff(values) != 0.0 if hold else is_jump(time, values)
    cubics = np.zeros((len(time), 4))
    cubics[:, 0] = values
    edges = [0, *(np.flatnonzero(jumping) + 1).tolist(), len(time)]
    for first, last in pairwise(edges) if not hold else ():
        _join(time[first:last], cubics[first:last])
        if last < len(time) and last - first > 1:
            # Between the last sample before a jump and the jump, continue the polynomial of the previous interval.
            _, b, c, d = cubics[last - 2]
            width = time[last - 1] - time[last - 2]
            cubics[last - 1] = values[last - 1], b + width * (2.0 * c + 3.0 * d * width), c + 3.0 * d * width, 0.0
    found = np.flatnonzero(jumping) + 1
    large = found[np.abs(values[found] - values[found - 1]) > LARGE * np.ptp(values)]
    return CubicCurve(np.asarray(time), cubics, large if len(large) <= MANY else large[:0])


def is_jump(time: Array, values: Array) -> NDArray[np.bool_]:
    """Whether the series (n,) jumps between each two successive samples at the times (n,) in s; (n - 1,). At a jump, the change
    is much larger than the changes beside it, or the third differences have the pattern of a jump. A series does not jump in a
    gap.
    """
    intervals = np.diff(time)
    wide = intervals / np.median(intervals) if len(intervals) else intervals
    steps = np.abs(np.diff(values)) / np.maximum(wide, 1.0)
    least = 1e-3 * np.ptp(values)
    # At an end of the series, compare with two changes on the same side, since a single change may be near 0 at an extremum.
    before, after = np.concatenate([steps[2:3], steps[:-1]]), np.concatenate([steps[1:], steps[-3:-2]])
    beside = np.maximum(before, after) if len(steps) > 2 else np.full(len(steps), np.inf)
    torn = _torn(values, least) & (wide <= LATE)
    return ((steps > np.maximum(JUMP * beside, least)) | torn) & (wide <= GAP)


def _torn(values: Array, least: float) -> NDArray[np.bool_]:
    """Whether a smooth motion (n,) jumps between each two successive samples, (n - 1,).

    A jump changes three successive third differences by 1, -2 and 1 times its size. All other third differences stay small.
    least: size up to which a change is no jump.
    """
    n = len(values)
    torn = np.zeros(max(n - 1, 0), bool)
    if n < 6:
        return torn
    bends = np.diff(values, 3)
    a, b, c = bends[:-2], bends[1:-1], bends[2:]
    size = (a - 2.0 * b + c) / 6.0
    left = np.max(np.abs([a - size, b + 2.0 * size, c - size]), axis=0)
    padded = np.pad(np.abs(bends), BESIDE)
    wide = np.lib.stride_tricks.sliding_window_view(padded, BESIDE)
    k = np.arange(len(size))
    beside = np.maximum(wide[k].max(axis=1), wide[k + BESIDE + 3].max(axis=1))
    torn[2:-2] = np.abs(size) > np.maximum(TORN * np.maximum(beside, left), least)
    return torn


def _join(time: Array, cubics: Array) -> None:
    """Set the coefficients (n, 4) to the coefficients of a spline through the samples. A spline keeps extrema between the
    samples, which straight lines would cut off.
    """
    from scipy.interpolate import CubicSpline

    if len(time) > 3:
        cubics[:-1] = CubicSpline(time, cubics[:, 0]).c[::-1].T
    elif len(time) > 1:
        cubics[:-1, 1] = np.diff(cubics[:, 0]) / np.diff(time)


def _value(cubics: Array, width: Array) -> Array:
    a, b, c, d = np.moveaxis(cubics, -1, 0)
    return np.asarray(a + width * (b + width * (c + width * d)))


def _area(cubics: Array, width: Array) -> Array:
    """Integrals of cubic polynomials with coefficients (..., 4) from 0 to the widths (...)."""
    a, b, c, d = np.moveaxis(cubics, -1, 0)
    return np.asarray(width * (a + width * (b / 2.0 + width * (c / 3.0 + width * d / 4.0))))
