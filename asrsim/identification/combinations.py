"""Combinations of parameters: products, sums or ratios that a recording identifies although it does not identify the single
parameters.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.identification.parameters import Layout, Parameter
from asrsim.identification.problem import Problem
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

UNKNOWN = 0.3
"""Relative half width of an interval above which a parameter or a combination is unidentifiable."""
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
TINY, NEAR = 1e-6, 0.05
"""Exponent below which a parameter does not belong to a combination; distance from the span of known combinations below which
a combination follows from them.
"""


def percent(share: float) -> str:
    """Fraction as a percentage with two digits."""
    return f"{float(f'{100.0 * share:.2g}'):g} %"


def scales(layout: Layout, values: Array) -> Array:
    """Positive sizes (n,) to which relative changes of the values refer: magnitudes, or typical sizes near 0."""
    return np.array([
        value if entry.logarithmic else max(abs(value), 0.05 * entry.size)
        for value, entry in zip(values.tolist(), layout.entries, strict=True)
    ])  # fmt: skip


def relative(layout: Layout, x: Array, jacobian: Array) -> tuple[Array, Array]:
    """Jacobian (m, n) with respect to relative changes of the values, and the values (n,)."""
    values = layout.values(x)
    return jacobian * (scales(layout, values) / layout.slopes(x)), values


@dataclass(frozen=True, eq=False)
class Combination:
    """Expression of several parameters whose value is identified although the single parameters are not identified."""

    text: str
    """Formula, such as `joint_1.spring_a_1 * joint_1.spring_k_1`."""
    value: float
    change: Array
    """Relative change of the value per relative change of each free entry (k,)."""
    size: float = 1.0
    """Smallest exponent; margins are divided by it, so that margins of different powers of a form are comparable."""
    margin: float = np.inf
    """Relative half width of the 95 % interval of the value."""
    keys: tuple[int, ...] = ()
    """Indices of the entries of the parameter vector in the formula."""

    def __str__(self) -> str:
        return f"{self.text} = {self.value:.4g} +- {percent(self.margin)}"


def combinations(problem: Problem, x: Array, found: Uncertainty, free: Sequence[int]) -> list[Combination]:
    """Combinations of two or three entries that are better known than the entries, without those that follow from others.

    free: entries of the parameter vector that are not at a bound and have an effect.
    """
    result: list[Combination] = []
    if len(free) < 2:
        return result
    known = _Known(problem, x, found, free)
    for count in (2, 3):
        for chosen in itertools.combinations(known.ambiguous, count):
            exponents = np.zeros(len(free))
            # The product of powers that changes least along the unidentifiable directions.
            exponents[[*chosen]] = np.linalg.svd(known.directions[:, chosen])[2][-1]
            size = np.abs(exponents)
            if np.all(size[[*chosen]] > TINY):
                # Forms whose value overflows are left out.
                with np.errstate(over="ignore", invalid="ignore"):
                    form = known.simplest(exponents)
                if form is not None and _is_new(form, result):
                    result.append(form)
    return result


def _is_new(form: Combination, others: Sequence[Combination]) -> bool:
    """Whether a combination does not follow from other combinations."""
    changes = np.array([one.change / np.linalg.norm(one.change) for one in (*others, form)])
    return bool(np.linalg.svd(changes, compute_uv=False)[-1] > NEAR)


class _Known:
    """Identifiable and unidentifiable directions of relative changes of the free entries."""

    def __init__(self, problem: Problem, x: Array, found: Uncertainty, free: Sequence[int]) -> None:
        self.found, self.free, self.track = found, list(free), problem.tracks[0]
        self.entries = [problem.layout.entries[i] for i in free]
        self.keys = {entry.key for entry in problem.layout.entries}
        """Keys of all free parameters."""
        scaled, values = relative(problem.layout, x, found.jacobian)
        self.values, self.scales = values[self.free], scales(problem.layout, values)[self.free]
        self._units = self.scales / problem.layout.slopes(x)[self.free]
        # The triangular factor of the QR decomposition has the same singular directions as the Jacobian, and is small.
        _, singular, vectors = np.linalg.svd(np.linalg.qr(scaled[:, self.free], mode="r"))
        sizes = np.full(len(self.free), 1e-100)
        sizes[: len(singular)] = np.maximum(singular, 1e-100)
        # White residuals with this variance would give the same intervals.
        variance = float(np.sum(found.inverse * found.noise)) / max(np.linalg.matrix_rank(found.inverse), 1)
        off = 1.96 * variance**0.5 / sizes
        inside = off <= UNKNOWN
        self.directions = np.minimum(off[~inside], FAR)[:, None] * vectors[~inside]
        """Unidentifiable directions (u, k), each as long as the entries may change along it."""
        alone = np.sqrt(np.sum((vectors * off[:, None]) ** 2, axis=0))
        self.ambiguous = [int(i) for i in np.argsort(-alone) if alone[i] > UNKNOWN]
        """Entries that are not identified, the least known first."""
        self._inverse = (vectors[inside].T / sizes[inside] ** 2) @ vectors[inside]

    def margin(self, form: Combination) -> float:
        """Relative half width of a form's 95 % interval, including its change along the unidentifiable directions."""
        moves = np.zeros((1, len(self.found.noise)))
        moves[0, self.free] = self._inverse @ form.change * self._units
        deviation, quantile = self.found.deviations(moves)
        return float(np.linalg.norm([deviation[0] * quantile[0], *(self.directions @ form.change)]))

    def simplest(self, exponents: Array) -> Combination | None:
        """First form whose interval is hardly wider than the narrowest interval; None if all intervals are wide."""
        forms = [
            replace(form, margin=self.margin(form), keys=tuple(self.free[i] for i in np.flatnonzero(form.change)))
            for form in _forms(self, exponents) if np.isfinite(form.value)
        ]  # fmt: skip
        best = min((form.margin / form.size for form in forms), default=0.0)
        nice = (form for form in forms if form.margin < UNKNOWN and form.margin / form.size < NICE * best + NICER)
        return next(nice, None)


