"""Estimates the lag between two series by cross-correlation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

_LONGEST = 200_000
"""Largest number of samples in the correlation; longer records are correlated on a coarser grid."""
_NEAR = 0.02
"""Difference from the correlation of the best peak below which another peak is equivalent. Of equivalent peaks, the peak with
the smallest lag is chosen.
"""
_VALLEY = 0.2
"""Smallest fall of the correlation between two peaks for which the peaks count as distinct."""
_GAP = 3.0
"""Largest interval between two samples, in typical intervals of the series, across which a series is interpolated."""
_TOP = 0.1
"""Fraction of a peak's height over which its parabola is fitted."""
TRUSTED = 0.6
"""Smallest correlation at which a lag is trusted, since unrelated series may reach any smaller correlation."""


@dataclass(frozen=True, kw_only=True)
class Lag:
    """Result of a search for a lag."""

    seconds: float
    """Time by which the second series lags the first, s."""
    correlation: float
    """Normalised cross-correlation at this lag, -1 to 1."""
    at_limit: bool
    """Whether the best correlation is at the edge of the search; the true lag may lie beyond."""
    ambiguous: bool
    """Whether other lags fit equally well (periodic signal); `seconds` is the smallest of these lags."""

    @property
    def is_trusted(self) -> bool:
        """Whether the correlation is high enough, and its peak lies inside the search range."""
        return self.correlation >= TRUSTED and not self.at_limit


def estimate_lag(time_a: Array, values_a: Array, time_b: Array, values_b: Array, *, limit: float | None = None) -> Lag | None:
    """Lag of b behind a, from series (n,) and (m,) of any sampling; None if one of them is constant.

    The two series are interpolated linearly to a common even step (NaN omitted). The correlation at each lag is normalised over
    the overlap (mean and size removed), so offsets and gains do not matter. The overlap does not contain gaps of a series,
    since a line across a gap would shift the peak. Lags with an overlap of less than half of the shorter series are excluded.
    The peak is refined by a parabola, which is wider for noisier correlations.

    limit: largest lag in either direction, s; None: a quarter of the shorter series.
    """
    a, b = _finite(time_a, values_a), _finite(time_b, values_b)
    if min(len(a[0]), len(b[0])) < 4 or min(np.ptp(a[1]), np.ptp(b[1])) <= 0:
        return None
    spans = [float(t[-1] - t[0]) for t, _ in (a, b)]
    limit = 0.25 * min(spans) if limit is None else limit
    step = min(float(np.median(np.diff(t))) for t, _ in (a, b))
    step = max(step, max(spans) / _LONGEST)
    (x, known_x), (y, known_y) = (_evenly(t, v, step) for t, v in (a, b))
    offset = float(b[0][0] - a[0][0])
    lags, rho = _normalised(x, y, known_x, known_y, step, offset=offset, limit=limit)
    if not len(lags):
        return None
    peak, ambiguous = _choose(lags, rho)
    at_limit = peak in (0, len(rho) - 1)
    half = _summit(rho, peak)
    shift, correlation = (0.0, float(rho[peak])) if at_limit else _refined(rho, peak, half)
    # Fit again around the vertex of the parabola, since on a rough peak the highest sample may be on a flank.
    if not at_limit and half <= peak + round(shift) < len(rho) - half:
        peak += round(shift)
        shift, correlation = _refined(rho, peak, half)
    return Lag(
        seconds=float(lags[peak]) + shift * step,
        correlation=min(correlation, 1.0),
        ambiguous=ambiguous,
        at_limit=at_limit and limit > 0,
    )


def _summit(rho: Array, peak: int) -> int:
    """Number of samples on each side of a peak for fitting its parabola. They cover the top of a noisy peak; for other peaks
    the number is 1."""
    below = np.flatnonzero(rho < rho[peak] - min(_TOP * abs(float(rho[peak])), 20 * _roughness(rho)))
    left = peak - below[below < peak].max(initial=-1) - 1
    right = below[below > peak].min(initial=len(rho)) - peak - 1
    return int(max(min(left, right, peak, len(rho) - 1 - peak), 1))


def _roughness(rho: Array) -> float:
    """Typical jump of a correlation from one lag to the next, about twice its noise."""
    return float(np.median(np.abs(np.diff(rho, 2)))) if len(rho) > 8 else 0.0


