"""Result of a frequency response estimator; resampling of records to an even step; averaged cross spectra."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError
from asrsim.samples import Array


@dataclass(frozen=True, kw_only=True)
class Spectra:
    """Estimated frequency response at m frequencies."""

    frequency: Array
    """Frequencies (m,), Hz."""
    response: NDArray[np.complex128]
    """Complex response (m,), output / input."""
    coherence: Array
    """Magnitude-squared coherence (m,), corrected for its bias."""
    deviation: Array
    """Relative standard deviation of the complex response (m,); in each direction it is smaller by sqrt(2)."""
    freedom: float
    """Number of complex degrees of freedom of each deviation."""
    averages: float
    resolution: float
    """Distance between independent points, Hz."""


def uniform(time: Array, u: Array, y: Array) -> tuple[Array, Array, Array, list[Problem]]:
    """Both series with an even step (the median step), on the longest segment without a gap of more than three samples."""
    keep = np.isfinite(time) & np.isfinite(u) & np.isfinite(y)
    if keep.sum() < 4:
        raise RecordingError("input and output have no samples in common", code="no-overlap")
    t, u, y = time[keep], u[keep], y[keep]
    step = float(np.median(np.diff(t)))
    findings: list[Problem] = []
    edges = [0, *(np.flatnonzero(np.diff(t) > 4.5 * step) + 1).tolist(), len(t)]
    start, end = max(pairwise(edges), key=lambda pair: t[pair[1] - 1] - t[pair[0]])
    if end - start < len(t):
        findings.append(
            Problem(f"the record has gaps; its longest segment without gaps, {t[start]:.4g} to {t[end - 1]:.4g} s, is used",
                    code="gaps")
        )  # fmt: skip
    t, u, y = t[start:end], u[start:end], y[start:end]
    steps = np.diff(t)
    if len(steps) and float(np.ptp(steps)) > 0.01 * step:
        findings.append(
            Problem(f"uneven sampling is interpolated linearly to an even step of {step * 1e3:.4g} ms", code="jitter")
        )
        grid = t[0] + step * np.arange(math.floor((t[-1] - t[0]) / step + 1e-9) + 1)
        u, y, t = np.interp(grid, t, u), np.interp(grid, t, y), grid
    else:
        # Rounding errors of the time stamps must not add up over a long record.
        t = np.linspace(t[0], t[-1], len(t))
    return t, u, y, findings


def welch(u: Array, y: Array, step: float, low: float, high: float) -> Spectra:
    """Averaged cross spectra at the excited lines, from Hann windows that overlap by half.

    The segments are as long as 8 windows allow, but at least 6 periods of the lowest frequency; if the record is too short for
    that, half of the record.
    """
    from scipy.signal import csd

    n = len(u)
    wanted = max(2 * n // 9, math.ceil(6 / (low * step)))
    segment = min(wanted, n // 2)
    rate = 1.0 / step
    f, cross = csd(u, y, fs=rate, window="hann", nperseg=segment, detrend="constant")
    _, power_u = csd(u, u, fs=rate, window="hann", nperseg=segment, detrend="constant")
    _, power_y = csd(y, y, fs=rate, window="hann", nperseg=segment, detrend="constant")
    power_u, power_y = power_u.real, power_y.real
    windows = 1 + (n - segment) // (segment - segment // 2)
    # Half-overlapping Hann windows have a correlation of 1/6 (Welch 1967): number of independent averages.
    averages = windows / (1 + 2 * (1 - 1 / windows) * (1 / 6) ** 2)
    inside = (f >= low - 0.5 / (segment * step)) & (f <= high + 0.5 / (segment * step)) & (f > 0)
    peaks = np.zeros(len(f), dtype=bool)
    peaks[1:-1] = (power_u[1:-1] >= power_u[:-2]) & (power_u[1:-1] >= power_u[2:])
    inside &= power_u > 1e-3 * power_u[inside].max() if inside.any() else inside
    lines = np.flatnonzero(inside & peaks)
    lines = lines if len(lines) else np.flatnonzero(inside)
    if not len(lines):
        raise RecordingError("no line of the excitation is resolved", code="too-short")
    # A line spreads over three bins; their sum represents the line at its true frequency.
    around = np.clip(lines[:, None] + np.arange(-1, 2), 0, len(f) - 1)
    line_u, line_y, line_cross = power_u[around].sum(axis=1), power_y[around].sum(axis=1), cross[around].sum(axis=1)
    frequency = np.sum(f[around] * power_u[around], axis=1) / line_u
    raw = np.abs(line_cross) ** 2 / np.maximum(line_u * line_y, 1e-300)
    # Pure noise has a coherence of 1/averages: subtract it, so that 0 means unrelated.
    coherence = np.clip((raw - 1 / averages) / (1 - 1 / averages), 0, 1) if averages > 1 else raw
    # Bendat and Piersol, Random Data, 4th edition, table 9.6.
    known = np.maximum(coherence, 1e-12)
    return Spectra(
        frequency=np.asarray(frequency, dtype=np.float64), response=line_cross / line_u, coherence=coherence,
        deviation=np.sqrt((1 - known) / (known * averages)), freedom=max(averages - 1, 1.0), averages=averages,
        resolution=1.0 / (segment * step),
    )  # fmt: skip
