"""Combinations of parameters: products, sums or ratios that a recording identifies although it does not identify the single
parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.identification.layout import Entry, Layout
from asrsim.identification.problem import Problem
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

UNKNOWN = 0.3
"""Relative half width of an interval above which a direction is unidentifiable."""
FAR = 2.3
"""Largest change of the logarithms along an unidentifiable direction."""
NICE, NICER = 1.5, 2e-3
"""Factor and summand by which the interval of a simpler expression may exceed the narrowest interval."""
HIGHEST = 8.0
"""Largest exponent in a combination."""
DENOMINATORS = (1.0, 2.0, 3.0, 4.0)
"""Denominators of the ratios of two exponents in a combination."""
MULTIPLIED = ("1", "m")
"""Units of gains, ratios and lever arms: positive parameters with these units are factors, never terms of a sum."""
MOST, WHOLE = 4, 0.08
"""Largest integer factor of a term in a sum; largest relative deviation of a factor from the integer."""
AXES, ABOUT = ("ixx", "iyy", "izz"), 0.1
"""Names of the moments of inertia about the axes; largest deviation of an exponent from the exponent of the inertia about the
joint.
"""


def percent(share: float) -> str:
    """Fraction as a percentage with two digits."""
    return f"{float(f'{100.0 * share:.2g}'):g} %"


def scales(layout: Layout, values: Array) -> Array:
    """Positive sizes (n,) to which relative changes of the values refer: magnitudes, or typical sizes near 0."""
    return np.array([
        value if entry.parameter.logarithmic else max(abs(value), 0.05 * entry.parameter.size)
        for value, entry in zip(values.tolist(), layout.entries, strict=True)
    ])  # fmt: skip


def relative(layout: Layout, x: Array, jacobian: Array) -> tuple[Array, Array]:
    """Jacobian (m, n) with respect to relative changes of the values, and the values (n,)."""
    values = layout.values(x)
    return jacobian * (scales(layout, values) / layout.slopes(x)), values


@dataclass(frozen=True)
class Combination:
    """Expression of several parameters whose value is identified although the single parameters are not identified."""

    text: str
    """Formula, such as `joint_1.spring_a_1 * joint_1.spring_k_1`."""
    value: float
    margin: float
    """Relative half width of the 95 % interval of the value."""
    keys: tuple[int, ...]
    """Indices of the entries of the parameter vector in the formula."""

    def __str__(self) -> str:
        return f"{self.text} = {self.value:.4g} +- {percent(self.margin)}"


def combinations(problem: Problem, x: Array, found: Uncertainty, free: Sequence[int]) -> list[Combination]:
    """Combinations of entries that are constant along the unidentifiable directions.

    free: entries of the parameter vector that are not at a bound and have an effect.
    """
    if len(free) < 2:
        return []
    known = _Known(problem, x, found, free)
    rows, pivots = _sparse(known.directions)
    parts = [known.parts(row) for row in rows]
    result: list[Combination] = []
    for j in set(range(len(free))) - set(pivots):
        exponents = np.eye(len(free))[j]
        for row, pivot, mine in zip(rows, pivots, parts, strict=True):
            # Along a direction the pivot changes by 1, entry j by row[j]: the product of powers with `exponents` is constant.
            exponents[pivot] = -row[j] if {j, pivot} <= mine else 0.0
        if np.count_nonzero(exponents) > 1:
            # Forms whose value overflows are left out.
            with np.errstate(over="ignore", invalid="ignore"):
                result += _simplest(known, exponents)
    return result


@dataclass(frozen=True, eq=False)
class _Form:
    """A candidate for an identified combination of parameters."""

    text: str
    value: float
    change: Array
    """Relative change (k,) of the value per relative change of each free entry."""
    size: float = 1.0
    """Smallest exponent; margins are divided by it, so that margins of different powers of a form are comparable."""


class _Known:
    """Identifiable and unidentifiable directions of relative changes of the free entries."""

    def __init__(self, problem: Problem, x: Array, found: Uncertainty, free: Sequence[int]) -> None:
        self.found, self.free, self.track = found, list(free), problem.tracks[0]
        self.entries = [problem.layout.entries[i] for i in free]
        self.keys = {entry.parameter.key for entry in problem.layout.entries}
        """Keys of all free parameters."""
        scaled, values = relative(problem.layout, x, found.jacobian)
        self.values, self.scales = values[self.free], scales(problem.layout, values)[self.free]
        self._units = relative(problem.layout, x, np.ones((1, len(x))))[0][0][self.free]
        # The triangular factor of the QR decomposition has the same singular directions as the Jacobian, and is small.
        self._triangle = np.linalg.qr(scaled[:, self.free], mode="r")
        _, singular, vectors = np.linalg.svd(self._triangle)
        sizes = np.full(len(self.free), 1e-100)
        sizes[: len(singular)] = np.maximum(singular, 1e-100)
        # White residuals with this variance would give the same intervals.
        variance = float(np.sum(found.inverse * found.noise)) / max(np.linalg.matrix_rank(found.inverse), 1)
        self._noise = 1.96 * variance**0.5
        off = self._noise / sizes
        inside = off <= UNKNOWN
        self.directions = vectors[~inside]
        """Unidentifiable directions (u, k)."""
        self._extent = np.minimum(off[~inside], FAR)
        self._alone = np.sqrt(np.sum((vectors * off[:, None]) ** 2, axis=0))
        self._inverse = (vectors[inside].T / sizes[inside] ** 2) @ vectors[inside]

    def parts(self, direction: Array) -> set[int]:
        """Entries that cause an unidentifiable direction: if they were fixed, the direction would be identifiable."""
        rest = direction.copy()
        for i in np.argsort(np.abs(direction)):
            without = rest.copy()
            without[i] = 0.0
            if float(np.linalg.norm(self._triangle @ without)) * UNKNOWN <= self._noise * float(np.linalg.norm(without)):
                rest = without
        return {int(i) for i in np.flatnonzero(rest) if self._alone[i] > UNKNOWN}

    def margin(self, form: _Form) -> float:
        """Relative half width of a form's 95 % interval, including its change along the unidentifiable directions."""
        moves = np.zeros((1, len(self.found.noise)))
        moves[0, self.free] = self._inverse @ form.change * self._units
        deviation, quantile = self.found.deviations(moves)
        return float(np.linalg.norm([deviation[0] * quantile[0], *(self._extent * (self.directions @ form.change))]))


