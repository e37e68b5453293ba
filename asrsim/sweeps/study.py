"""A study as pure data: what is varied, how points are chosen, what is kept. A point follows from its number alone."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.samples import Array
from asrsim.sweeps.fitted import Joint
from asrsim.sweeps.laws import Distribution, Values, law_of

DESIGNS = ("random", "lhs", "sobol", "saltelli")
"""How draws are placed. saltelli: rows from which Sobol indices follow, samples x (drawn axes + 2) of them."""
MOST_RUNS = 100_000_000
"""Runs of a study."""


@dataclass(frozen=True)
class Axis:
    """Keys that vary together, and what they take."""

    keys: tuple[str, ...]
    """Dotted keys; several take the same value, or, where values are lists of as many entries, one each."""
    law: Values | Distribution

    @property
    def name(self) -> str:
        """For people."""
        return " & ".join(self.keys)

    def assign(self, value: Any) -> dict[str, Any]:
        """Key -> value."""
        if len(self.keys) > 1 and isinstance(value, list | tuple) and len(value) == len(self.keys):
            return dict(zip(self.keys, value, strict=True))
        return dict.fromkeys(self.keys, value)


def axis_of(name: str, value: Any) -> Axis:
    """Of `key` or `key & key` (tied) and what it takes, as :func:`asrsim.sweeps.laws.law_of` reads it. Raises InputError."""
    return Axis(tuple(part.strip() for part in name.split("&")), law_of(value, name))


@dataclass(frozen=True, kw_only=True)
class Study:
    """What `asrsim sweep` does."""

    scenario: Path | None
    axes: tuple[Axis, ...]
    joint: Joint | None = None
    variants: tuple[str, ...] = ()
    """Empty: all of the scenario's, filled in when it is read."""
    overrides: tuple[str, ...] = ()
    """`key=value` for every run."""
    design: str = "random"
    samples: int = 0
    seed: int = 0
    signals: tuple[str, ...] = ()
    """joint.quantity that are kept of every run."""
    rate: float = 100.0
    """Hz of the kept signals."""
    plugins: tuple[Path, ...] = ()
    name: str = "sweep"

    @cached_property
    def listed(self) -> tuple[Axis, ...]:
        """Axes of a grid."""
        return tuple(axis for axis in self.axes if isinstance(axis.law, Values))

    @cached_property
    def drawn(self) -> tuple[Axis, ...]:
        """Axes that are drawn, but those of the fit."""
        return tuple(axis for axis in self.axes if isinstance(axis.law, Distribution))

    @cached_property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Drawn keys, those of one draw together."""
        return (*(axis.keys for axis in self.drawn), *(self.joint.groups if self.joint else ()))

    @cached_property
    def dimensions(self) -> int:
        """Independent numbers of a draw."""
        return len(self.groups)

    @cached_property
    def draws(self) -> int:
        """Draws at every point of the grid."""
        if not self.dimensions:
            return 1
        return self.samples * (self.dimensions + 2) if self.design == "saltelli" else self.samples

    @cached_property
    def grid(self) -> tuple[int, ...]:
        """Values of each listed axis."""
        return tuple(len(axis.law) for axis in self.listed if isinstance(axis.law, Values))

    def __len__(self) -> int:
        return max(1, len(self.variants)) * math.prod(self.grid) * self.draws

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Every key that varies, in the order of the columns."""
        groups = [axis.keys for axis in self.axes] + list(self.joint.groups if self.joint else ())
        return tuple(dict.fromkeys(key for group in groups for key in group))

    def point(self, run: int) -> tuple[str, dict[str, Any]]:
        """Variant and key -> value of a run, counted from 0: variants outermost, then the grid, then the draws."""
        variant, rest = divmod(run, math.prod(self.grid) * self.draws)
        cell, draw = divmod(rest, self.draws)
        values: dict[str, Any] = {}
        for axis, index in zip(self.listed, np.unravel_index(cell, self.grid) if self.grid else (), strict=True):
            values |= axis.assign(axis.law.values[int(index)] if isinstance(axis.law, Values) else None)
        if self.dimensions:
            row = self.table[draw]
            for axis, number in zip(self.drawn, row, strict=False):
                values |= axis.assign(float(number))
            if self.joint:
                values |= self.joint.assign(row[len(self.drawn) :])
        return self.variants[variant] if self.variants else "", {key: values[key] for key in self.keys}

    @cached_property
    def table(self) -> Array:
        """(draws, dimensions): every draw."""
        return self.from_unit(unit_points(self.design, self.samples, self.dimensions, self.seed))

    def from_unit(self, unit: Array) -> Array:
        """Draws (n, dimensions) of points (n, dimensions) in the unit cube, through each axis's law."""
        from scipy.special import ndtri

        # A sequence's first point may stand on the border, where a normal distribution has no value.
        unit = np.clip(unit, 0.5**53, 1.0 - 0.5**53)
        laws = [axis.law for axis in self.drawn]
        columns = [law.quantile(column) for law, column in zip(laws, unit.T, strict=False) if isinstance(law, Distribution)]
        if self.joint:
            columns += list(self.joint.from_scores(ndtri(unit[:, len(laws) :])).T)
        return np.column_stack(columns)

    @cached_property
    def digest(self) -> str:
        """What the rows follow from, but for the files: two studies with equal digests have equal points."""
        parts = [self.variants, self.overrides, self.design, self.samples, self.seed]
        parts += [self.signals, self.rate if self.signals else 0, [path.name for path in self.plugins]]
        laws = [(axis.keys, repr(axis.law)) for axis in self.axes]
        fit = repr(self.joint)
        return sha256(json.dumps([parts, laws, fit], default=str).encode()).hexdigest()[:16]


def unit_points(design: str, samples: int, dimensions: int, seed: int) -> Array:
    """(n, dimensions) in the unit cube; the same for the same arguments.

    saltelli: blocks A, B, and A with column j of B for every j (Saltelli et al. 2010), n = samples (dimensions + 2).
    """
    from scipy.stats import qmc

    if design == "random":
        return np.random.default_rng(seed).random((samples, dimensions))
    if design == "lhs":
        return np.asarray(qmc.LatinHypercube(dimensions, rng=seed).random(samples))
    if design == "sobol":
        return _sobol(dimensions, samples, seed)
    both = _sobol(2 * dimensions, samples, seed)
    first, second = both[:, :dimensions], both[:, dimensions:]
    blocks = [first, second]
    for j in range(dimensions):
        mixed = first.copy()
        mixed[:, j] = second[:, j]
        blocks.append(mixed)
    return np.concatenate(blocks)


def _sobol(dimensions: int, samples: int, seed: int) -> Array:
    from scipy.stats import qmc

    # Drawn up to the next power of two: the sequence says nothing of it, and its first points are the same.
    power = max(0, math.ceil(math.log2(samples)))
    return np.asarray(qmc.Sobol(dimensions, rng=seed).random_base2(power))[:samples]