def _forms(known: _Known, exponents: Array) -> Iterator[Combination]:
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
                yield Combination(text, float(np.prod(known.values[moving] ** powers[moving])), powers, denominator)


def _power(name: str, power: float) -> str:
    return name if power == 1.0 else f"{name}^{power:g}"


def _about_joint(known: _Known, other: int, inertia: int, power: float) -> Iterator[Combination]:
    """Form other / (inertia + m r^2), with the moment of inertia about the joint, for a constant product other *
    inertia^power.
    """
    beside, size = _beside(known, known.entries[inertia]), float(known.values[inertia])
    if beside > 0.0 and abs(power * (size + beside) / size + 1.0) <= ABOUT:
        change = np.zeros(len(known.free))
        change[[other, inertia]] = 1.0, -size / (size + beside)
        about = f"({known.entries[inertia].name} + {beside:.3g} kg m^2, the inertia about the joint)"
        yield Combination(f"{known.entries[other].name} / {about}", float(known.values[other]) / (size + beside), change)


def _beside(known: _Known, entry: Parameter) -> float:
    """Term m r^2 of a link if the entry is the link's moment of inertia about the joint's axis; 0 for other entries, or if m or
    r is free.
    """
    link, _, name = entry.key.rpartition(".")
    if name not in AXES or known.keys & {f"{link}.{what}" for what in ("mass", *"xyz")}:
        return 0.0
    robot = known.track.door.robot
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
    near = 0 < abs(whole) <= MOST and abs(times - whole) <= WHOLE * abs(whole)
    if near and total and first.unit == second.unit and not factors:
        change = np.zeros(len(known.free))
        change[[other, pivot]] = per_a / total, whole * per_b / total
        size = "" if abs(whole) == 1 else f"{abs(whole)} "
        yield Combination(f"{first.name} {'+' if whole > 0 else '-'} {size}{second.name}", total, change)
