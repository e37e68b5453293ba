"""Thinning of long series: the first, smallest, largest and last sample of every short interval are kept.

A line through the kept samples covers the same pixels as a line through all samples if an interval is at most one pixel wide
(Jugel et al., M4: a visualization-oriented time series data aggregation, PVLDB 7, 2014). No extreme is ever lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from asrsim.samples import Array

BINS = 1500
"""Number of intervals per picture, larger than the width of a panel in pixels."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Thinned time series."""

    time: Array
    """Times (k,), s."""
    values: Array
    """Values (k,), SI units."""

    @property
    def extent(self) -> float:
        """Largest magnitude of the values; 0 without samples."""
        finite = self.values[np.isfinite(self.values)]
        return float(np.max(np.abs(finite))) if len(finite) else 0.0


class Envelope:
    """Thins m series chunk by chunk to at most four samples per series, interval and chunk.

    start, end: limits of the whole record, s; samples outside are assigned to the first or last interval.
    """

    def __init__(self, *, start: float, end: float, bins: int = BINS) -> None:
        self._start, self._bins = start, bins
        self._scale = bins / (end - start) if end > start else 0.0
        self._times: list[Array] = []
        self._values: list[Array] = []
        self.samples = 0
        """Number of samples added so far."""

    def add(self, time: Array, values: Array) -> None:
        """Add the next chunk: time (n,) ascending, values (n, m); NaN marks a missing sample."""
        if not len(time):
            return
        self.samples += len(time)
        gone, low, high = ~np.isfinite(values), values, values
        if gone.any():
            # Treat infinite values as gaps, since they cannot be drawn.
            values, low, high = (np.where(gone, instead, values) for instead in (np.nan, np.inf, -np.inf))
        ends = np.zeros(values.shape[1], dtype=np.intp)
        for begin, end in pairwise([0, *(np.flatnonzero(np.diff(self._interval(time))) + 1).tolist(), len(time)]):
            rows = np.stack([ends, low[begin:end].argmin(axis=0), high[begin:end].argmax(axis=0), ends + (end - begin - 1)])
            rows = begin + np.sort(rows, axis=0)
            self._times.append(time[rows])
            self._values.append(np.take_along_axis(values, rows, axis=0))

    def column(self, j: int) -> tuple[Array, Array]:
        """Times and values, both (k,), of series j in order of time. NaN marks a gap."""
        if len(self._times) > 1:
            self._times, self._values = [np.concatenate(self._times)], [np.concatenate(self._values)]
        times, values = self._times[0][:, j], self._values[0][:, j]
        later = np.diff(times, prepend=-np.inf) > 0
        return times[later], values[later]

    def pairs(self, j: int) -> Array:
        """Smallest and largest value of every interval of series j, in order of time, as an array (2 * intervals,).

        Several series can thus share a time axis, on which the two values of interval k are drawn at 1/4 and 3/4 of the
        interval. The values are NaN where an interval has no sample.
        """
        times, values = self.column(j)
        interval = self._interval(times)
        order = np.lexsort((values, interval))
        order = order[np.isfinite(values[order])]
        used, first = np.unique(interval[order], return_index=True)
        result = np.full((self._bins, 2), np.nan)
        if not len(used):
            return result.ravel()
        extremes = np.sort(order[np.stack([first, np.append(first[1:], len(order)) - 1], axis=1)], axis=1)
        result[used] = values[extremes]
        return result.ravel()

    def _interval(self, time: Array) -> NDArray[np.intp]:
        return np.clip(((time - self._start) * self._scale).astype(np.intp), 0, self._bins - 1)


def decimate(time: Array, values: Array, *, bins: int = BINS) -> tuple[Array, Array]:
    """Times and values of one series (n,) thinned to at most `4 * bins` samples; a shorter series is returned unchanged."""
    if len(time) <= 4 * bins:
        return time, values
    envelope = Envelope(start=float(time[0]), end=float(time[-1]), bins=bins)
    envelope.add(time, np.asarray(values, dtype=np.float64)[:, None])
    return envelope.column(0)