def _simplest(known: _Known, exponents: Array) -> Iterator[Combination]:
    """First form whose interval is hardly wider than the narrowest interval; no form if all intervals are wide."""
    margins = [(known.margin(form), form) for form in _forms(known, exponents) if np.isfinite(form.value)]
    best = min((margin / form.size for margin, form in margins), default=0.0)
    for margin, form in margins:
        if margin < UNKNOWN and margin / form.size < NICE * best + NICER:
            yield Combination(form.text, form.value, margin, tuple(known.free[i] for i in np.flatnonzero(form.change)))
            return


def _forms(known: _Known, exponents: Array) -> Iterator[_Form]:
    """Forms that may be constant where the product of powers with these exponents is constant: ratio to an inertia, sum,
    integer powers.
    """
    moving = np.flatnonzero(exponents)
    if len(moving) == 2:
        first, second = moving.tolist()
        power = float(exponents[second] / exponents[first])
        yield from _about_joint(known, second, first, 1.0 / power)
        yield from _about_joint(known, first, second, power)
        yield from _sum(known, first, second, power)
    # Powers are relative changes only of values that are positive and not near 0.
    if np.all(known.values[moving] == known.scales[moving]):
        # The entry with the smallest exponent stands in the numerator.
        least = moving[np.argmin(np.abs(exponents[moving]) - 1e-9 * (exponents[moving] > 0.0))]
        for denominator in DENOMINATORS:
            powers = np.round(denominator * exponents / exponents[least])
            if np.abs(powers).max() <= HIGHEST * denominator:
                named = [(known.entries[i].name, float(powers[i])) for i in moving]
                text = " * ".join(_power(name, p) for name, p in named if p > 0.0)
                text += "".join(f" / {_power(name, -p)}" for name, p in named if p < 0.0)
                yield _Form(text, float(np.prod(known.values[moving] ** powers[moving])), powers, denominator)


