"""What an estimator of a frequency response gives; records brought to an even step; averaged cross spectra."""

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
    """What an estimator finds at m frequencies."""

    frequency: Array
    """(m,) Hz."""
    response: NDArray[np.complex128]
    """(m,) output / input."""
    coherence: Array
    """(m,) magnitude squared, corrected for its bias."""
    deviation: Array
    """(m,) relative standard deviation of the complex response: in each direction it is sqrt(2) less."""
    freedom: float
    """Complex degrees of freedom behind each deviation."""
    averages: float
    resolution: float
    """Hz between independent points."""


def uniform(time: Array, u: Array, y: Array) -> tuple[Array, Array, Array, list[Problem]]:
    """Both series on an even step (the median one), on their longest stretch without a gap of more than three samples."""
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
            Problem(f"the record has gaps; its longest whole stretch, {t[start]:.4g} to {t[end - 1]:.4g} s, is used",
                    code="gaps")
        )  # fmt: skip
    t, u, y = t[start:end], u[start:end], y[start:end]
    steps = np.diff(t)
    if len(steps) and float(np.ptp(steps)) > 0.01 * step:
        findings.append(
            Problem(f"uneven sampling is brought to an even {step * 1e3:.4g} ms by linear interpolation", code="jitter")
        )
        grid = t[0] + step * np.arange(math.floor((t[-1] - t[0]) / step + 1e-9) + 1)
        u, y, t = np.interp(grid, t, u), np.interp(grid, t, y), grid
    else:
        # Rounding of the stamps must not add up over a long record.
        t = np.linspace(t[0], t[-1], len(t))
    return t, u, y, findings


def welch(u: Array, y: Array, step: float, low: float, high: float) -> Spectra:
    """Averaged cross spectra over Hann windows that overlap by half, at the lines that are excited.

    The segment is the longest that still leaves 8 windows, but at least 6 periods of the lowest frequency; with a record too
    short for that it is half of the record.
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
    # Half-overlapping Hann windows are correlated by 1/6 (Welch 1967): so many independent ones.
    averages = windows / (1 + 2 * (1 - 1 / windows) * (1 / 6) ** 2)
    inside = (f >= low - 0.5 / (segment * step)) & (f <= high + 0.5 / (segment * step)) & (f > 0)
    peaks = np.zeros(len(f), dtype=bool)
    peaks[1:-1] = (power_u[1:-1] >= power_u[:-2]) & (power_u[1:-1] >= power_u[2:])
    inside &= power_u > 1e-3 * power_u[inside].max() if inside.any() else inside
    lines = np.flatnonzero(inside & peaks)
    lines = lines if len(lines) else np.flatnonzero(inside)
    if not len(lines):
        raise RecordingError("no line of the excitation is resolved", code="too-short")
    # A line is spread over three bins around it; taken together they stand for its true frequency.
    around = np.clip(lines[:, None] + np.arange(-1, 2), 0, len(f) - 1)
    line_u, line_y, line_cross = power_u[around].sum(axis=1), power_y[around].sum(axis=1), cross[around].sum(axis=1)
    frequency = np.sum(f[around] * power_u[around], axis=1) / line_u
    raw = np.abs(line_cross) ** 2 / np.maximum(line_u * line_y, 1e-300)
    # Pure noise shows 1/averages; removed, so that 0 means no relation.
    coherence = np.clip((raw - 1 / averages) / (1 - 1 / averages), 0, 1) if averages > 1 else raw
    # Bendat and Piersol, Random Data, 4th edition, table 9.6.
    known = np.maximum(coherence, 1e-12)
    return Spectra(
        frequency=np.asarray(frequency, dtype=np.float64), response=line_cross / line_u, coherence=coherence,
        deviation=np.sqrt((1 - known) / (known * averages)), freedom=max(averages - 1, 1.0), averages=averages,
        resolution=1.0 / (segment * step),
    )  # fmt: skip
