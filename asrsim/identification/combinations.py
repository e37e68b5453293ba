"""Combinations of parameters. A recording may identify the product, sum or ratio of several parameters although it does not
identify each parameter.
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
"""A parameter or a combination counts as unidentifiable if the relative half width of its interval exceeds this value. At most
one of its digits is then known.
"""
FAR = 2.3
"""Largest change of a parameter's logarithm along an unidentifiable direction. It is the logarithm of 10, since a guess is
rarely wrong by a larger factor.
"""
NICE, NICER = 1.5, 2e-3
"""A simpler expression is preferred if its margin is below NICE times the smallest margin plus NICER. A simpler expression is
easier to read even if its interval is slightly wider.
"""
LARGEST = 4
"""Largest integer in a formula, in the numerators and denominators of powers and in the factors of terms. Formulas of mechanics
have no larger integers.
"""
MULTIPLIED = ("1", "m")
"""Units of gains, ratios and lever arms. Positive parameters with these units are never terms of a sum."""
WHOLE = 0.08
"""Largest relative deviation from an integer at which the factor of a term in a sum is rounded to this integer. It is so small
that the ranges around 4 and 5 do not overlap.
"""
AXES = ("ixx", "iyy", "izz")
"""Names of the moments of inertia about the axes."""
TINY, NEAR = 1e-6, 0.05
"""TINY: a parameter does not belong to a combination if its exponent is below this value, which is far above rounding errors.
NEAR: a combination follows from known combinations if the distance of its unit vector from their span is below this value.
"""


def percent(share: float) -> str:
    """Fraction as a percentage with two digits."""
    return f"{float(f'{100.0 * share:.2g}'):g} %"


def relative(layout: Layout, x: Array, jacobian: Array) -> tuple[Array, Array, Array]:
    """Jacobian (m, n) with respect to relative changes of the values, the values (n,), and the reference sizes (n,) of the
    relative changes. A reference size is the magnitude of the value, or a fraction of the parameter's typical size if the value
    is near 0.
    """
    values = layout.values(x)
    sizes = [
        value if entry.logarithmic else max(abs(value), 0.05 * entry.size)
        for value, entry in zip(values.tolist(), layout.entries, strict=True)
    ]
    return jacobian * (np.array(sizes) / layout.slopes(x)), values, np.array(sizes)


@dataclass(frozen=True, eq=False)
class Combination:
    """An expression of several parameters. Its value is identified although the single parameters are not identified."""

    text: str
    """Formula, such as `joint_1.spring_a_1 * joint_1.spring_k_1`."""
    value: float
    change: Array
    """Relative change of the value per relative change of each free entry (k,)."""
    size: float
    """Exponent of the parameter with the smallest power. Margins are divided by this exponent, so that the margins of an
    expression and of its powers are comparable.
    """
    margin: float
    """Relative half width of the 95 % interval of the value."""
    keys: tuple[int, ...]
    """Indices of the entries of the parameter vector in the formula."""

    def __str__(self) -> str:
        return f"{self.text} = {self.value:.4g} +- {percent(self.margin)}"


def combinations(problem: FitProblem, x: Array, found: Uncertainty, free: Sequence[int]) -> list[Combination]:
    """Combinations of two or three entries whose intervals are narrower than the intervals of the entries. Combinations that
    follow from other combinations are left out.

    free: entries of the parameter vector that are not at a bound and have an effect.
    """
    result: list[Combination] = []
    if len(free) < 2:
        return result
    known = _Known(problem, x, found, free)
    for chosen in (one for count in (2, 3) for one in itertools.combinations(known.ambiguous, count)):
        # Exponents of the product of powers that changes least along the unidentifiable directions.
        exponents = np.linalg.svd(known.directions[:, chosen])[2][-1]
        if np.all(np.abs(exponents) > TINY):
            # `_simplest` leaves out forms whose value overflows.
            with np.errstate(over="ignore", invalid="ignore"):
                order = np.argsort(chosen)
                form = _simplest(_forms(known, np.array(chosen)[order].tolist(), exponents[order]))
            if form is not None and _is_new(form, result):
                result.append(form)
    return result


def _simplest(forms: Iterable[Combination]) -> Combination | None:
    """First form whose interval is hardly wider than the narrowest interval. None if all intervals are wide."""
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
        # A motion determines a link's moment of inertia about its joint axis, not about its centre of mass. Therefore the
        # combinations contain the moment of inertia about the joint axis.
        beside = np.array([_beside(problem, entry.key) for entry in self.entries])
        self.names = [
            f"({entry.name} + {term:.3g} kg m^2, the inertia about the joint)" if term else entry.name
            for entry, term in zip(self.entries, beside.tolist(), strict=True)
        ]
        _, values, sizes = relative(problem.layout, x, found.jacobian)
        self.values, self.scales = values[self._free] + beside, sizes[self._free] + beside
        self._units = self.scales / problem.layout.slopes(x)[self._free]
        # Use the triangular factor of the QR decomposition: it is smaller than the Jacobian, and has the same singular values
        # and directions.
        _, singular, vectors = np.linalg.svd(np.linalg.qr(found.jacobian[:, self._free] * self._units, mode="r"))
        singular = np.maximum(np.append(singular, np.zeros(len(free) - len(singular))), 1e-100)
        # Variance of white residuals that would give the same intervals.
        variance = float(np.sum(found.inverse * found.noise)) / max(np.linalg.matrix_rank(found.inverse), 1)
        off = 1.96 * variance**0.5 / singular
        inside = off <= UNKNOWN
        self.directions = np.minimum(off[~inside], FAR)[:, None] * vectors[~inside]
        """Unidentifiable directions (u, k). The length of each direction is the largest likely change of the entries along it.
        """
        alone = np.sqrt(np.sum((vectors * off[:, None]) ** 2, axis=0))
        self.ambiguous = [int(i) for i in np.argsort(-alone) if alone[i] > UNKNOWN]
        """Entries that are not identified, the least known first."""
        self._inverse = (vectors[inside].T / singular[inside] ** 2) @ vectors[inside]

    def form(self, text: str, value: float, changes: Mapping[int, float], size: float = 1.0) -> Combination:
        """Combination with its interval. The interval includes the changes along the unidentifiable directions. changes:
        relative change of the value per relative change of each entry, by index of the entry; size: `Combination.size`.
        """
        change, moves = np.zeros(len(self._free)), np.zeros((1, len(self._found.noise)))
        change[[*changes]] = [*changes.values()]
        moves[0, self._free] = self._inverse @ change * self._units
        deviation, quantile = self._found.deviations(moves)
        margin = float(np.linalg.norm([deviation[0] * quantile[0], *(self.directions @ change)]))
        return Combination(text, value, change, size, margin, tuple(self._free[i] for i in np.flatnonzero(change)))


def _forms(known: _Known, chosen: Sequence[int], exponents: Array) -> Iterator[Combination]:
    """Expressions of the chosen entries that are nearly constant if the product of powers with these exponents is constant: a
    sum, and products of powers.
    """
    if len(chosen) == 2:
        yield from _sum(known, chosen[0], chosen[1], float(exponents[1] / exponents[0]))
    values = known.values[chosen]
    # A product of powers requires values that are positive and not near 0.
    if np.all(values == known.scales[chosen]):
        # The first of the entries with nearly the smallest exponent goes to the numerator.
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
    """Term m r^2 that Steiner's theorem adds to a link's moment of inertia about the axis of its joint. m: mass; r: distance of
    the centre of mass from the axis. The term is 0 if the key is not a moment of inertia about this axis, or if m or r is free.
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
    # For small changes, d a / per_a + power d b / per_b = 0. Therefore a + times b is constant.
    times = power * per_a / per_b
    whole = round(times)
    factors = first.logarithmic and first.unit in MULTIPLIED
    total = a + whole * b
    near = 0 < abs(whole) <= LARGEST and abs(times - whole) <= WHOLE * abs(whole)
    if near and total and first.unit == second.unit and not factors:
        factor = "" if abs(whole) == 1 else f"{abs(whole)} "
        text = f"{known.names[other]} {'+' if whole > 0 else '-'} {factor}{known.names[pivot]}"
        yield known.form(text, total, {other: per_a / total, pivot: whole * per_b / total})
