"""Motions of references: segments of levels and sines, which begin and end at rest at the references of the start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.samples import Array

KNOTS = 3
"""Number of levels of a segment; amplitude and frequency of its sine are interpolated between the same number of values."""
LEVELS, AMPLITUDES, FREQUENCIES = slice(0, KNOTS), slice(KNOTS, 2 * KNOTS), slice(2 * KNOTS, 3 * KNOTS)
PHASE, RISE = 3 * KNOTS, 3 * KNOTS + 1
NUMBERS = RISE + 1
"""Number of free parameters of a segment for each reference. Each is between 0 and 1; a level of 0.5 is the reference of the
start.
"""
SLOWEST, FASTEST = 0.4, 16.0
"""Lowest and highest frequency of the sines, Hz."""
QUICKEST, LONGEST = 0.01, 0.25
"""Shortest duration of a change of level, s; longest duration, as a fraction of the segment."""


def ramp(share: Array) -> Array:
    """Smooth step from 0 to 1 for arguments from 0 to 1, with continuous acceleration."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


@dataclass(frozen=True, eq=False)
class Segment:
    """Part of a motion, for all references."""

    numbers: Array
    """Free numbers of the segment (references, NUMBERS), from 0 to 1."""
    scales: Array
    """Sizes (references,) of the motion; size 1 covers the whole range of the reference."""

    def values(self, time: Array, length: float) -> Array:
        """Motion (references, n) as fractions of each reference's range, from -1 to 1."""
        rows = [scale * _row(numbers, time, length) for numbers, scale in zip(self.numbers, self.scales, strict=True)]
        return np.asarray(np.clip(rows, -1.0, 1.0))

    def scaled(self, factors: Array) -> Segment:
        """Segment with each reference's motion multiplied by a factor."""
        return replace(self, scales=np.minimum(self.scales * factors, 4.0))

    def beyond(self, old: Segment) -> Segment:
        """Extrapolated segment, which differs from this segment as this segment differs from an old segment."""
        return Segment(np.clip(2.0 * self.numbers - old.numbers, 0.0, 1.0), self.scales**2 / np.maximum(old.scales, 1e-9))


def _row(u: Array, time: Array, length: float) -> Array:
    edges, knots = np.linspace(0.0, 0.9 * length, KNOTS + 1), np.linspace(0.0, length, KNOTS)
    rise = QUICKEST * (max(LONGEST * length / QUICKEST, 1.0)) ** u[RISE]
    jumps = np.diff(np.append(2.0 * u[LEVELS] - 1.0, 0.0), prepend=0.0)
    levels = sum(jump * ramp((time - edge) / rise) for jump, edge in zip(jumps, edges, strict=True))
    frequency = SLOWEST * (FASTEST / SLOWEST) ** np.interp(time, knots, u[FREQUENCIES])
    cycles = np.cumsum(frequency) * (time[1] - time[0]) + u[PHASE]
    window = ramp(time / (0.05 * length)) * ramp((0.95 * length - time) / (0.08 * length))
    sine = np.interp(time, knots, u[AMPLITUDES]) * np.sin(2.0 * np.pi * cycles) * window
    return np.asarray(levels * ramp((0.97 * length - time) / (0.02 * length)) + sine)


def chirp(presets: Array, first: float, last: float, preset: Array | float = 0.0) -> Segment:
    """Chirp between two frequencies in Hz, while stiffness presets stay at a fraction, from -1 to 1, of their range."""
    numbers = np.full((len(presets), NUMBERS), 0.5)
    octaves = np.log(np.array([first, last]) / SLOWEST) / np.log(FASTEST / SLOWEST)
    numbers[:, FREQUENCIES] = np.linspace(octaves[0], octaves[1], KNOTS)
    numbers[:, AMPLITUDES] = np.where(presets, 0.0, 1.0)[:, None]
    numbers[:, LEVELS] += 0.5 * np.where(presets, preset, 0.0)[:, None]
    numbers[:, PHASE] = 0.0
    return Segment(numbers, np.where(presets, 1.0, 0.3))


def step(presets: Array) -> Segment:
    """One quick step of the references; stiffness presets stay constant."""
    numbers = np.full((len(presets), NUMBERS), 0.5)
    numbers[:, LEVELS] = np.where(presets, 0.5, 1.0)[:, None]
    numbers[:, AMPLITUDES] = numbers[:, RISE] = 0.0
    return Segment(numbers, np.where(presets, 1.0, 0.3))


def fresh(generator: np.random.Generator, presets: Array) -> Segment:
    """Chirp with random frequencies and constant stiffness presets; some of its levels, amplitudes and frequencies
    are random.
    """
    first, last = SLOWEST * (FASTEST / SLOWEST) ** np.sort(generator.random(2))
    simple = chirp(presets, first, last, generator.choice([-1.0, 0.0, 1.0, 1.0], len(presets)))
    numbers = generator.random(simple.numbers.shape)
    for row, known in zip(numbers, simple.numbers, strict=True):
        for part in (LEVELS, AMPLITUDES, FREQUENCIES):
            if generator.random() < 0.7:
                row[part] = known[part]
    return replace(simple, numbers=numbers)


def varied(segment: Segment, generator: np.random.Generator, presets: Array) -> Segment:
    """Segment with some numbers changed a little."""
    size = 0.4 * 20.0 ** -generator.random()
    some = generator.random(segment.numbers.shape) < max(1.5 / segment.numbers.size, 0.5 * generator.random() ** 2)
    moved = segment.numbers + size * some * generator.normal(size=some.shape)
    factors = np.where(presets, 1.0, np.exp(0.5 * size * generator.normal(size=len(presets))))
    # Numbers are reflected at their bounds, so that the bounds are not reached too often.
    return Segment(1.0 - np.abs(1.0 - np.abs(moved) % 2.0), segment.scales * factors)


def joined(segments: Sequence[Segment], step: float, rows: int) -> Array:
    """Motion (references, rows) of segments of equal length, one after the other; the last row is at rest."""
    edges = np.round(np.linspace(0, rows - 1, len(segments) + 1)).astype(int)
    motion = np.zeros((len(segments[0].scales), rows))
    for segment, first, last in zip(segments, edges, edges[1:], strict=False):
        motion[:, first:last] = segment.values(step * np.arange(last - first), step * (last - first))
    return motion
