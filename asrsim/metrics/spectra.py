"""Result of a frequency response estimator, and resampling of records to an even step."""

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
    """Relative standard deviation (m,) of the complex response. The deviation of the real part, or of the imaginary part, is
    smaller by the factor sqrt(2).
    """
    freedom: float
    """Number of complex degrees of freedom from which each deviation is estimated."""


def uniform(time: Array, u: Array, y: Array) -> tuple[Array, Array, Array, list[Problem]]:
    """The two series, resampled to an even step (the median step) on the longest segment without a gap of over three
    samples."""
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
            Problem(
                f"the record has gaps; its longest segment without gaps, {t[start]:.4g} to {t[end - 1]:.4g} s, is used",
                code="gaps",
            )
        )
    t, u, y = t[start:end], u[start:end], y[start:end]
    steps = np.diff(t)
    if len(steps) and float(np.ptp(steps)) > 0.01 * step:
        findings.append(
            Problem(f"uneven sampling is interpolated linearly to an even step of {step * 1e3:.4g} ms", code="jitter")
        )
        grid = t[0] + step * np.arange(math.floor((t[-1] - t[0]) / step + 1e-9) + 1)
        u, y, t = np.interp(grid, t, u), np.interp(grid, t, y), grid
    else:
        # Use equidistant times, so that rounding errors of the time stamps do not accumulate over a long record.
        t = np.linspace(t[0], t[-1], len(t))
    return t, u, y, findings
