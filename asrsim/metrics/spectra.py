"""Estimators of a frequency response from one record: local rational fits, and averaged cross spectra."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError
from asrsim.samples import Array

_HALF = (8, 16)
"""Fewest and most bins on either side of a frequency in the local fit: 17 to 33 complex equations for 7 unknowns."""
_AS_GOOD = 1.2
"""Residual of the fit without a denominator, over that of the fit with one, up to which the former is taken: about the
99 % point of the F test with 33 equations."""
_MOST = 2000
"""Frequencies at which the local fit is made; longer records are thinned evenly."""


@dataclass(frozen=True, kw_only=True)
class Spectra:
    """What an estimator finds at m frequencies."""

    frequency: Array
    """(m,) Hz."""
    response: NDArray[np.complex128]
    """(m,) output / input."""
    coherence: Array
    """(m,) magnitude squared, corrected for its bias."""
    averages: float
    resolution: float
    """Hz between independent points."""


def uniform(time: Array, u: Array, y: Array) -> tuple[Array, Array, Array, list[Problem]]:
    """Both series on an even step (the median one), on their longest stretch without a gap of more than three samples."""
    keep = np.isfinite(time) & np.isfinite(u) & np.isfinite(y)
    if keep.sum() < 4:
        raise RecordingError(Problem(message="input and output have no samples in common", code="no-overlap"))
    t, u, y = time[keep], u[keep], y[keep]
    step = float(np.median(np.diff(t)))
    findings: list[Problem] = []
    edges = [0, *(np.flatnonzero(np.diff(t) > 4.5 * step) + 1).tolist(), len(t)]
    start, end = max(pairwise(edges), key=lambda pair: t[pair[1] - 1] - t[pair[0]])
    if end - start < len(t):
        findings.append(
            Problem(message=f"the record has gaps; its longest whole stretch, {t[start]:.4g} to {t[end - 1]:.4g} s, is used",
                    code="gaps")
        )  # fmt: skip
    t, u, y = t[start:end], u[start:end], y[start:end]
    steps = np.diff(t)
    if len(steps) and float(np.ptp(steps)) > 0.01 * step:
        findings.append(
            Problem(message=f"uneven sampling is brought to an even {step * 1e3:.4g} ms by linear interpolation", code="jitter")
        )
        grid = t[0] + step * np.arange(math.floor((t[-1] - t[0]) / step + 1e-9) + 1)
        u, y, t = np.interp(grid, t, u), np.interp(grid, t, y), grid
    else:
        # Rounding of the stamps must not add up over a long record.
        t = np.linspace(t[0], t[-1], len(t))
    return t, u, y, findings


def local_rational(u: Array, y: Array, step: float, low: float, high: float) -> Spectra:
    """Local rational estimate at the transform's frequencies in the band, from the whole record without a window.

    At bin k + r, with r scaled to -1 ... 1:  (1 + d1 r + d2 r^2) Y = (g0 + g1 r + g2 r^2) U + t0 + t1 r; g0 is the response.
    The numerator over the denominator holds one lightly damped resonance exactly, and t0 + t1 r what the record's start and
    end leave (leakage). Least squares, twice repeated with the denominator's weight (Sanathanan and Koerner). Where the fit
    without denominator is as good, that one is taken. The residual gives the response's variance, stated as the coherence
    that has this variance with as many averages.
    """
    n = len(u)
    transform_u = np.fft.rfft(u - np.mean(u)) / n
    transform_y = np.fft.rfft(y - np.mean(y)) / n
    f = np.fft.rfftfreq(n, step)
    last = len(f) - 1
    bins = np.flatnonzero((f >= low) & (f <= high))
    half = int(np.clip(len(bins) // 6, *_HALF))
    if last < 2 * half + 2 or not len(bins):
        raise RecordingError(Problem(message="the record is too short for its band", code="too-short"))
    if len(bins) > _MOST:
        bins = bins[np.unique(np.linspace(0, len(bins) - 1, _MOST).round().astype(int))]
    # Windows are shifted inwards at the ends (bin 0 holds the removed mean), so r is not centred there.
    index = np.clip(bins, half + 1, last - half)[:, None] + np.arange(-half, half + 1)
    r = (index - bins[:, None]) / half
    powers = np.stack([np.ones_like(r), r, r**2], axis=-1)
    local_u, size_u = _scaled(transform_u[index])
    local_y, size_y = _scaled(transform_y[index])
    gain, leak, poles = powers * local_u[..., None], powers[..., :2] + 0j, -powers[..., 1:] * local_y[..., None]
    rational = _fit(np.concatenate([gain, leak, poles], axis=-1), local_y, powers)
    smooth = _fit(np.concatenate([gain, leak], axis=-1), local_y, None)
    # Without a resonance nearby the denominator only fits noise, and is biased by it: then the polynomial is better.
    plain = smooth.noise <= _AS_GOOD * rational.noise
    response = np.where(plain, smooth.response, rational.response)
    variance = np.where(plain, smooth.variance, rational.variance)
    relative = variance / np.maximum(np.abs(response) ** 2, 1e-300)
    freedom = 2 * half + 1 - 7
    return Spectra(
        frequency=np.asarray(f[bins], dtype=np.float64),
        response=np.asarray(response * (size_y / size_u)[:, 0], dtype=np.complex128),
        coherence=1 / (1 + freedom * relative), averages=float(freedom), resolution=1.0 / (n * step),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """Local fits at k frequencies."""

    response: NDArray[np.complex128]
    """(k,)."""
    variance: Array
    """(k,) of the response."""
    noise: Array
    """(k,) residual power of the output a degree of freedom."""


def _fit(matrix: NDArray[np.complex128], output: NDArray[np.complex128], powers: Array | None) -> _Fit:
    """Least squares of the output (k, w) on the columns of the matrix (k, w, p), whose first one is the response.

    powers: (k, w, 3); the last two columns then are a denominator's, and the fit is repeated with its weight.
    """
    weight = np.ones(output.shape)
    for _ in range(1 if powers is None else 3):
        # By singular values, which drop what an unexcited neighbourhood leaves open.
        inverse = np.linalg.pinv(matrix * weight[..., None], rcond=1e-10)
        solution = np.einsum("kpw,kw->kp", inverse, output * weight)
        used = weight
        if powers is not None:
            denominator = np.abs(1 + np.einsum("kwp,kp->kw", powers[..., 1:], solution[:, -2:]))
            weight = 1 / np.maximum(denominator, 1e-3)
    residual = (output - np.einsum("kwp,kp->kw", matrix, solution)) * used
    noise = np.sum(np.abs(residual) ** 2, axis=1) / (matrix.shape[1] - matrix.shape[2])
    return _Fit(response=solution[:, 0], variance=np.sum(np.abs(inverse[:, 0]) ** 2, axis=1) * noise, noise=noise)


def _scaled(values: NDArray[np.complex128]) -> tuple[NDArray[np.complex128], Array]:
    """Rows scaled to a root mean square of 1, and their sizes (k, 1)."""
    size = np.sqrt(np.mean(np.abs(values) ** 2, axis=1, keepdims=True))
    size[size == 0] = 1.0
    return values / size, size


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
        raise RecordingError(Problem(message="no line of the excitation is resolved", code="too-short"))
    # A line is spread over three bins around it; taken together they stand for its true frequency.
    around = np.clip(lines[:, None] + np.arange(-1, 2), 0, len(f) - 1)
    line_u, line_y, line_cross = power_u[around].sum(axis=1), power_y[around].sum(axis=1), cross[around].sum(axis=1)
    frequency = np.sum(f[around] * power_u[around], axis=1) / line_u
    raw = np.abs(line_cross) ** 2 / np.maximum(line_u * line_y, 1e-300)
    # Pure noise shows 1/averages; removed, so that 0 means no relation.
    coherence = np.clip((raw - 1 / averages) / (1 - 1 / averages), 0, 1) if averages > 1 else raw
    return Spectra(
        frequency=np.asarray(frequency, dtype=np.float64), response=line_cross / line_u, coherence=coherence,
        averages=averages, resolution=1.0 / (segment * step),
    )  # fmt: skip
