"""Dominant oscillation of a series: a decaying oscillation after a step, or a sustained one."""

from __future__ import annotations

import math

import numpy as np

from asrsim.metrics.values import steady_state
from asrsim.samples import Array

_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_FLOOR = (0.001, 0.03)
"""Smallest and largest noise threshold of the zero crossings, as a fraction of the largest excursion."""

STILL = 1e-12
"""Smallest variation that counts as motion, in rad, m or the unit of the series; less is rounding."""


def frequency(time: Array, values: Array, *, lowest: float = 0.0) -> float:
    """Frequency in Hz of the dominant oscillation about the steady state; undefined without an oscillation.

    While the oscillation exceeds the residual motion at the end: slope of a straight line through the times of the
    interpolated zero crossings (least squares, both directions together), exact for a damped oscillation with even crossings.
    For uneven crossings (several modes, noise): peak of the Hann-windowed Fourier transform, refined between bins. Fewer than
    two crossings in a direction count as no oscillation.

    lowest: lower limit of the frequency, Hz; slower motions (a drift, a moving reference) are ignored.
    """
    return frequencies(time, values[None], np.array([steady_state(time, values)]), lowest=lowest)[0]


def frequencies(time: Array, values: Array, steady: Array, *, lowest: float = 0.0) -> list[float]:
    """Frequencies as from `frequency`, of series (m, n) with steady states (m,)."""
    if len(time) < 8:
        return [math.nan] * len(values)
    high, low = values.max(axis=1), values.min(axis=1)
    # Steady state of a decaying oscillation, mean of a sustained one.
    tail = values[:, len(time) // 2 :]
    decays = tail.max(axis=1) - tail.min(axis=1) < 0.5 * (high - low)
    x = values - np.where(decays, steady, 0.5 * (high + low))[:, None]
    largest = np.abs(x).max(axis=1)
    noise = 4 * x[:, -max(len(time) // 10, 2) :].std(axis=1)
    floors = np.minimum(np.maximum(noise, _FLOOR[0] * largest), _FLOOR[1] * largest)
    moved = (high - low > STILL).tolist()
    return [
        _frequency(time, row, floor, lowest) if moves else math.nan
        for row, floor, moves in zip(x, floors.tolist(), moved, strict=True)
    ]


def _frequency(time: Array, x: Array, floor: float, lowest: float) -> float:
    up, down = _crossings(time, x, floor)
    if min(len(up), len(down)) >= 2:
        found = _even(up, down)
        if found is not None and found > lowest:
            return found
    elif lowest == 0.0:
        return math.nan
    # Exclude the approach to the steady state and the rest there: their spectrum would outweigh a short oscillation.
    crossed = sorted(up + down) or [float(time[0])]
    ringing = (time >= crossed[0]) & (time <= crossed[-1]) if len(crossed) > 3 else time >= crossed[0]
    return _spectral_peak(time[ringing], x[ringing], lowest) if ringing.sum() >= 8 else math.nan


def _crossings(time: Array, x: Array, floor: float) -> tuple[list[float], list[float]]:
    """Times of the upward and downward crossings, with hysteresis against noise between -`floor` and `floor`."""
    marks = np.flatnonzero(np.abs(x) > floor)
    above = x[marks] > 0.0
    turns = np.flatnonzero(above[1:] != above[:-1])
    up: list[float] = []
    down: list[float] = []
    for a, b in zip(marks[turns].tolist(), marks[turns + 1].tolist(), strict=True):
        part = x[a : b + 1].tolist()
        rises = part[-1] > 0.0
        i = a + next(k for k, value in enumerate(part) if (value > 0.0 if rises else value < 0.0))
        moment = time[i - 1] + x[i - 1] / (x[i - 1] - x[i]) * (time[i] - time[i - 1])
        (up if rises else down).append(float(moment))
    return up, down


def _even(up: list[float], down: list[float]) -> float | None:
    """Frequency of evenly spaced crossings, None for uneven ones.

    Both directions share the period but have separate starts: a wrong mean value shifts the starts, not the spacing.
    """
    rows = [(count, 1.0, 0.0) for count in range(len(up))] + [(count, 0.0, 1.0) for count in range(len(down))]
    matrix, targets = np.array(rows), np.array(up + down)
    solution, *_ = np.linalg.lstsq(matrix, targets, rcond=None)
    period = float(solution[0])
    if period <= 0 or float(np.max(np.abs(targets - matrix @ solution))) > 0.1 * period:
        return None
    return 1.0 / period


def _spectral_peak(time: Array, x: Array, lowest: float) -> float:
    """Frequency of the largest magnitude of the windowed transform, not restricted to its bins."""
    step = float(np.median(np.diff(time)))
    grid = np.arange(time[0], time[-1] + 0.5 * step, step)
    window = np.hanning(len(grid))
    y = (np.interp(grid, time, x) - np.mean(x)) * window
    # A power of two: transform lengths with large prime factors take ten times the memory.
    size = 1 << (2 * len(grid) - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(y, size))
    bins = np.fft.rfftfreq(size, step)
    # Below one period per record the window's main lobe dominates; its flank may reach higher, but is not a peak.
    allowed = bins >= max(lowest, 1.0 / (grid[-1] - grid[0]))
    allowed[1:-1] &= (spectrum[1:-1] >= spectrum[:-2]) & (spectrum[1:-1] >= spectrum[2:])
    if not allowed.any():
        return math.nan
    coarse = float(bins[allowed][np.argmax(spectrum[allowed])])
    width = float(bins[1])

    def magnitude(f: float) -> float:
        return abs(complex(np.dot(y, np.exp(-2j * np.pi * f * (grid - grid[0])))))

    # Golden-section search: the main lobe of the window has one maximum and is wider than four bins.
    low, high = max(coarse - width, 0.0), coarse + width
    inner, outer = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_inner, at_outer = magnitude(inner), magnitude(outer)
    while high - low > 1e-6 * coarse:
        if at_inner > at_outer:
            high, outer, at_outer = outer, inner, at_inner
            inner = high - _GOLDEN * (high - low)
            at_inner = magnitude(inner)
        else:
            low, inner, at_inner = inner, outer, at_outer
            outer = low + _GOLDEN * (high - low)
            at_outer = magnitude(outer)
    return 0.5 * (low + high)
