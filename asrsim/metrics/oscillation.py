"""Dominant oscillation of a series: a decaying oscillation after a step, or a sustained oscillation."""

from __future__ import annotations

import math

import numpy as np

from asrsim.metrics.rest import SHARE
from asrsim.metrics.values import last_part, mean
from asrsim.samples import Array

_FLOOR = (0.001, 0.03)
"""Smallest and largest noise threshold of the zero crossings, as a fraction of the largest excursion."""

STILL = 1e-12
"""Smallest variation that counts as motion, in the unit of the series; smaller variations are rounding errors."""


def frequency(time: Array, values: Array) -> float:
    """Frequency in Hz of the dominant oscillation about the steady state; undefined without an oscillation.

    The frequency follows from the slope of a straight line through the times of the interpolated zero crossings, while the
    oscillation exceeds the residual motion at the end (least squares, both directions together). This is exact for a damped
    oscillation with even crossings. For uneven crossings (several modes, noise), the frequency is the peak of the Hann-windowed
    Fourier transform, refined between bins. Fewer than two crossings in a direction count as no oscillation.
    """
    largest, smallest = float(np.max(values)), float(np.min(values))
    if len(time) < 8 or not largest - smallest > STILL:
        return math.nan
    # A decaying oscillation is about its steady state, and a sustained oscillation is about the middle of its range.
    decays = np.ptp(values[len(time) // 2 :]) < 0.5 * (largest - smallest)
    x = values - (mean(*last_part(time, values, SHARE)) if decays else 0.5 * (largest + smallest))
    excursion = float(np.max(np.abs(x)))
    noise = 4 * float(np.std(x[-max(len(time) // 10, 2) :]))
    up, down = _crossings(time, x, min(max(noise, _FLOOR[0] * excursion), _FLOOR[1] * excursion))
    if min(len(up), len(down)) < 2:
        return math.nan
    even = _even(up, down)
    if even is not None:
        return even
    # Use only the part between the first and the last crossing. The approach to the steady state and the time at rest after it
    # would otherwise dominate the spectrum.
    crossed = sorted(up + down)
    ringing = (time >= crossed[0]) & (time <= crossed[-1])
    return _spectral_peak(time[ringing], x[ringing]) if ringing.sum() >= 8 else math.nan


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
    """Frequency of evenly spaced crossings, None for unevenly spaced crossings.

    Upward and downward crossings have one period but separate first times, since a wrong mean value shifts the first times and
    not the period.
    """
    rows = [(count, 1.0, 0.0) for count in range(len(up))] + [(count, 0.0, 1.0) for count in range(len(down))]
    matrix, targets = np.array(rows), np.array(up + down)
    solution, *_ = np.linalg.lstsq(matrix, targets, rcond=None)
    period = float(solution[0])
    if period <= 0 or float(np.max(np.abs(targets - matrix @ solution))) > 0.1 * period:
        return None
    return 1.0 / period


def _spectral_peak(time: Array, x: Array) -> float:
    """Frequency of the largest magnitude of the windowed transform, refined between bins by a parabola."""
    step = float(np.median(np.diff(time)))
    grid = np.arange(time[0], time[-1] + 0.5 * step, step)
    y = (np.interp(grid, time, x) - np.mean(x)) * np.hanning(len(grid))
    # Append zeros to the record, so that the bins are finer. Use a power of two, since transforms of lengths with large prime
    # factors take ten times the memory.
    size = 1 << (8 * len(grid) - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(y, size))
    bins = np.fft.rfftfreq(size, step)
    # Leave out frequencies below one period per record, at which the main lobe of the window dominates. Its flank may be higher
    # than the peak.
    allowed = bins >= 1.0 / (grid[-1] - grid[0])
    allowed[[0, -1]] = False
    allowed[1:-1] &= (spectrum[1:-1] >= spectrum[:-2]) & (spectrum[1:-1] >= spectrum[2:])
    if not allowed.any():
        return math.nan
    peak = int(np.argmax(np.where(allowed, spectrum, 0.0)))
    before, at, after = np.log(np.maximum(spectrum[peak - 1 : peak + 2], 1e-300))
    bend = before - 2 * at + after
    return float(bins[peak] + (0.5 * (before - after) / bend * bins[1] if bend < 0 else 0.0))
