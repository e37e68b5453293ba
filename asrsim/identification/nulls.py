"""Combinations: directions that a recording does not tell, and what it tells in their place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.identification.intervals import Uncertainty
from asrsim.identification.layout import Entry, Layout
from asrsim.samples import Array

UNKNOWN = 0.3
"""Relative half width of an interval from which on a direction is not told."""
SHARE = 0.15
"""Of the largest part of a direction: parts below take no part."""
NICE = 0.04
"""By which an exponent may miss a half-integer and be taken for it."""


@dataclass(frozen=True)
class Combination:
    """What is known of several parameters together."""

    text: str
    """Such as `joint_1.spring_a_1 * joint_1.spring_k_1`."""
    value: float
    margin: float
    """Relative half width of its 95 % interval."""
    keys: tuple[int, ...]
    """Entries in it."""

    def __str__(self) -> str:
        return f"{self.text} = {self.value:.4g} +- {100.0 * self.margin:.2g} %"


def relative(layout: Layout, x: Array, jacobian: Array) -> tuple[Array, Array]:
    """Jacobian (m, n) by relative changes of the values, and the values (n,); sizes stand for values near 0."""
    values = layout.values(x)
    scale = np.array([_scale(entry, float(v)) for v, entry in zip(values, layout.entries, strict=True)])
    return jacobian * (scale / layout.slopes(x)), values


def _scale(entry: Entry, value: float) -> float:
    return value if entry.parameter.logarithmic else max(abs(value), 0.05 * entry.parameter.size)


def combinations(layout: Layout, x: Array, found: Uncertainty, free: Sequence[int]) -> list[Combination]:
    """What is known of the entries that lie together in unknown directions, one direction after the other.

    free: entries that are not at a bound and have an effect.
    """
    if len(free) < 2:
        return []
    told = _Told(layout, x, found, free)
    pairs: list[Combination] = []
    groups: list[list[int]] = []
    for direction in _sparse(told.directions):
        size = np.abs(direction)
        # Only what is not known alone is told by a combination.
        parts = [int(i) for i in np.argsort(-size) if size[i] > SHARE * size.max() and told.alone[i] > UNKNOWN]
        if len(parts) < 2:
            continue
        groups.append(parts)
        pivot = parts[0]
        for other in parts[1:]:
            exponents = np.zeros(len(free))
            # Constant along the direction: d log(other) - ratio d log(pivot) = 0.
            ratio = direction[other] / direction[pivot]
            exponents[other], exponents[pivot] = 1.0, -ratio
            margin = told.margin(exponents)
            if margin < UNKNOWN:
                names = [layout.entries[free[i]].name for i in (other, pivot)]
                numbers = [float(told.values[free[i]]) for i in (other, pivot)]
                text, value, factor = _shown(names, numbers, float(-ratio))
                pairs.append(Combination(text, value, margin * factor, (free[other], free[pivot])))
    known = {i for one in pairs for i in one.keys}
    lost = sorted({i for parts in groups for i in parts if free[i] not in known})
    return [*pairs, *_products(told, lost)]


class _Told:
    """What is told of relative changes of some entries, and which directions of them are not."""

    def __init__(self, layout: Layout, x: Array, found: Uncertainty, free: Sequence[int]) -> None:
        self.layout, self.found, self.free = layout, found, list(free)
        scaled, self.values = relative(layout, x, found.jacobian)
        self.scaled = scaled[:, self.free]
        """(m, k) Jacobian by relative changes."""
        # The triangle of its factors has the same directions, and is small.
        _, singular, self._vectors = np.linalg.svd(np.linalg.qr(self.scaled, mode="r"))
        self._sizes = np.full(len(self.free), 1e-300)
        self._sizes[: len(singular)] = np.maximum(singular, 1e-300)
        off = 1.96 * np.sqrt(found.variance) / self._sizes
        self._known = off <= UNKNOWN
        self.directions = self._vectors[~self._known]
        """(u, k) that stay unknown."""
        self.alone = np.sqrt(np.sum((self._vectors * off[:, None]) ** 2, axis=0))
        """(k,) relative half widths of the entries, each alone."""
        self._units = relative(layout, x, np.ones((1, len(x))))[0][0][self.free]

    def margin(self, exponents: Array) -> float:
        """Relative half width of the 95 % interval of a product of powers, in the space of what is known; inf outside."""
        inside = self._vectors[self._known]
        projected = inside @ exponents
        if np.linalg.norm(exponents - inside.T @ projected) > 0.1 * np.linalg.norm(exponents):
            return np.inf
        sizes = self._sizes[self._known]
        ordinary = self.found.variance * float(np.sum((projected / sizes) ** 2))
        moves = np.zeros((1, self.found.scores.shape[1]))
        moves[0, self.free] = (inside.T @ (projected / sizes**2)) * self._units
        deviation, quantile = self.found.deviations(np.array([ordinary]), moves)
        return float(deviation[0] * quantile[0])


def _products(told: _Told, lost: Sequence[int]) -> Iterator[Combination]:
    """What is known of more than two parameters together, where no pair of them is known; the others follow."""
    values = told.values[[told.free[i] for i in lost]]
    if len(lost) < 2 or np.any(values <= 0.0):
        return
    # Powers that move nothing unknown: what is orthogonal to the unknown directions, among these parameters.
    _, size, vectors = np.linalg.svd(told.directions[:, list(lost)]) if len(told.directions) else (None, np.empty(0), np.eye(0))
    for vector in vectors[int(np.sum(size > SHARE)) :]:
        powers = np.zeros(len(told.free))
        powers[list(lost)] = vector / vector[int(np.argmax(np.abs(vector)))]
        margin = told.margin(powers)
        if margin < UNKNOWN:
            parts = [(told.layout.entries[told.free[i]].name, float(powers[i])) for i in lost if abs(powers[i]) > 0.02]
            text = " * ".join(name if abs(p - 1.0) < 0.02 else f"{name}^{p:.2g}" for name, p in parts)
            value = float(np.exp(np.sum(powers[list(lost)] * np.log(values))))
            yield Combination(text, value, margin, tuple(told.free[i] for i in lost))


def _sparse(directions: Array) -> Array:
    """The same space by directions with few parts: reduced to echelon form by largest parts."""
    rows = directions.copy()
    for i in range(len(rows)):
        pivot = int(np.argmax(np.abs(rows[i])))
        rows[i] /= rows[i, pivot]
        for k in range(len(rows)):
            if k != i:
                rows[k] -= rows[k, pivot] * rows[i]
    return rows


def _shown(names: Sequence[str], values: Sequence[float], power: float) -> tuple[str, float, float]:
    """other * pivot^power as people write it, its value, and how many times wider than the product's its relative interval is;
    as a sum where that is the simpler form.
    """
    (other, pivot), (a, b) = names, values
    half = round(2.0 * power) / 2.0
    if 0.0 < abs(half) < 1.0:
        # r / k^0.5 is better known as k / r^2.
        text, value, factor = _shown((pivot, other), (b, a), 1.0 / power)
        return text, value, factor / abs(power)
    if half != 0.0 and abs(power - half) < NICE * max(1.0, abs(half)) and a > 0.0 and b > 0.0:
        size = "" if abs(half) == 1.0 else f"^{abs(half):g}"
        return f"{other} {'*' if half > 0.0 else '/'} {pivot}{size}", a * b**half, 1.0
    # d a / a + power d b / b = 0: a + (power a / b) b is constant nearby.
    factor = power * a / b if b else 0.0
    whole = round(factor)
    if 0 < abs(whole) <= 4 and abs(factor - whole) < NICE * abs(whole) * 2.0:
        factor = float(whole)
    if (not whole or factor != whole) and a > 0.0 and b > 0.0:
        return f"{other} * {pivot}^{power:.2g}", a * b**power, 1.0
    size = "" if abs(factor) == 1.0 else f"{abs(factor):.3g} "
    total = a + factor * b
    return f"{other} {'+' if factor > 0.0 else '-'} {size}{pivot}", total, abs(a / total) if total else np.inf
