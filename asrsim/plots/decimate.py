"""Thinning of long series: the first, smallest, largest and last sample of every short interval are kept.

A line drawn through these covers the same pixels as one through all samples, if an interval is not wider than a pixel
(Jugel et al., M4: a visualization-oriented time series data aggregation, PVLDB 7, 2014). No extreme is ever lost.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from asrsim.samples import Array

BINS = 1500
"""Number of intervals per picture: more than a panel has pixels."""


class Envelope:
    """Thins m series chunk by chunk to at most four samples per series and interval; memory does not grow.

    start, end: limits of the whole record, s; samples outside count to the first or last interval.
    """

    def __init__(self, count: int, *, start: float, end: float, bins: int = BINS) -> None:
        self._start = start
        self._scale = bins / (end - start) if end > start else 0.0
        self._bins = bins
        shape = (bins, count)
        self._low, self._high = np.full(shape, np.inf), np.full(shape, -np.inf)
        self._low_time, self._high_time = np.full(shape, np.nan), np.full(shape, np.nan)
        self._first, self._last = np.full(shape, np.nan), np.full(shape, np.nan)
        self._first_time, self._last_time = np.full(bins, np.nan), np.full(bins, np.nan)
        self.samples = 0
        """Number of samples added so far."""

    def add(self, time: Array, values: Array) -> None:
        """Add the next chunk: time (n,) ascending, values (n, m); NaN marks a missing sample."""
        if not len(time):
            return
        self.samples += len(time)
        index = np.clip(((time - self._start) * self._scale).astype(np.intp), 0, self._bins - 1)
        edges = [0, *(np.flatnonzero(np.diff(index)) + 1).tolist(), len(time)]
        gone = ~np.isfinite(values)
        low = high = values
        if gone.any():
            # Infinite values cannot be drawn: treat them as gaps.
            values, low, high = (np.where(gone, instead, values) for instead in (np.nan, np.inf, -np.inf))
        for begin, end in pairwise(edges):
            self._merge(int(index[begin]), time[begin:end], values[begin:end], low[begin:end], high[begin:end])

    def _merge(self, b: int, time: Array, values: Array, low: Array, high: Array) -> None:
        if math.isnan(self._first_time[b]):
            self._first_time[b], self._first[b] = time[0], values[0]
        self._last_time[b], self._last[b] = time[-1], values[-1]
        columns = np.arange(values.shape[1])
        at = low.argmin(axis=0)
        smaller = low[at, columns] < self._low[b]
        self._low[b, smaller] = low[at, columns][smaller]
        self._low_time[b, smaller] = time[at[smaller]]
        at = high.argmax(axis=0)
        larger = high[at, columns] > self._high[b]
        self._high[b, larger] = high[at, columns][larger]
        self._high_time[b, larger] = time[at[larger]]

    def column(self, j: int) -> tuple[Array, Array]:
        """Times and values, both (k,), of series j in order of time; k is at most four times the intervals. NaN marks a gap."""
        used = np.flatnonzero(~np.isnan(self._first_time))
        times = np.stack([self._first_time[used], self._low_time[used, j], self._high_time[used, j], self._last_time[used]], 1)
        values = np.stack([self._first[used, j], self._low[used, j], self._high[used, j], self._last[used, j]], 1)
        order = np.argsort(times, axis=1, kind="stable")
        times = np.take_along_axis(times, order, axis=1).ravel()
        values = np.take_along_axis(values, order, axis=1).ravel()
        there = ~np.isnan(times)
        times, values = times[there], values[there]
        keep = np.ones(len(times), bool)
        keep[1:] = np.diff(times) > 0
        return times[keep], values[keep]

    def pairs(self, j: int) -> Array:
        """Smallest and largest value of every interval of series j, in order of time, as an array (2 * intervals,).

        For several series on a common time axis: the values of interval k are drawn at 1/4 and 3/4 of the interval. NaN where
        an interval has no sample.
        """
        low, high = self._low[:, j], self._high[:, j]
        empty = ~np.isfinite(low)
        rising = self._low_time[:, j] <= self._high_time[:, j]
        result = np.stack([np.where(rising, low, high), np.where(rising, high, low)], axis=1)
        result[empty] = np.nan
        return result.ravel()


def decimate(time: Array, values: Array, *, bins: int = BINS) -> tuple[Array, Array]:
    """Times and values of one series (n,) thinned to at most `4 * bins` samples; a shorter series is returned unchanged."""
    if len(time) <= 4 * bins:
        return time, values
    envelope = Envelope(1, start=float(time[0]), end=float(time[-1]), bins=bins)
    envelope.add(time, np.asarray(values, dtype=np.float64)[:, None])
    return envelope.column(0)
