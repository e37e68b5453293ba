"""The lag between two series, by cross-correlation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.samples import Array

_LONGEST = 200_000
"""Samples of the correlation's grid; longer records are correlated on a coarser one."""
_NEAR = 0.02
"""Summits whose correlation is this near to the best one's are as good: of a periodic signal, the one of least lag is taken."""
_VALLEY = 0.2
"""Correlation lost between two summits."""
_TOP = 0.1
"""Share of a summit's height that its parabola reaches down."""
_BLOCKS = 20
"""Parts of the record whose slopes give the interval."""
_CHANCE = 1e-3
"""Probability up to which a correlation is no chance."""
_STRETCHES = (0.72, 0.76, 0.8, 0.84, 0.88, 0.92, 1.08, 1.13, 1.18, 1.24, 1.3, 1.36)
"""Factors on the time of a record that make others of its kind of it: how these correlate is chance."""
_STRETCHED = 20_000
"""Samples that stretched series are correlated with at most."""


@dataclass(frozen=True, kw_only=True)
class Lag:
    """Result of a search for a lag."""

    seconds: float
    """s by which the second series comes after the first."""
    correlation: float
    """Normalised cross-correlation there, -1 to 1."""
    limit: float
    """s, the largest lag looked for."""
    at_limit: bool
    """The best correlation is at the edge of the search; the true lag may lie beyond."""
    ambiguous: bool
    """Other lags fit as well (a periodic signal); the smallest was taken."""
    margin: float
    """s, half width of the 95 % confidence interval about `seconds`, of one summit: which one is no matter of noise."""
    chance: float
    """Probability that unrelated series of the same kind correlate as well at some lag within the limit."""

    @property
    def is_significant(self) -> bool:
        """Whether it is no product of chance, and a peak, not the edge of the search."""
        return self.chance < _CHANCE and self.correlation > 0 and not self.at_limit

    @property
    def interval(self) -> tuple[float, float]:
        """s, 95 % confidence interval."""
        return self.seconds - self.margin, self.seconds + self.margin


def estimate_lag(time_a: Array, values_a: Array, time_b: Array, values_b: Array, *, limit: float | None = None) -> Lag | None:
    """Lag of b behind a, from series of any sampling, (n,) and (m,); None where one of them does not move.

    Each is brought to a common even step by linear interpolation (NaN left out). The correlation is normalised over the
    overlap at each lag (mean and size removed there), so that offsets and gains do not matter; lags that leave less than
    half of the shorter series in the overlap are not looked at. The peak is refined by a parabola over its summit, as wide as
    noise asks for.

    limit: s, largest lag either way; None: a quarter of the shorter series.
    """
    a, b = _finite(time_a, values_a), _finite(time_b, values_b)
    if min(len(a[0]), len(b[0])) < 4 or min(np.ptp(a[1]), np.ptp(b[1])) <= 0:
        return None
    spans = [float(t[-1] - t[0]) for t, _ in (a, b)]
    limit = 0.25 * min(spans) if limit is None else limit
    step = min(float(np.median(np.diff(t))) for t, _ in (a, b))
    step = max(step, max(spans) / _LONGEST)
    x, y = (np.interp(np.arange(t[0], t[-1] + 0.5 * step, step), t, v) for t, v in (a, b))
    x, y = x - np.mean(x), y - np.mean(y)
    offset = float(b[0][0] - a[0][0])
    lags, rho = _normalised(x, y, step, offset=offset, limit=limit)
    if not len(lags):
        return None
    peak, ambiguous = _choose(lags, rho)
    at_limit = peak in (0, len(rho) - 1)
    half = _summit(rho, peak)
    shift, correlation = (0.0, float(rho[peak])) if at_limit else _refined(rho, peak, half)
    # The highest sample of a rough summit may be on its flank: once more from the parabola's top.
    if not at_limit and half <= peak + round(shift) < len(rho) - half:
        peak += round(shift)
        shift, correlation = _refined(rho, peak, half)
    margin = _margin(x, y, round((float(lags[peak]) - offset) / step), half) * step
    return Lag(
        seconds=float(lags[peak]) + shift * step, correlation=min(correlation, 1.0), limit=limit, ambiguous=ambiguous,
        at_limit=at_limit and limit > 0, margin=margin,
        chance=_chance(x, y, step, offset=offset, limit=limit, correlation=correlation),
    )  # fmt: skip


