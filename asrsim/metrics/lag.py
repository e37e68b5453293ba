"""Estimates the lag between two series by cross-correlation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.samples import Array

_LONGEST = 200_000
"""Largest number of samples in the correlation; longer records are correlated on a coarser grid."""
_NEAR = 0.02
"""Peaks whose correlation differs by less than this from the best one are equivalent; the smallest lag is chosen."""
_VALLEY = 0.2
"""Two peaks are distinct if the correlation between them falls by at least this amount."""
_TOP = 0.1
"""Fraction of a peak's height over which its parabola is fitted."""
_BLOCKS = 20
"""Number of parts of the record whose slopes give the confidence interval."""
_CHANCE = 1e-3
"""Largest probability of chance at which a correlation is significant."""
_STRETCHES = (0.72, 0.76, 0.8, 0.84, 0.88, 0.92, 1.08, 1.13, 1.18, 1.24, 1.3, 1.36)
"""Time scalings that turn a record into an unrelated series of the same kind, whose correlation is due to chance."""
_STRETCHED = 20_000
"""Largest number of samples in the correlations with stretched series."""


@dataclass(frozen=True, kw_only=True)
class Lag:
    """Result of a search for a lag."""

    seconds: float
    """Time by which the second series lags the first, s."""
    correlation: float
    """Normalised cross-correlation at this lag, -1 to 1."""
    limit: float
    """Largest lag of the search, s."""
    at_limit: bool
    """Whether the best correlation is at the edge of the search; the true lag may lie beyond."""
    ambiguous: bool
    """Whether other lags fit equally well (periodic signal); `seconds` is the smallest."""
    margin: float
    """Half-width of the 95 % confidence interval about `seconds`, s. It covers noise, not the choice among equivalent peaks."""
    chance: float
    """Probability that unrelated series of the same kind correlate equally well at some lag within the limit."""

    @property
    def is_significant(self) -> bool:
        """Whether the correlation is significant and its peak lies inside the search range."""
        return self.chance < _CHANCE and self.correlation > 0 and not self.at_limit

    @property
    def interval(self) -> tuple[float, float]:
        """Confidence interval (95 %), s."""
        return self.seconds - self.margin, self.seconds + self.margin


def estimate_lag(time_a: Array, values_a: Array, time_b: Array, values_b: Array, *, limit: float | None = None) -> Lag | None:
    """Lag of b behind a, from series (n,) and (m,) of any sampling; None if one of them is constant.

    Both series are interpolated linearly to a common even step (NaN omitted). The correlation at each lag is normalised over
    the overlap (mean and size removed), so offsets and gains do not matter. Lags with an overlap of less than half of the
    shorter series are excluded. The peak is refined by a parabola, which is wider for noisier correlations.

    limit: largest lag in either direction, s; None: a quarter of the shorter series.
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
    # On a rough peak the highest sample may lie on a flank: fit again around the vertex of the parabola.
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
    """Number of samples on each side of a peak for fitting its parabola: the top of a noisy peak, else 1."""
    below = np.flatnonzero(rho < rho[peak] - min(_TOP * abs(float(rho[peak])), 20 * _roughness(rho)))
    left = peak - below[below < peak].max(initial=-1) - 1
    right = below[below > peak].min(initial=len(rho)) - peak - 1
    return int(max(min(left, right, peak, len(rho) - 1 - peak), 1))


def _roughness(rho: Array) -> float:
    """Typical jump of a correlation from one lag to the next, about twice its noise."""
    return float(np.median(np.abs(np.diff(rho, 2)))) if len(rho) > 8 else 0.0


def _refined(rho: Array, peak: int, half: int) -> tuple[float, float]:
    """Position of the maximum (samples from the peak) and its height, from a parabola through the peak."""
    place = np.arange(-half, half + 1)
    bend, slope, height = np.polyfit(place, rho[peak - half : peak + half + 1], 2)
    if bend >= 0:
        return 0.0, float(rho[peak])
    shift = float(np.clip(-slope / (2 * bend), -half, half))
    return shift, float(height + slope * shift + bend * shift**2)


def _margin(x: Array, y: Array, shift: int, half: int) -> float:
    """Half-width in samples of the lag's 95 % interval: spread of the blocks' correlation slopes divided by the curvature.

    The correlation is a sum over blocks of the record. The spread of the blocks' slopes at the peak gives the spread of the
    sum, for any noise in either series.
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
    # Subtract the slope of a itself, which is not an error of the lag.
    own = np.interp(lead + half, np.arange(len(x)), x) - np.interp(lead - half, np.arange(len(x)), x)
    slopes = a * (after - before) - gain * a * own
    blocks = np.array([float(np.sum(block)) for block in np.array_split(slopes / (2 * half), _BLOCKS)])
    bend = float(np.sum(a * (2 * middle - before - after))) / half**2
    if bend <= 0:
        return float("inf")
    spread = float(np.sqrt(_BLOCKS / (_BLOCKS - 1) * np.sum((blocks - blocks.mean()) ** 2)))
    return float(t.ppf(0.975, _BLOCKS - 1)) * spread / bend


