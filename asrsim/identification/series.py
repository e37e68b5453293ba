"""Series of samples: between them, and where they begin."""

from __future__ import annotations

import numpy as np

from asrsim.identification.data import Channel
from asrsim.samples import Array

FIRST = 15
"""Samples, at most, from which the start of a link is told."""
LONG = 10
"""Of these, at least, a mean tells more than the first sample."""
SOON = 0.05
"""s after 0 at which a channel must begin to tell of the start."""


def first_samples(channel: Channel) -> tuple[float, float, float, float] | None:
    """Value and slope at 0 of a channel's first samples, by a parabola, with their standard errors."""
    if len(channel.time) < 6 or channel.time[0] > SOON:
        return None
    count = max(6, min(FIRST, int(np.sum(channel.time <= channel.time[0] + 0.03))))
    time, values = channel.time[:count], channel.values[:count]
    inverse = np.linalg.pinv(np.column_stack([np.ones(count), time, time**2]))
    errors = max(channel.noise, channel.quantum) * np.sqrt(np.sum(inverse**2, axis=1))
    place, slope, _ = inverse @ values
    return float(place), float(slope), float(errors[0]), float(errors[1])


def at_rest(channel: Channel) -> tuple[float, float]:
    """Value at 0 of a channel that may move at once, and its error: of the first sample, or of many before it moves."""
    moved = np.abs(channel.values - np.median(channel.values[:5])) > 4.0 * max(channel.noise, channel.quantum)
    still = int(np.argmax(moved)) // 2 if moved.any() else len(moved)
    count = still if still >= LONG else 1
    return float(np.mean(channel.values[:count])), float(np.hypot(channel.noise / np.sqrt(count), channel.quantum))


def interpolate(series: Array, place: Array) -> Array:
    """Series (n,) at places (m,) in samples, by cubics through four samples; the ends hold."""
    last = len(series) - 1
    place = np.clip(place, 0.0, last)
    nearest = np.round(place)
    if np.abs(place - nearest).max(initial=0.0) < 1e-6:
        return np.asarray(series[nearest.astype(np.intp)])
    if last < 3:
        return np.interp(place, np.arange(last + 1), series)
    base = np.clip(np.floor(place).astype(np.intp), 1, last - 2)
    t = place - base
    a, b, c, d = (series[base + i] for i in (-1, 0, 1, 2))
    return np.asarray(
        -t * (t - 1.0) * (t - 2.0) / 6.0 * a + (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0 * b
        - (t + 1.0) * t * (t - 2.0) / 2.0 * c + (t + 1.0) * t * (t - 1.0) / 6.0 * d
    )  # fmt: skip


def smoothed(values: Array, cutoff: float) -> Array:
    """Series (n,) without what is faster than the cutoff, a share of half its rate: Butterworth's fourth order, to and fro."""
    n, line = len(values), np.linspace(values[0], values[-1], len(values))
    # Odd about both ends, so that it begins and ends where the series does; scipy.signal takes half a second to import.
    odd = np.concatenate([values - line, (line - values)[::-1]])
    ratio = np.tan(np.pi * np.fft.rfftfreq(2 * n)) / np.tan(0.5 * np.pi * cutoff)
    return np.asarray(np.fft.irfft(np.fft.rfft(odd) / (1.0 + ratio**8), 2 * n)[:n] + line)
