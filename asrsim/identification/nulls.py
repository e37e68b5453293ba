"""Combinations: directions that a recording does not tell, and what it tells in their place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

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


def unknown_directions(jacobian: Array, variance: float) -> tuple[Array, Array]:
    """Directions (k, n) of relative change that stay unknown, and all directions' relative deviations (n,)."""
    # The triangle of its factors has the same directions, and is small.
    _, singular, vectors = np.linalg.svd(np.linalg.qr(jacobian, mode="r"))
    full = np.zeros(jacobian.shape[1])
    full[: len(singular)] = singular
    deviations = np.sqrt(variance) / np.maximum(full, 1e-300)
    return vectors[1.96 * deviations > UNKNOWN], deviations


def combinations(layout: Layout, x: Array, jacobian: Array, variance: float, free: Sequence[int]) -> list[Combination]:
    """What is known of the entries that lie together in unknown directions, one direction after the other.

    free: entries that are not at a bound and have an effect.
    """
    if len(free) < 2:
        return []
    scaled, values = relative(layout, x, jacobian)
    scaled = scaled[:, list(free)]
    directions, _ = unknown_directions(scaled, variance)
    _, singular, vectors = np.linalg.svd(np.linalg.qr(scaled, mode="r"), full_matrices=False)
    alone = 1.96 * np.sqrt(variance * np.sum((vectors / np.maximum(singular, 1e-300)[:, None]) ** 2, axis=0))
    found: list[Combination] = []
    for direction in _sparse(directions):
        size = np.abs(direction)
        # Only what is not known alone is told by a combination.
        parts = [int(i) for i in np.argsort(-size) if size[i] > SHARE * size.max() and alone[i] > UNKNOWN]
        if len(parts) < 2:
            continue
        pivot = parts[0]
        for other in parts[1:]:
            exponents = np.zeros(len(free))
            # Constant along the direction: d log(other) - ratio d log(pivot) = 0.
            ratio = direction[other] / direction[pivot]
            exponents[other], exponents[pivot] = 1.0, -ratio
            margin = _margin(exponents, scaled, directions, variance)
            if margin < UNKNOWN:
                names = [layout.entries[free[i]].name for i in (other, pivot)]
                numbers = [float(values[free[i]]) for i in (other, pivot)]
                text, value = _shown(names, numbers, float(-ratio))
                found.append(Combination(text, value, margin, (free[other], free[pivot])))
    told = {i for one in found for i in one.keys}
    lost = [i for i in range(len(free)) if alone[i] > UNKNOWN]
    if all(free[i] in told for i in lost):
        return found
    return [*found, *_products(layout, values, scaled, free, lost, variance)]


def _products(
    layout: Layout, values: Array, scaled: Array, free: Sequence[int], lost: Sequence[int], variance: float
) -> Iterator[Combination]:
    """What is known of more than two parameters together, where no pair of them is known; the others follow."""
    if len(lost) < 2 or np.any(values[[free[i] for i in lost]] <= 0.0):
        return
    others = [i for i in range(len(free)) if i not in lost]
    mine = scaled[:, list(lost)]
    if others:
        mine = mine - scaled[:, others] @ np.linalg.lstsq(scaled[:, others], mine, rcond=None)[0]
    _, singular, vectors = np.linalg.svd(np.linalg.qr(mine, mode="r"))
    for size, vector in zip(singular, vectors, strict=True):
        strongest = float(np.max(np.abs(vector)))
        powers = vector / vector[int(np.argmax(np.abs(vector)))]
        margin = 1.96 * np.sqrt(variance) / max(float(size), 1e-300) / strongest
        if margin < UNKNOWN:
            parts = [(layout.entries[free[i]].name, float(p)) for i, p in zip(lost, powers, strict=True) if abs(p) > 0.02]
            text = " * ".join(name if abs(p - 1.0) < 0.02 else f"{name}^{p:.2g}" for name, p in parts)
            value = float(np.exp(np.sum(powers * np.log(values[[free[i] for i in lost]]))))
            yield Combination(text, value, float(margin), tuple(free[i] for i in lost))


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


def _margin(exponents: Array, jacobian: Array, directions: Array, variance: float) -> float:
    """Relative half width of the combination's interval, in the space of what is known."""
    known = exponents - directions.T @ np.linalg.lstsq(directions.T, exponents, rcond=None)[0] if len(directions) else exponents
    if np.linalg.norm(exponents - known) > 0.1 * np.linalg.norm(exponents):
        return np.inf
    _, singular, vectors = np.linalg.svd(np.linalg.qr(jacobian, mode="r"), full_matrices=False)
    keep = 1.96 * np.sqrt(variance) / np.maximum(singular, 1e-300) <= UNKNOWN
    projected = vectors[keep] @ known
    return float(1.96 * np.sqrt(variance * np.sum((projected / singular[keep]) ** 2)))


def _shown(names: Sequence[str], values: Sequence[float], power: float) -> tuple[str, float]:
    """other * pivot^power as people write it; as a sum where that is the simpler form."""
    (other, pivot), (a, b) = names, values
    half = round(2.0 * power) / 2.0
    if 0.0 < abs(half) < 1.0:
        # r / k^0.5 is better known as k / r^2.
        return _shown((pivot, other), (b, a), 1.0 / power)
    if half != 0.0 and abs(power - half) < NICE * max(1.0, abs(half)) and a > 0.0 and b > 0.0:
        size = "" if abs(half) == 1.0 else f"^{abs(half):g}"
        return f"{other} {'*' if half > 0.0 else '/'} {pivot}{size}", a * b**half
    # d a / a + power d b / b = 0: a + (power a / b) b is constant nearby.
    factor = power * a / b if b else 0.0
    whole = round(factor)
    if 0 < abs(whole) <= 4 and abs(factor - whole) < NICE * abs(whole) * 2.0:
        factor = float(whole)
    if (not whole or factor != whole) and a > 0.0 and b > 0.0:
        return f"{other} * {pivot}^{power:.2g}", a * b**power
    size = "" if abs(factor) == 1.0 else f"{abs(factor):.3g} "
    return f"{other} {'+' if factor > 0.0 else '-'} {size}{pivot}", a + factor * b
