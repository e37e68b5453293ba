"""Combinations of parameters: products, sums or ratios that a recording identifies although it does not identify the parameters
themselves.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.identification.parameters import Layout
from asrsim.identification.problem import FitProblem
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

UNKNOWN = 0.3
"""Relative half width of an interval above which a parameter or a combination is unidentifiable: at most one digit is known."""
FAR = 2.3
"""Largest change of a parameter's logarithm along an unidentifiable direction: a factor of ten, as a guess is rarely more
wrong.
"""
NICE, NICER = 1.5, 2e-3
"""A simpler expression is preferred if its interval is at most NICE times the narrowest interval plus NICER: a sum or a product
of powers is easier to read, even if its interval is slightly wider.
"""
LARGEST = 4
"""Largest integer in a formula: powers, their denominators, and factors of terms. Formulas of mechanics have no larger
integers.
"""
MULTIPLIED = ("1", "m")
"""Units of gains, ratios and lever arms: positive parameters with these units are factors, never terms of a sum."""
WHOLE = 0.08
"""Largest relative deviation of a factor of a term in a sum from an integer, so small that the ranges around 4 and 5 do not
overlap.
"""
AXES = ("ixx", "iyy", "izz")
"""Names of the moments of inertia about the axes."""
TINY, NEAR = 1e-6, 0.05
"""Exponent below which a parameter does not belong to a combination, far above rounding; distance of a unit vector from the
span of known combinations below which a combination follows from them, 5 %.
"""


def percent(share: float) -> str:
    """Fraction as a percentage with two digits."""
    return f"{float(f'{100.0 * share:.2g}'):g} %"


def relative(layout: Layout, x: Array, jacobian: Array) -> tuple[Array, Array, Array]:
    """Jacobian (m, n) with respect to relative changes of the values, the values (n,), and the sizes (n,) to which the changes
    are relative: magnitudes of the values, or typical sizes near 0.
    """
    values = layout.values(x)
    sizes = [
        value if entry.logarithmic else max(abs(value), 0.05 * entry.size)
        for value, entry in zip(values.tolist(), layout.entries, strict=True)
    ]
    return jacobian * (np.array(sizes) / layout.slopes(x)), values, np.array(sizes)


@dataclass(frozen=True, eq=False)
class Combination:
    """Expression of several parameters whose value is identified although the single parameters are not identified."""

    text: str
    """Formula, such as `joint_1.spring_a_1 * joint_1.spring_k_1`."""
    value: float
    change: Array
    """Relative change of the value per relative change of each free entry (k,)."""
    size: float
    """Smallest exponent. Margins are divided by it, so that the margins of an expression and of its powers are comparable."""
    margin: float
    """Relative half width of the 95 % interval of the value."""
    keys: tuple[int, ...]
    """Indices of the entries of the parameter vector in the formula."""

    def __str__(self) -> str:
        return f"{self.text} = {self.value:.4g} +- {percent(self.margin)}"


def combinations(problem: FitProblem, x: Array, found: Uncertainty, free: Sequence[int]) -> list[Combination]:
    """Combinations of two or three entries that are better known than the entries themselves. Combinations that follow from
    other combinations are left out.

    free: entries of the parameter vector that are not at a bound and have an effect.
    """
    result: list[Combination] = []
    if len(free) < 2:
        return result
    known = _Known(problem, x, found, free)
    for chosen in (one for count in (2, 3) for one in itertools.combinations(known.ambiguous, count)):
        # The product of powers that changes least along the unidentifiable directions.
        exponents = np.linalg.svd(known.directions[:, chosen])[2][-1]
        if np.all(np.abs(exponents) > TINY):
            # Forms whose value overflows are left out.
            with np.errstate(over="ignore", invalid="ignore"):
                order = np.argsort(chosen)
                form = _simplest(_forms(known, np.array(chosen)[order].tolist(), exponents[order]))
            if form is not None and _is_new(form, result):
                result.append(form)
    return result


def _simplest(forms: Iterable[Combination]) -> Combination | None:
    """First form whose interval is hardly wider than the narrowest interval; None if all intervals are wide."""
    finite = [form for form in forms if np.isfinite(form.value)]
    best = min((form.margin / form.size for form in finite), default=0.0)
    nice = (form for form in finite if form.margin < UNKNOWN and form.margin / form.size < NICE * best + NICER)
    return next(nice, None)


def _is_new(form: Combination, others: Sequence[Combination]) -> bool:
    """Whether a combination does not follow from other combinations."""
    changes = np.array([one.change / np.linalg.norm(one.change) for one in (*others, form)])
    return bool(np.linalg.svd(changes, compute_uv=False)[-1] > NEAR)


class _Known:
    """Identifiable and unidentifiable directions of relative changes of the free entries."""

    def __init__(self, problem: FitProblem, x: Array, found: Uncertainty, free: Sequence[int]) -> None:
        self._found, self._free = found, list(free)
        self.entries = [problem.layout.entries[i] for i in free]
        # A motion determines the moment of inertia of a link about its joint, not about its centre of mass: use the former.
        beside = np.array([_beside(problem, entry.key) for entry in self.entries])
        self.names = [
            f"({entry.name} + {term:.3g} kg m^2, the inertia about the joint)" if term else entry.name
            for entry, term in zip(self.entries, beside.tolist(), strict=True)
        ]
        _, values, sizes = relative(problem.layout, x, found.jacobian)
        self.values, self.scales = values[self._free] + beside, sizes[self._free] + beside
        self._units = self.scales / problem.layout.slopes(x)[self._free]
        # The triangular factor of the QR decomposition has the same singular directions as the Jacobian, and is small.
        _, singular, vectors = np.linalg.svd(np.linalg.qr(found.jacobian[:, self._free] * self._units, mode="r"))
        singular = np.maximum(np.append(singular, np.zeros(len(free) - len(singular))), 1e-100)
        # White residuals with this variance would give the intervals that were found.
        variance = float(np.sum(found.inverse * found.noise)) / max(np.linalg.matrix_rank(found.inverse), 1)
        off = 1.96 * variance**0.5 / singular
        inside = off <= UNKNOWN
        self.directions = np.minimum(off[~inside], FAR)[:, None] * vectors[~inside]
        """Unidentifiable directions (u, k), each as long as the entries may change along it."""
        alone = np.sqrt(np.sum((vectors * off[:, None]) ** 2, axis=0))
        self.ambiguous = [int(i) for i in np.argsort(-alone) if alone[i] > UNKNOWN]
        """Entries that are not identified, the least known first."""
        self._inverse = (vectors[inside].T / singular[inside] ** 2) @ vectors[inside]

    def form(self, text: str, value: float, changes: Mapping[int, float], size: float = 1.0) -> Combination:
        """Combination with its interval, which includes the changes along the unidentifiable directions. changes: relative
        change of the value per relative change of each entry.
        """
        change, moves = np.zeros(len(self._free)), np.zeros((1, len(self._found.noise)))
        change[[*changes]] = [*changes.values()]
        moves[0, self._free] = self._inverse @ change * self._units
        deviation, quantile = self._found.deviations(moves)
        margin = float(np.linalg.norm([deviation[0] * quantile[0], *(self.directions @ change)]))
        return Combination(text, value, change, size, margin, tuple(self._free[i] for i in np.flatnonzero(change)))


def _forms(known: _Known, chosen: Sequence[int], exponents: Array) -> Iterator[Combination]:
    """Forms of the chosen entries (a sum, or integer powers) that may be constant where the product of powers with these
    exponents is constant.
    """
    if len(chosen) == 2:
        yield from _sum(known, chosen[0], chosen[1], float(exponents[1] / exponents[0]))
    values = known.values[chosen]
    # A product of powers needs values that are positive and not near 0.
    if np.all(values == known.scales[chosen]):
        # The first entry with nearly the smallest exponent stands in the numerator.
        least = exponents[np.argmin(np.round(np.abs(exponents), 1))]
        for denominator in map(float, range(1, LARGEST + 1)):
            powers = np.round(denominator * exponents / least)
            if np.abs(powers).max() <= LARGEST * denominator:
                named = [(known.names[i], power) for i, power in zip(chosen, powers.tolist(), strict=True)]
                text = " * ".join(_power(name, p) for name, p in named if p > 0.0)
                text += "".join(f" / {_power(name, -p)}" for name, p in named if p < 0.0)
                yield known.form(text, float(np.prod(values**powers)), dict(zip(chosen, powers, strict=True)), denominator)


def _power(name: str, power: float) -> str:
    return name if power == 1.0 else f"{name}^{power:g}"


def _beside(problem: FitProblem, key: str) -> float:
    """Term m r^2 of a link if the key is that of the link's moment of inertia about the joint's axis; 0 for other keys, or if m
    or r is free.
    """
    link, _, name = key.rpartition(".")
    if name not in AXES or problem.layout.keys & {f"{link}.{what}" for what in ("mass", *"xyz")}:
        return 0.0
    robot = problem.tracks[0].door.robot
    body = next((one for one in robot.links if one.name == link), None)
    joint = next((one for one in robot.moving_joints if one.child == link and one.kind != "prismatic"), None)
    if body is None or body.mass is None or joint is None or abs(joint.axis[AXES.index(name)]) < 0.99:
        return 0.0
    place = np.array(body.centre_of_mass)
    return body.mass * float(place @ place - (place @ np.array(joint.axis)) ** 2)


def _sum(known: _Known, other: int, pivot: int, power: float) -> Iterator[Combination]:
    """Sum other + n pivot of parameters with the same unit, n a small integer."""
    first, second = known.entries[other], known.entries[pivot]
    a, b = known.values[[other, pivot]].tolist()
    per_a, per_b = known.scales[[other, pivot]].tolist()
    # From d a / per_a + power d b / per_b = 0 follows that a + times b is constant for small changes.
    times = power * per_a / per_b
    whole = round(times)
    factors = first.logarithmic and first.unit in MULTIPLIED
    total = a + whole * b
    near = 0 < abs(whole) <= LARGEST and abs(times - whole) <= WHOLE * abs(whole)
    if near and total and first.unit == second.unit and not factors:
        factor = "" if abs(whole) == 1 else f"{abs(whole)} "
        text = f"{known.names[other]} {'+' if whole > 0 else '-'} {factor}{known.names[pivot]}"
        yield known.form(text, total, {other: per_a / total, pivot: whole * per_b / total})