def _summit(rho: Array, peak: int) -> int:
    """Samples on either side of a peak that its parabola is fitted to: its top where noise roughens it, else 1."""
    below = np.flatnonzero(rho < rho[peak] - min(_TOP * abs(float(rho[peak])), 20 * _roughness(rho)))
    left = peak - below[below < peak].max(initial=-1) - 1
    right = below[below > peak].min(initial=len(rho)) - peak - 1
    return int(max(min(left, right, peak, len(rho) - 1 - peak), 1))


def _roughness(rho: Array) -> float:
    """What a correlation jumps from lag to lag, about twice its noise."""
    return float(np.median(np.abs(np.diff(rho, 2)))) if len(rho) > 8 else 0.0


def _refined(rho: Array, peak: int, half: int) -> tuple[float, float]:
    """Place of the maximum (samples from the peak) and its height, by a parabola over the summit."""
    place = np.arange(-half, half + 1)
    bend, slope, height = np.polyfit(place, rho[peak - half : peak + half + 1], 2)
    if bend >= 0:
        return 0.0, float(rho[peak])
    shift = float(np.clip(-slope / (2 * bend), -half, half))
    return shift, float(height + slope * shift + bend * shift**2)


def _margin(x: Array, y: Array, shift: int, half: int) -> float:
    """Half width in samples of the 95 % interval of the lag: the slope of the correlation by blocks over its bend.

    The correlation is a sum over blocks of the record; the spread of their slopes at the peak is that of the sum, whatever
    noise is in either series.
    """
    from scipy.stats import t

    start, end = max(0, -shift), min(len(x), len(y) - shift)
    edge = 2 * half
    lead = np.arange(max(start, edge - shift), min(end, len(y) - shift - edge))
    if len(lead) < 2 * _BLOCKS:
        return float("inf")
    a, middle = x[lead], y[lead + shift]
    before, after = y[lead + shift - half], y[lead + shift + half]
    gain = float(np.dot(a, middle) / max(np.dot(a, a), 1e-300))
    # What a itself has of slope is no error of the lag.
    own = np.interp(lead + half, np.arange(len(x)), x) - np.interp(lead - half, np.arange(len(x)), x)
    slopes = a * (after - before) - gain * a * own
    blocks = np.array([float(np.sum(block)) for block in np.array_split(slopes / (2 * half), _BLOCKS)])
    bend = float(np.sum(a * (2 * middle - before - after))) / half**2
    if bend <= 0:
        return float("inf")
    spread = float(np.sqrt(_BLOCKS / (_BLOCKS - 1) * np.sum((blocks - blocks.mean()) ** 2)))
    return float(t.ppf(0.975, _BLOCKS - 1)) * spread / bend


def _chance(x: Array, y: Array, step: float, *, offset: float, limit: float, correlation: float) -> float:
    """Probability that unrelated series like x and y correlate as well at some lag: the less of two answers."""
    by_samples = _chance_by_samples(x, y, limit / step, correlation)
    return by_samples if by_samples < _CHANCE else _chance_by_stretching(x, y, step, offset, limit, correlation)


def _chance_by_samples(x: Array, y: Array, limit: float, correlation: float) -> float:
    """By the number of independent samples that the autocorrelations leave (Bartlett, Journal of the Royal Statistical
    Society 98, 1935). limit: samples either way.
    """
    from scipy.stats import t

    n = min(len(x), len(y))
    size = 1 << (2 * n - 1).bit_length()
    product, width = np.ones(n), 1.0
    for series in (x[:n], y[:n]):
        own = np.fft.irfft(np.abs(np.fft.rfft(series - np.mean(series), size)) ** 2, size)[:n]
        product = product * own / max(float(own[0]), 1e-300)
        fall = np.flatnonzero(own < 0.5 * own[0])
        width = max(width, float(fall[0]) if len(fall) else float(n))
    independent = n / max(1.0 + 2.0 * float(np.sum(product[1:] * (1 - np.arange(1, n) / n))), 1.0)
    # A shape that is met to the last digit is no chance, however slow it is: not fewer than six.
    freedom = max(independent, 6.0) - 2.0
    rho = min(abs(correlation), 1 - 1e-12)
    tail = 2.0 * float(t.sf(rho * np.sqrt(freedom / (1 - rho**2)), freedom))
    return min(1.0, tail * max(2 * limit / width, 1.0))