def _refined(rho: Array, peak: int, half: int) -> tuple[float, float]:
    """Position of the maximum (samples from the peak) and its height, from a parabola through the peak."""
    bend, slope, height = np.polyfit(np.arange(-half, half + 1), rho[peak - half : peak + half + 1], 2)
    if bend >= 0:
        return 0.0, float(rho[peak])
    shift = float(np.clip(-slope / (2 * bend), -half, half))
    return shift, float(height + slope * shift + bend * shift**2)


def _finite(time: Array, values: Array) -> tuple[Array, Array]:
    keep = np.isfinite(values) & np.isfinite(time)
    return time[keep], values[keep]


def _evenly(time: Array, values: Array, step: float) -> tuple[Array, Array]:
    """Values (k,) every `step` s from the first sample to the last, and whether they are known (k,): 0 inside a gap, else 1.
    Their mean is removed. Values in a gap are 0.
    """
    grid = np.arange(time[0], time[-1] + 0.5 * step, step)
    after = np.clip(np.searchsorted(time, grid, side="left"), 1, len(time) - 1)
    wide = time[after] - time[after - 1] > _GAP * np.median(np.diff(time))
    known = np.where(wide & (grid > time[after - 1]) & (grid < time[after]), 0.0, 1.0)
    even = np.interp(grid, time, values)
    return (even - np.average(even, weights=known)) * known, known


def _normalised(
    x: Array, y: Array, known_x: Array, known_y: Array, step: float, *, offset: float, limit: float
) -> tuple[Array, Array]:
    """Lags (s) within the limit, and the correlation coefficient of the overlap at each lag.

    Sums over the overlap at each lag are themselves correlations (Padfield, IEEE Trans. Image Processing 21, 2012).
    """
    from scipy.fft import irfft, next_fast_len, rfft

    shifts = np.arange(-(len(x) - 1), len(y))
    length = next_fast_len(len(shifts), real=True)
    of_x, of_y = ([rfft(part, length) for part in (known, own, own * own)] for known, own in ((known_x, x), (known_y, y)))

    def sums(first: int, second: int) -> Array:
        """Sums of x^first y^second over all overlaps."""
        return np.asarray(np.roll(irfft(np.conj(of_x[first]) * of_y[second], length), len(x) - 1)[: len(shifts)])

    count = np.round(sums(0, 0))
    overlap = np.maximum(count, 1.0)
    sum_x, sum_y = sums(1, 0), sums(0, 1)
    power_x, power_y = sums(2, 0) - sum_x**2 / overlap, sums(0, 2) - sum_y**2 / overlap
    # The correlation is undefined if a series is constant in the overlap. The threshold excludes correlations of rounding
    # errors.
    floor_x, floor_y = 1e-6 * np.sum(x * x), 1e-6 * np.sum(y * y)
    usable = (count >= 0.5 * min(known_x.sum(), known_y.sum())) & (power_x > floor_x) & (power_y > floor_y)
    lags = np.asarray(offset + shifts * step, dtype=np.float64)
    usable &= np.abs(lags) <= limit + 0.5 * step
    rho: Array = (sums(1, 1) - sum_x * sum_y / overlap)[usable] / np.sqrt(power_x[usable] * power_y[usable])
    return lags[usable], rho


def _choose(lags: Array, rho: Array) -> tuple[int, bool]:
    """Index of the best peak (the smallest lag among equal peaks), and whether there were equal peaks."""
    best = int(np.argmax(rho))
    inner = np.flatnonzero((rho[1:-1] >= rho[:-2]) & (rho[1:-1] > rho[2:])) + 1
    # Also compare the best sample, since it may be at the edge of the search, beside a peak outside of the search.
    near = np.union1d(inner[rho[inner] >= rho[best] - max(_NEAR, 4 * _roughness(rho))], [best])
    # Adjacent maxima without a valley between them are ripples on one peak, which the highest of them represents. A valley
    # separates two peaks.
    summits = [int(near[0])]
    for i in map(int, near[1:]):
        if np.min(rho[summits[-1] : i + 1]) < rho[best] - _VALLEY:
            summits.append(i)
        elif rho[i] > rho[summits[-1]]:
            summits[-1] = i
    return min(summits, key=lambda i: abs(float(lags[i]))), len(summits) > 1