def _chance(x: Array, y: Array, step: float, *, offset: float, limit: float, correlation: float) -> float:
    """Probability that unrelated series like x and y correlate equally well at some lag: the smaller of two estimates."""
    by_samples = _chance_by_samples(x, y, limit / step, correlation)
    return by_samples if by_samples < _CHANCE else _chance_by_stretching(x, y, step, offset, limit, correlation)


def _chance_by_samples(x: Array, y: Array, limit: float, correlation: float) -> float:
    """Probability of a chance correlation from the number of independent samples, given the autocorrelations (Bartlett,
    Journal of the Royal Statistical Society 98, 1935). limit: samples in either direction.
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
    # At least six: an exact match of a slow signal is no chance.
    freedom = max(independent, 6.0) - 2.0
    rho = min(abs(correlation), 1 - 1e-12)
    tail = 2.0 * float(t.sf(rho * np.sqrt(freedom / (1 - rho**2)), freedom))
    return min(1.0, tail * max(2 * limit / width, 1.0))


def _chance_by_stretching(x: Array, y: Array, step: float, offset: float, limit: float, correlation: float) -> float:
    """Probability of a chance correlation from y stretched in time: unrelated series correlate equally well, a shared
    oscillation much less.
    """
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
    """Lags (s) within the limit, and the correlation coefficient of the overlap at each lag."""
    from scipy.signal import correlate

    shifts = np.arange(-(len(x) - 1), len(y))
    start, end = np.maximum(0, -shifts), np.minimum(len(x), len(y) - shifts)
    count = end - start

    def sums(values: Array, first: Any, last: Any) -> Array:
        """Sums of values[first:last] for all overlaps."""
        running = np.concatenate([[0.0], np.cumsum(values)])
        return np.asarray(running[last] - running[first])

    in_x, in_y = (start, end), (start + shifts, end + shifts)
    sum_x, sum_y = sums(x, *in_x), sums(y, *in_y)
    power_x = sums(x * x, *in_x) - sum_x**2 / count
    power_y = sums(y * y, *in_y) - sum_y**2 / count
    # The correlation is undefined if a series is constant in the overlap; rounding must not define it.
    floor_x, floor_y = 1e-6 * np.sum(x * x), 1e-6 * np.sum(y * y)
    usable = (count >= 0.5 * min(len(x), len(y))) & (power_x > floor_x) & (power_y > floor_y)
    lags = np.asarray(offset + shifts * step, dtype=np.float64)
    usable &= np.abs(lags) <= limit + 0.5 * step
    products = np.asarray(correlate(y, x, mode="full", method="fft"), dtype=np.float64)
    rho: Array = (products - sum_x * sum_y / count)[usable] / np.sqrt(power_x[usable] * power_y[usable])
    return lags[usable], rho


def _choose(lags: Array, rho: Array) -> tuple[int, bool]:
    """Index of the best peak (the smallest lag among equal peaks), and whether there were equal peaks."""
    best = int(np.argmax(rho))
    inner = np.flatnonzero((rho[1:-1] >= rho[:-2]) & (rho[1:-1] > rho[2:])) + 1
    # The best sample may be at the edge of the search instead of a peak: for a periodic signal, part of another period's peak.
    near = np.union1d(inner[rho[inner] >= rho[best] - max(_NEAR, 4 * _roughness(rho))], [best])
    # Adjacent maxima are ripples on one peak, represented by the highest; a valley separates peaks.
    summits = [int(near[0])]
    for i in map(int, near[1:]):
        if np.min(rho[summits[-1] : i + 1]) < rho[best] - _VALLEY:
            summits.append(i)
        elif rho[i] > rho[summits[-1]]:
            summits[-1] = i
    return min(summits, key=lambda i: abs(float(lags[i]))), len(summits) > 1
