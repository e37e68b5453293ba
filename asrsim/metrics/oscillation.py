"""The dominant oscillation of a series: a free ringing after a step, or a sustained one."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from asrsim.metrics.values import steady_state
from asrsim.samples import Array

_FLOOR = 0.03
"""Share of the largest excursion below which crossings are noise."""


def frequency(time: Array, values: Array, *, lowest: float = 0.0) -> float:
    """Frequency in Hz of the dominant oscillation about the steady state; undefined where there is none.

    From the zero crossings of one direction, interpolated, while the oscillation is larger than 3 % of its largest
    excursion: a straight line through their times (least squares, both directions together), which is exact for a damped
    oscillation, whose crossings are evenly spaced. With less than three crossings a direction, or uneven ones (several
    modes, noise), the peak of the Hann-windowed Fourier transform, refined between its bins.

    lowest: Hz; slower oscillations are not looked for (a drift, a reference that moves).
    """
    if len(time) < 8 or np.ptp(values) <= 0:
        return math.nan
    x = values - _midline(time, values)
    by_crossings = _crossings(time, x)
    if by_crossings is not None and by_crossings > lowest:
        return by_crossings
    return _spectral_peak(time, x, lowest)


def _midline(time: Array, values: Array) -> float:
    """Steady state of a decaying oscillation, middle of a sustained one."""
    steady = steady_state(time, values)
    tail = values[len(values) // 2 :]
    decays = np.ptp(tail) < 0.5 * np.ptp(values)
    return steady if decays else 0.5 * float(np.max(values) + np.min(values))


def _crossings(time: Array, x: Array) -> float | None:
    """Frequency by crossings, None where they are too few or uneven."""
    largest = float(np.max(np.abs(x)))
    alive = np.flatnonzero(np.abs(x) > _FLOOR * largest)
    if len(alive) < 2:
        return None
    t, y = time[: alive[-1] + 2], x[: alive[-1] + 2]
    # Hysteresis: a crossing counts once the excursion after it is large enough.
    state = np.where(y > _FLOOR * largest, 1, np.where(y < -_FLOOR * largest, -1, 0))
    marks = np.flatnonzero(state)
    changes = [(int(a), int(b)) for a, b in pairwise(marks) if state[a] != state[b]]
    times: dict[int, list[float]] = {1: [], -1: []}
    for a, b in changes:
        part = y[a : b + 1] * state[b]
        i = a + int(np.flatnonzero(part > 0)[0])
        moment = t[i - 1] + y[i - 1] / (y[i - 1] - y[i]) * (t[i] - t[i - 1])
        times[int(state[b])].append(float(moment))
    if min(len(times[1]), len(times[-1])) < 3:
        return None
    # One period for both directions, each with a start of its own (a wrong midline shifts them apart, not their spacing).
    rows, targets = [], []
    for column, key in enumerate((1, -1)):
        for count, moment in enumerate(times[key]):
            rows.append((count, column == 0, column == 1))
            targets.append(moment)
    solution, *_ = np.linalg.lstsq(np.array(rows, dtype=float), np.array(targets), rcond=None)
    period = float(solution[0])
    scatter = np.array(targets) - np.array(rows, dtype=float) @ solution
    if period <= 0 or np.max(np.abs(scatter)) > 0.1 * period:
        return None
    return 1.0 / period


def _spectral_peak(time: Array, x: Array, lowest: float) -> float:
    """Peak of the magnitude of the windowed transform, at any frequency, not only at bins."""
    from scipy.optimize import minimize_scalar

    step = float(np.median(np.diff(time)))
    grid = np.arange(time[0], time[-1] + 0.5 * step, step)
    window = np.hanning(len(grid))
    y = (np.interp(grid, time, x) - np.mean(x)) * window
    size = 4 * len(grid)
    spectrum = np.abs(np.fft.rfft(y, size))
    bins = np.fft.rfftfreq(size, step)
    # Below one period in the record the window's own lobe rules.
    allowed = bins >= max(lowest, 1.0 / (grid[-1] - grid[0]))
    if not allowed.any():
        return math.nan
    coarse = float(bins[allowed][np.argmax(spectrum[allowed])])
    width = float(bins[1])

    def magnitude(f: float) -> float:
        return -abs(complex(np.dot(y, np.exp(-2j * np.pi * f * (grid - grid[0])))))

    found = minimize_scalar(magnitude, bounds=(max(coarse - 2 * width, 0.0), coarse + 2 * width), method="bounded",
                            options={"xatol": 1e-6 * max(coarse, 1e-9)})  # fmt: skip
    return float(found.x)
