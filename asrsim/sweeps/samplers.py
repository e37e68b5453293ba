"""Samplers, which place the draws of a study in the unit cube (`asrsim sweep --sampler`).

`SAMPLERS` is the registry. Users add an instance of their own class: `SAMPLERS.add("halton", Halton())` in a plugin file, or an
entry point in the group "asrsim.samplers".
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np

from asrsim.registry import Registry
from asrsim.samples import Array


class Sampler(ABC):
    """Method that places the draws of a study in the unit cube. Equal arguments give equal points."""

    title: str
    """Description of the sampler, for the documentation."""
    blocks: bool = False
    """Whether the draws consist of blocks: A, B, and for every column j, a copy of A with column j of B (Saltelli et
    al. 2010). Sobol indices are computed from these blocks. All keys must then be drawn independently of each other.
    """

    def samples(self, wanted: int) -> int:
        """Number of samples that the sampler draws if the user wants `wanted` samples."""
        return wanted

    def draws(self, samples: int, dimensions: int) -> int:
        """Number of draws, each with a run, for this number of samples."""
        return samples * (dimensions + 2) if self.blocks else samples

    @abstractmethod
    def points(self, samples: int, dimensions: int, seed: int) -> Array:
        """Points (draws, dimensions) from 0 to 1; each column belongs to one independent key or group of keys."""


def block_fault(points: Array, samples: int) -> str:
    """First way in which points (draws, dimensions) are not the blocks A, B, and for every j a copy of A with column j of B, as
    a sentence; empty if they are these blocks.
    """
    if len(points) != samples * (points.shape[1] + 2):
        return f"{samples} samples need {samples * (points.shape[1] + 2)} rows, and `draws` gives {len(points)}"
    first, second, *mixed = np.split(points, points.shape[1] + 2)
    if np.any(same := (first == second).all(axis=0)):
        return f"the blocks A and B must be drawn separately, but their columns {int(np.argmax(same))} are equal"
    for j, block in enumerate(mixed):
        wanted = first.copy()
        wanted[:, j] = second[:, j]
        if wrong := np.flatnonzero((block != wanted).any(axis=1)).tolist():
            row = samples * (j + 2) + wrong[0]
            return (
                f"rows {samples * (j + 2)} to {samples * (j + 3) - 1} must be A with column {j} of B; row {row} must be "
                f"{wanted[wrong[0]].tolist()} and is {block[wrong[0]].tolist()}"
            )
    return _dependence(first, second)


def _dependence(first: Array, second: Array) -> str:
    """First column of the block B (samples, keys) that follows from this column of A, as a sentence; empty without such a
    column. The column is that of A, shifted or reversed in the unit interval, if the fraction of its sum or difference with
    that of A is nearly the same in all rows.
    """
    waves, others = np.exp(2j * np.pi * first), np.exp(2j * np.pi * second)
    related = np.maximum(np.abs(np.mean(waves * others, axis=0)), np.abs(np.mean(waves.conj() * others, axis=0)))
    # The value of independent draws exceeds c with the probability exp(-samples c^2).
    for j in np.flatnonzero(related > max(RELATED, math.sqrt(UNLIKELY / len(first)))).tolist():
        return f"the blocks A and B must be independent, but column {j} of B follows from column {j} of A"
    return ""


RELATED, UNLIKELY = 0.9, 50.0
"""RELATED: relation between two columns, from 0 to 1, above which one follows from the other; UNLIKELY: negative logarithm of
the probability with which independent columns are refused.
"""


class Random(Sampler):
    """Independent draws."""

    title = "independent draws"

    def points(self, samples: int, dimensions: int, seed: int) -> Array:
        return np.random.default_rng(seed).random((samples, dimensions))


class LatinHypercube(Sampler):
    """One draw in each of n equal parts of every axis."""

    title = "Latin hypercube"

    def points(self, samples: int, dimensions: int, seed: int) -> Array:
        from scipy.stats import qmc

        return np.asarray(qmc.LatinHypercube(dimensions, rng=seed).random(samples))


class Sobol(Sampler):
    """Points of a scrambled Sobol sequence, which fill the cube evenly."""

    title = "scrambled Sobol sequence"

    def points(self, samples: int, dimensions: int, seed: int) -> Array:
        from scipy.stats import qmc

        # Draw up to the next power of two, and use the first points, since SciPy warns about other numbers of points.
        power = max(0, math.ceil(math.log2(samples)))
        return np.asarray(qmc.Sobol(dimensions, rng=seed).random_base2(power))[:samples]


class Saltelli(Sobol):
    """Blocks of points of a Sobol sequence, from which Sobol indices are computed."""

    title = "blocks of Sobol points, samples x (keys + 2) runs, which give Sobol indices"
    blocks = True

    def samples(self, wanted: int) -> int:
        """Number of samples: the next power of two, which a Sobol sequence needs."""
        return 1 << max(1, (wanted - 1).bit_length())

    def points(self, samples: int, dimensions: int, seed: int) -> Array:
        both = super().points(samples, 2 * dimensions, seed)
        first, second = both[:, :dimensions], both[:, dimensions:]
        mixed = np.where(np.eye(dimensions, dtype=bool)[:, None], second, first)
        return np.concatenate([first, second, *mixed])


SAMPLERS: Registry[Sampler] = Registry("sampler", "asrsim.samplers", instance=Sampler)
for name, sampler in {"random": Random(), "lhs": LatinHypercube(), "sobol": Sobol(), "saltelli": Saltelli()}.items():
    SAMPLERS.own(name, sampler)