def _chance_by_stretching(x: Array, y: Array, step: float, offset: float, limit: float, correlation: float) -> float:
    """By what y, stretched in time, correlates: as well if the two are unrelated, much less if they share an oscillation."""
    from scipy.stats import t

    every = max(min(len(x), len(y)) // _STRETCHED, 1)
    x, place, found = x[::every], np.arange(0, len(y), every), []
    for factor in _STRETCHES:
        stretched = np.interp(place / factor % (len(y) - 1), np.arange(len(y)), y)
        _, rho = _normalised(x, stretched - np.mean(stretched), step * every, offset=offset, limit=limit)
        if len(rho):
            found.append(float(np.arctanh(min(np.max(rho), 1 - 1e-9))))
    if len(found) < 3:
        return 1.0
    own = float(np.arctanh(min(correlation, 1 - 1e-9)))
    apart = (own - float(np.mean(found))) / max(float(np.std(found, ddof=1)) * np.sqrt(1 + 1 / len(found)), 1e-12)
    return float(t.sf(apart, len(found) - 1))


def _finite(time: Array, values: Array) -> tuple[Array, Array]:
    keep = np.isfinite(values) & np.isfinite(time)
    return time[keep], values[keep]


def _normalised(x: Array, y: Array, step: float, *, offset: float, limit: float) -> tuple[Array, Array]:
    """Lags (s) within the limit and the correlation coefficient of the overlap at each."""
    from scipy.signal import correlate

    shifts = np.arange(-(len(x) - 1), len(y))
    start, end = np.maximum(0, -shifts), np.minimum(len(x), len(y) - shifts)
    count = end - start

    def sums(values: Array, first: Any, last: Any) -> Array:
        """Of values[first:last], for all overlaps."""
        running = np.concatenate([[0.0], np.cumsum(values)])
        return np.asarray(running[last] - running[first])

    in_x, in_y = (start, end), (start + shifts, end + shifts)
    sum_x, sum_y = sums(x, *in_x), sums(y, *in_y)
    power_x = sums(x * x, *in_x) - sum_x**2 / count
    power_y = sums(y * y, *in_y) - sum_y**2 / count
    # An overlap in which a series rests has no correlation; rounding must not make one.
    floor_x, floor_y = 1e-6 * np.sum(x * x), 1e-6 * np.sum(y * y)
    usable = (count >= 0.5 * min(len(x), len(y))) & (power_x > floor_x) & (power_y > floor_y)
    lags = np.asarray(offset + shifts * step, dtype=np.float64)
    usable &= np.abs(lags) <= limit + 0.5 * step
    products = np.asarray(correlate(y, x, mode="full", method="fft"), dtype=np.float64)
    rho: Array = (products - sum_x * sum_y / count)[usable] / np.sqrt(power_x[usable] * power_y[usable])
    return lags[usable], rho


def _choose(lags: Array, rho: Array) -> tuple[int, bool]:
    """Index of the best peak, of summits as high that of the least lag; and whether there were others as high."""
    best = int(np.argmax(rho))
    inner = np.flatnonzero((rho[1:-1] >= rho[:-2]) & (rho[1:-1] > rho[2:])) + 1
    # The best may be no peak, but the edge of the search on the way to one: of a periodic signal, another period's.
    near = np.union1d(inner[rho[inner] >= rho[best] - max(_NEAR, 4 * _roughness(rho))], [best])
    # Peaks side by side are ripples on one summit, which its highest stands for; a valley separates summits.
    summits = [int(near[0])]
    for i in map(int, near[1:]):
        if np.min(rho[summits[-1] : i + 1]) < rho[best] - _VALLEY:
            summits.append(i)
        elif rho[i] > rho[summits[-1]]:
            summits[-1] = i
    return min(summits, key=lambda i: abs(float(lags[i]))), len(summits) > 1
