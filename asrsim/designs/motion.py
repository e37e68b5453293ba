"""Motions of references. A motion consists of pieces, and a piece combines levels and a sine. Each piece begins and ends at
rest, at the initial values of the references.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.samples import Array
from asrsim.signals.common import minimum_jerk

KNOTS = 3
"""Number of levels in a piece. It is also the number of values from which the curves of a piece, such as its frequency over
time, are interpolated.
"""
LEVELS, SINES, FREQUENCIES, GOALS = (slice(i * KNOTS, (i + 1) * KNOTS) for i in range(4))
PHASE, RISE = slice(4 * KNOTS, 4 * KNOTS + 1), slice(4 * KNOTS + 1, 4 * KNOTS + 2)
PARTS, CHANCES = (LEVELS, SINES, FREQUENCIES, GOALS, PHASE, RISE), (0.25, 0.15, 0.25, 0.15, 0.1, 0.1)
"""PARTS: free numbers of a piece for each reference, all from 0 to 1. They are levels (0.5 is the initial value of the
reference), weight of the sine relative to the levels, frequencies, used fractions of the limits, phase, and duration of a
change of level.
CHANCES: probabilities with which a variation changes each of these parts.
"""
WINDOWS = 8
"""Number of windows of a piece. In each window, the motion is scaled separately so that it keeps the limits."""
SLOWEST, FASTEST = 0.3, 16.0
"""SLOWEST: lowest frequency of the sines, Hz.
FASTEST: highest frequency of the sines, Hz.
"""
QUICKEST, LONGEST = 0.01, 0.25
"""QUICKEST: shortest duration of a change of level, s.
LONGEST: longest duration of such a change, as a fraction of the piece's duration.
"""


def ramp(share: Array) -> Array:
    """Smooth step from 0 to 1 with continuous acceleration, for arguments from 0 to 1."""
    return minimum_jerk(np.clip(share, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class Piece:
    """Part of a motion, for all references of the robot."""

    numbers: Array
    """Free numbers (references, n) from 0 to 1; see `PARTS`."""
    scales: Array
    """Sizes of the motion, (references, windows). A motion of size 1 covers the whole range of the reference."""

    def values(self, time: Array, length: float) -> Array:
        """Values (references, n) of the piece as fractions of each reference's range, from -1 to 1. time: times (n,) since the
        start of the piece, s; length: duration of the piece, s.
        """
        middles = _middles(self.scales.shape[1]) * length
        rows = [
            np.interp(time, middles, scales) * _row(u, time, length)
            for u, scales in zip(self.numbers, self.scales, strict=True)
        ]
        return np.asarray(np.clip(rows, -1.0, 1.0))

    def scaled(self, factors: Array) -> Piece:
        """Piece whose sizes are multiplied by factors (references, windows)."""
        return replace(self, scales=np.clip(self.scales * factors, 1e-4, 4.0))

    @property
    def goals(self) -> Array:
        """Fractions of the limits that the motion should use, (references, windows)."""
        middles, knots = _middles(self.scales.shape[1]), np.linspace(0.0, 1.0, KNOTS)
        return np.array([np.interp(middles, knots, u[GOALS]) for u in self.numbers])


def _middles(windows: int) -> Array:
    return np.asarray((np.arange(windows) + 0.5) / windows)


def _row(u: Array, time: Array, length: float) -> Array:
    edges, knots = np.linspace(0.0, 0.9 * length, KNOTS + 1), np.linspace(0.0, length, KNOTS)
    rise = QUICKEST * max(LONGEST * length / QUICKEST, 1.0) ** u[RISE]
    jumps = np.diff(np.append(2.0 * u[LEVELS] - 1.0, 0.0), prepend=0.0)
    levels = sum(jump * ramp((time - edge) / rise) for jump, edge in zip(jumps, edges, strict=True))
    levels *= ramp((0.97 * length - time) / (0.02 * length))
    frequency = SLOWEST * (FASTEST / SLOWEST) ** np.interp(time, knots, u[FREQUENCIES])
    sine = np.sin(2.0 * np.pi * (np.cumsum(frequency) * (time[1] - time[0]) + u[PHASE]))
    sine *= ramp(time / (0.03 * length)) * ramp((0.97 * length - time) / (0.05 * length))
    share = np.interp(time, knots, u[SINES])
    return np.asarray((1.0 - share) * levels + share * sine)


def chirp(presets: Array, first: float, last: float, preset: float = 0.0) -> Piece:
    """Chirp of the references, while stiffness presets are constant. presets: whether each reference is a stiffness preset;
    first, last: frequencies of the chirp, Hz; preset: fraction of the range of the presets, from -1 to 1.
    """
    numbers = np.full((len(presets), RISE.stop), 0.5)
    numbers[:, FREQUENCIES] = np.log(np.geomspace(first, last, KNOTS) / SLOWEST) / np.log(FASTEST / SLOWEST)
    numbers[:, SINES] = np.where(presets, 0.0, 1.0)[:, None]
    numbers[:, LEVELS] += 0.5 * np.where(presets, preset, 0.0)[:, None]
    numbers[:, GOALS], numbers[:, PHASE] = 1.0, 0.0
    return Piece(numbers, np.where(presets, 1.0, 0.3)[:, None] * np.ones(WINDOWS))


def step(presets: Array) -> Piece:
    """One quick step of the references, while stiffness presets are constant. presets: whether each reference is a stiffness
    preset.
    """
    base = chirp(presets, SLOWEST, SLOWEST)
    base.numbers[:, LEVELS] = np.where(presets, 0.5, 1.0)[:, None]
    base.numbers[:, SINES] = base.numbers[:, RISE] = 0.0
    return base


def fresh(generator: np.random.Generator, presets: Array) -> Piece:
    """Random piece: a chirp with random frequencies and constant stiffness presets, in which random numbers replace some of the
    free numbers.
    """
    first, last = SLOWEST * (FASTEST / SLOWEST) ** generator.random(2)
    base = chirp(presets, first, last, generator.choice([-1.0, 0.0, 1.0]))
    for row in base.numbers:
        for part in PARTS:
            if generator.random() < 0.4:
                row[part] = generator.random(len(row[part]))
    return base


def varied(piece: Piece, generator: np.random.Generator) -> Piece:
    """Piece in which small random changes are added to some of the free numbers."""
    numbers, size = piece.numbers.copy(), 0.6 * 16.0 ** -generator.random()
    for _ in range(1 + generator.poisson(1.0)):
        part = PARTS[generator.choice(len(PARTS), p=CHANCES)]
        together = generator.random() < 0.4
        numbers[generator.integers(len(numbers)), part] += size * generator.normal(
            size=1 if together else part.stop - part.start
        )
    numbers[:, PHASE] %= 1.0
    # Reflect numbers at 0 and 1. If they were clipped, they would too often be exactly 0 or 1.
    return Piece(1.0 - np.abs(1.0 - np.abs(numbers) % 2.0), piece.scales)


def joined(pieces: Sequence[Piece], step: float, rows: int) -> Array:
    """Motion (references, rows) of successive pieces of equal duration. The last row is at rest. step: time step, s."""
    edges = np.round(np.linspace(0, rows - 1, len(pieces) + 1)).astype(int)
    motion = np.zeros((len(pieces[0].scales), rows))
    for piece, first, last in zip(pieces, edges, edges[1:], strict=False):
        motion[:, first:last] = piece.values(step * np.arange(last - first), step * (last - first))
    return motion