def _power(name: str, power: float) -> str:
    return name if power == 1.0 else f"{name}^{power:g}"


def _about_joint(known: _Known, other: int, inertia: int, power: float) -> Iterator[_Form]:
    """Form other / (inertia + m r^2), with the moment of inertia about the joint, for a constant product other *
    inertia^power.
    """
    beside, size = _beside(known, known.entries[inertia]), float(known.values[inertia])
    if beside > 0.0 and abs(power * (size + beside) / size + 1.0) <= ABOUT:
        change = np.zeros(len(known.free))
        change[[other, inertia]] = 1.0, -size / (size + beside)
        about = f"({known.entries[inertia].name} + {beside:.3g} kg m^2, the inertia about the joint)"
        yield _Form(f"{known.entries[other].name} / {about}", float(known.values[other]) / (size + beside), change)


def _beside(known: _Known, entry: Entry) -> float:
    """Term m r^2 of a link if the entry is the link's moment of inertia about the joint's axis; 0 for other entries, or if m or
    r is free.
    """
    link, _, name = entry.parameter.key.rpartition(".")
    if name not in AXES or known.keys & {f"{link}.{what}" for what in ("mass", *"xyz")}:
        return 0.0
    robot = known.track.door.robot
    body = next((one for one in robot.links if one.name == link), None)
    joint = next((one for one in robot.moving_joints if one.child == link and one.kind != "prismatic"), None)
    if body is None or body.mass is None or joint is None or abs(joint.axis[AXES.index(name)]) < 0.99:
        return 0.0
    place = np.array(body.centre_of_mass)
    return body.mass * float(place @ place - (place @ np.array(joint.axis)) ** 2)


def _sum(known: _Known, other: int, pivot: int, power: float) -> Iterator[_Form]:
    """Sum other + n pivot of parameters with the same unit, n a small integer."""
    first, second = known.entries[other], known.entries[pivot]
    a, b = float(known.values[other]), float(known.values[pivot])
    per_a, per_b = float(known.scales[other]), float(known.scales[pivot])
    # From d a / per_a + power d b / per_b = 0 follows that a + times b is constant for small changes.
    times = power * per_a / per_b
    signed, whole = min(a, b) <= 0.0, round(times)
    factors = first.parameter.logarithmic and first.parameter.unit in MULTIPLIED
    if factors or first.parameter.unit != second.parameter.unit:
        return
    if 0 < abs(whole) <= MOST and abs(times - whole) <= WHOLE * abs(whole):
        times = float(whole)
    elif not signed:
        return
    total = a + times * b
    if total > 0.0 or (signed and total != 0.0):
        change = np.zeros(len(known.free))
        change[[other, pivot]] = per_a / total, times * per_b / total
        size = "" if abs(times) == 1.0 else f"{abs(times):.3g} "
        yield _Form(f"{first.name} {'+' if times > 0 else '-'} {size}{second.name}", total, change)


def _sparse(directions: Array) -> tuple[Array, list[int]]:
    """Sparse basis of the space that given vectors span, in reduced echelon form with the largest elements as pivots, and the
    pivots' columns.
    """
    rows, pivots = directions.copy(), []
    for i in range(len(rows)):
        pivot = int(np.argmax(np.abs(rows[i])))
        pivots.append(pivot)
        rows[i] /= rows[i, pivot]
        for k in range(len(rows)):
            if k != i:
                rows[k] -= rows[k, pivot] * rows[i]
    return rows, pivots
