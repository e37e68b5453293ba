"""Motions of references: families of segments with free numbers, which begin and end at rest at the start's references."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.samples import Array

NUMBERS = 8
"""Free numbers of a segment in each reference, from 0 to 1."""
FASTEST, SLOWEST = 0.004, 0.25
"""s that a change of level takes at least; share of the segment that it takes at most."""
HIGHEST = 25.0
"""Hz of sines."""


def ramp(place: Array) -> Array:
    """From 0 to 1 between 0 and 1, with continuous acceleration."""
    s = np.clip(place, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def _window(time: Array, length: float) -> Array:
    return np.asarray(ramp(time / (0.1 * length)) * ramp((0.95 * length - time) / (0.1 * length)))


def _frequency(number: float, length: float) -> float:
    low = 1.0 / length
    return float(low * (max(HIGHEST, 2.0 * low) / low) ** number)


def levels(u: Array, time: Array, length: float) -> Array:
    """Three levels one after the other, and back."""
    edges = length * np.array([0.02, 0.05 + 0.4 * u[0], 0.3 + 0.4 * u[1], 0.9 - 0.3 * u[2]])
    edges.sort()
    heights = np.append(2.0 * u[3:6] - 1.0, 0.0)
    rise = FASTEST * (SLOWEST * length / FASTEST) ** u[6]
    jumps = np.diff(heights, prepend=0.0)
    return np.asarray(sum(jump * ramp((time - edge) / rise) for jump, edge in zip(jumps, edges, strict=True)))


def sines(u: Array, time: Array, length: float) -> Array:
    """Three sines of one window."""
    parts = [u[3 + i] * np.sin(2.0 * np.pi * (_frequency(u[i], length) * time + u[6] * i)) for i in range(3)]
    return np.asarray(sum(parts) * _window(time, length) / max(float(u[3:6].sum()), 1e-9))


def chirp(u: Array, time: Array, length: float) -> Array:
    """A sine of growing or falling frequency, on an offset."""
    first, last = _frequency(u[0], length), _frequency(u[1], length)
    phase = first * time + 0.5 * (last - first) * time**2 / length
    return np.asarray((0.5 * (u[2] - 0.5) + (0.4 + 0.6 * u[3]) * np.sin(2.0 * np.pi * (phase + u[4]))) * _window(time, length))


FAMILIES: tuple[Callable[[Array, Array, float], Array], ...] = (levels, sines, chirp)
LEVELS, CHIRP = 0, 2


@dataclass(frozen=True, eq=False)
class Segment:
    """A piece of motion of all references."""

    families: tuple[int, ...]
    """Of each reference."""
    numbers: Array
    """(references, NUMBERS)."""
    scales: Array
    """(references,) sizes, 1: the reference's whole range."""

    def values(self, time: Array, length: float) -> Array:
        """(references, n), from -1 to 1 over the range of each reference."""
        rows = [FAMILIES[f](u, time, length) for f, u in zip(self.families, self.numbers, strict=True)]
        return np.clip(self.scales[:, None] * np.array(rows), -1.0, 1.0)

    def scaled(self, factors: Array | float) -> Segment:
        """Larger or smaller in each reference."""
        return replace(self, scales=np.minimum(self.scales * factors, 4.0))


def fresh(generator: np.random.Generator, references: int) -> Segment:
    """Some segment."""
    families = tuple(generator.integers(len(FAMILIES), size=references).tolist())
    return Segment(families, generator.random((references, NUMBERS)), generator.uniform(0.3, 1.0, references))


def beside(segment: Segment, generator: np.random.Generator) -> Segment:
    """A segment with some numbers a little different."""
    size = 0.3 * generator.random()
    moved = segment.numbers + size * generator.normal(size=segment.numbers.shape) * (
        generator.random(segment.numbers.shape) < 0.5
    )
    # Reflected at the ends, so that they are not met too often.
    return replace(
        segment,
        numbers=1.0 - np.abs(1.0 - np.abs(moved) % 2.0),
        scales=segment.scales * np.exp(0.2 * generator.normal(size=len(segment.scales))),
    )


def joined(segments: Sequence[Segment], step: float, rows: int) -> Array:
    """(references, rows) of segments of equal length, one after the other; the last row is at rest."""
    edges = np.round(np.linspace(0, rows - 1, len(segments) + 1)).astype(int)
    found = np.zeros((len(segments[0].scales), rows))
    for segment, first, last in zip(segments, edges, edges[1:], strict=False):
        found[:, first:last] = segment.values(step * np.arange(last - first), step * (last - first))
    return found
