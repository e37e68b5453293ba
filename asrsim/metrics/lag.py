"""The lag between two series, by cross-correlation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

_LONGEST = 200_000
"""Samples of the correlation's grid; longer records are correlated on a coarser one."""
_NEAR = 0.02
"""Peaks whose correlation is this near to the best one's are as good: of a periodic signal, the one of least lag is taken."""


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


def estimate_lag(time_a: Array, values_a: Array, time_b: Array, values_b: Array, *, limit: float | None = None) -> Lag | None:
    """Lag of b behind a, from series of any sampling, (n,) and (m,); None where one of them does not move.

    Each is brought to a common even step by linear interpolation (NaN left out). The correlation is normalised over the
    overlap at each lag (mean and size removed there), so that offsets and gains do not matter; lags that leave less than
    half of the shorter series in the overlap are not looked at. The peak is refined by a parabola.

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
    lags, rho = _normalised(x - np.mean(x), y - np.mean(y), step, offset=float(b[0][0] - a[0][0]), limit=limit)
    if not len(lags):
        return None
    peak, ambiguous = _choose(lags, rho)
    seconds, correlation = float(lags[peak]), float(rho[peak])
    at_limit = peak in (0, len(rho) - 1)
    if not at_limit:
        left, middle, right = rho[peak - 1 : peak + 2]
        bend = left - 2 * middle + right
        if bend < 0:
            shift = 0.5 * (left - right) / bend
            seconds += float(shift) * step
            correlation = float(middle - 0.25 * (left - right) * shift)
    return Lag(
        seconds=seconds, correlation=min(correlation, 1.0), limit=limit, at_limit=at_limit and limit > 0, ambiguous=ambiguous
    )


def _finite(time: Array, values: Array) -> tuple[Array, Array]:
    keep = np.isfinite(values) & np.isfinite(time)
    return time[keep], values[keep]


def _normalised(x: Array, y: Array, step: float, *, offset: float, limit: float) -> tuple[Array, Array]:
    """Lags (s) within the limit and the correlation coefficient of the overlap at each."""
    from scipy.signal import correlate

    def sums(p: Array, q: Array) -> Array:
        """Sum over i of p[i] q[i + k] for k = -(len(p) - 1) ... len(q) - 1."""
        return np.asarray(correlate(q, p, mode="full", method="fft"), dtype=np.float64)

    ones_x, ones_y = np.ones_like(x), np.ones_like(y)
    shifts = np.arange(-(len(x) - 1), len(y))
    count = np.maximum(np.round(sums(ones_x, ones_y)), 1.0)
    sum_x, sum_y = sums(x, ones_y), sums(ones_x, y)
    power_x = sums(x * x, ones_y) - sum_x**2 / count
    power_y = sums(ones_x, y * y) - sum_y**2 / count
    # An overlap in which a series rests has no correlation; rounding of the transforms must not make one.
    floor_x, floor_y = 1e-6 * np.sum(x * x), 1e-6 * np.sum(y * y)
    usable = (count >= 0.5 * min(len(x), len(y))) & (power_x > floor_x) & (power_y > floor_y)
    lags = np.asarray(offset + shifts * step, dtype=np.float64)
    usable &= np.abs(lags) <= limit + 0.5 * step
    rho: Array = (sums(x, y) - sum_x * sum_y / count)[usable] / np.sqrt(power_x[usable] * power_y[usable])
    return lags[usable], rho


def _choose(lags: Array, rho: Array) -> tuple[int, bool]:
    """Index of the best peak, of equal ones that of the least lag; and whether there were equal ones."""
    best = int(np.argmax(rho))
    inner = np.flatnonzero((rho[1:-1] >= rho[:-2]) & (rho[1:-1] > rho[2:])) + 1
    # The best may be no peak, but the edge of the search on the way to one: of a periodic signal, another period's.
    near = np.union1d(inner[rho[inner] >= rho[best] - _NEAR], [best])
    if len(near) < 2:
        return best, False
    chosen = int(near[np.argmin(np.abs(lags[near]))])
    # Peaks side by side are ripples on one summit; others are separated by a valley.
    apart = [int(i) for i in near if np.min(rho[min(i, chosen) : max(i, chosen) + 1]) < rho[best] - 0.2]
    if not apart:
        return best, False
    return chosen, True
