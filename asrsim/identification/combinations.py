"""Combinations of parameters: products, sums or ratios that a recording identifies but not the factors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from asrsim.identification.layout import Entry, Layout
from asrsim.identification.problem import Problem, residuals
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

UNKNOWN = 0.3
"""Relative half width of an interval above which a direction is unidentifiable."""
FAR = 2.3
"""Largest change of the logarithms along an unidentifiable direction."""
NICE, NICER = 1.5, 2e-3
"""Factor and summand by which the interval of a simpler form may exceed the narrowest interval."""
HIGHEST = 8.0
"""Largest exponent in a combination."""
NEARLY = 0.15
"""Largest distance of an exponent from the integer to which it is rounded."""
MOST, WHOLE = 4, 0.08
"""Largest integer factor of a term in a sum; largest relative distance of a factor from that integer."""
AXES, ABOUT = ("ixx", "iyy", "izz"), 0.1
"""Moments of inertia about the axes; largest distance of an exponent from that of an inertia about the joint."""
SWAY = 0.7
"""Largest relative change along an unidentifiable direction at which a combination is checked."""


def percent(share: float, sign: str = "") -> str:
    """Fraction as a percentage with two digits. sign: `+` shows the sign of positive numbers too."""
    return f"{float(f'{100.0 * share:.2g}'):{sign}g} %"


def relative(layout: Layout, x: Array, jacobian: Array) -> tuple[Array, Array]:
    """Jacobian (m, n) with respect to relative changes of the values, and the values (n,). Near 0, changes are relative to a
    typical size.
    """
    values = layout.values(x)
    scale = [
        value if entry.parameter.logarithmic else max(abs(value), 0.05 * entry.parameter.size)
        for value, entry in zip(values.tolist(), layout.entries, strict=True)
    ]
    return jacobian * (np.array(scale) / layout.slopes(x)), values


@dataclass(frozen=True)
class Combination:
    """Expression of several parameters that is identified although the parameters are not."""

    text: str
    """Text of the expression, such as `joint_1.spring_a_1 * joint_1.spring_k_1`."""
    value: float
    margin: float
    """Relative half width of its 95 % interval."""
    keys: tuple[int, ...]
    """Indices of its entries."""

    def __str__(self) -> str:
        return f"{self.text} = {self.value:.4g} +- {percent(self.margin)}"


def combinations(problem: Problem, x: Array, found: Uncertainty, free: Sequence[int]) -> list[Combination]:
    """Combinations of entries that span the unidentifiable directions.

    free: entries that are not at a bound and have an effect.
    """
    if len(free) < 2:
        return []
    known = _Known(problem, x, found, free)
    rows, pivots = _sparse(known.directions)
    parts = [known.parts(row) for row in rows]
    result = []
    for j in set(range(len(free))) - set(pivots):
        exponents = np.eye(len(free))[j]
        for row, pivot, mine in zip(rows, pivots, parts, strict=True):
            # Along a direction the pivot changes by 1 and entry j by row[j], so the product with these exponents is constant.
            exponents[pivot] = -row[j] if {j, pivot} <= mine else 0.0
        moving = np.flatnonzero(exponents)
        if len(moving) > 1 and (one := _simplest(known, exponents, moving.tolist())) is not None:
            result.append(one)
    return result


@dataclass(frozen=True, eq=False)
class _Form:
    """Candidate of a combination: text, gradient with respect to relative changes of the free entries (k,), and value
    function.
    """

    text: str
    change: Array
    value: Callable[[Array], float]
    size: float = 1.0
    """Smallest exponent, by which margins of different powers of a form are made comparable."""


class _Known:
    """Identifiable and unidentifiable directions of relative changes of the free entries."""

    def __init__(self, problem: Problem, x: Array, found: Uncertainty, free: Sequence[int]) -> None:
        self.layout, self.found, self.free, self.track = problem.layout, found, list(free), problem.tracks[0]
        scaled, values = relative(self.layout, x, found.jacobian)
        self.values = values[self.free]
        self._units = relative(self.layout, x, np.ones((1, len(x))))[0][0][self.free]
        self._scaled = scaled[:, self.free]
        # The triangular factor has the same singular directions, and is small.
        self._triangle = np.linalg.qr(self._scaled, mode="r")
        _, singular, self._vectors = np.linalg.svd(self._triangle)
        self._sizes = np.full(len(self.free), 1e-100)
        self._sizes[: len(singular)] = np.maximum(singular, 1e-100)
        # White residuals with this variance would give the same intervals.
        variance = float(np.sum(found.inverse * found.noise)) / max(np.linalg.matrix_rank(found.inverse), 1)
        self._noise = 1.96 * variance**0.5
        off = self._noise / self._sizes
        self._inside = off <= UNKNOWN
        self.directions = self._vectors[~self._inside]
        """Unidentifiable directions (u, k)."""
        self._extent = np.minimum(off[~self._inside], FAR)
        self._alone = np.sqrt(np.sum((self._vectors * off[:, None]) ** 2, axis=0))
        self.places = [self.values, *self._swayed(problem, x)] if len(self.directions) else [self.values]
        """Values (k,) of the estimate, and of points along unidentifiable directions that fit equally well."""

    def parts(self, direction: Array) -> set[int]:
        """Entries that make an unidentifiable direction unidentifiable: without them it would be known."""
        rest = direction.copy()
        for i in np.argsort(np.abs(direction)):
            without = rest.copy()
            without[i] = 0.0
            if float(np.linalg.norm(self._triangle @ without)) * UNKNOWN <= self._noise * float(np.linalg.norm(without)):
                rest = without
        return {int(i) for i in np.flatnonzero(rest) if self._alone[i] > UNKNOWN}

    def _swayed(self, problem: Problem, x: Array) -> Iterator[Array]:
        base, (low, high) = residuals(problem, x), self.layout.bounds
        known = self._vectors[self._inside]
        inverse = (known.T / self._sizes[self._inside] ** 2) @ known
        plain = np.array([not self.layout.entries[i].parameter.logarithmic for i in self.free]) & (self.values > 0.0)
        for direction, extent in zip(self.directions, self._extent.tolist(), strict=True):
            for sway in (-min(extent, SWAY), min(extent, SWAY)):
                change, there = sway * direction / np.abs(direction).max(), x.copy()
                there[self.free] += np.where(plain, np.expm1(change), change) * self._units
                # A correction along the identifiable directions makes it fit as well as x.
                for _ in range(3):
                    there[self.free] -= inverse @ (self._scaled.T @ (residuals(problem, there) - base)) * self._units
                    there = np.clip(there, low, high)
                yield self.layout.values(there)[self.free]

    def margin(self, form: _Form) -> float:
        """Relative half width of a form's 95 % interval, including its change along the unidentifiable directions."""
        inside = self._vectors[self._inside]
        moves = np.zeros((1, len(self.found.noise)))
        moves[0, self.free] = (inside.T @ (inside @ form.change / self._sizes[self._inside] ** 2)) * self._units
        deviation, quantile = self.found.deviations(moves)
        unknown = float(np.linalg.norm(self._extent * (self.directions @ form.change)))
        here, *others = map(form.value, self.places)
        moved = max((abs(one / here - 1.0) for one in others), default=0.0)
        return float(np.linalg.norm([deviation[0] * quantile[0], unknown, moved]))


def _simplest(known: _Known, exponents: Array, moving: list[int]) -> Combination | None:
    """Simplest form with an interval hardly wider than the narrowest: ratio to an inertia, sum, integer powers, real powers."""
    forms = []
    if len(moving) == 2:
        first, second = moving
        power = float(exponents[second] / exponents[first])
        forms += [*_about_joint(known, first, second, power), *_sum(known, first, second, power)]
    if np.all(known.values[moving] > 0.0):
        least = float(np.abs(exponents[moving]).min())
        powers = [factor * exponents / least for factor in (1.0, 2.0, 3.0, 4.0)]
        whole = [np.round(one) for i, one in enumerate(powers) if np.abs(one - np.round(one)).max() < NEARLY * (i + 1)]
        products = [_product(known, one, moving) for one in (*whole[:1], exponents)]
        forms += [one for one in products if np.abs(one.change).max() <= HIGHEST * one.size]
    margins = [(known.margin(one), one) for one in forms]
    best = min((margin / one.size for margin, one in margins), default=0.0)
    for margin, one in margins:
        if margin < UNKNOWN and margin / one.size < NICE * best + NICER:
            keys = tuple(known.free[i] for i in np.flatnonzero(one.change))
            return Combination(one.text, one.value(known.values), margin, keys)
    return None


def _product(known: _Known, exponents: Array, moving: list[int]) -> _Form:
    # The entry with the smallest exponent stands in the numerator.
    least = moving[int(np.argmin(np.abs(exponents[moving]) - 1e-9 * (exponents[moving] > 0.0)))]
    powers = exponents * np.sign(exponents[least])
    named = [(known.layout.entries[known.free[i]].name, float(powers[i])) for i in moving]
    text = " * ".join(_power(name, p) for name, p in named if p > 0.0)
    text += "".join(f" / {_power(name, -p)}" for name, p in named if p < 0.0)
    return _Form(
        text, powers, lambda values: float(np.prod(np.maximum(values[moving], 1e-300) ** powers[moving])),
        float(np.abs(powers[moving]).min()),
    )  # fmt: skip


def _power(name: str, power: float) -> str:
    return name if abs(power - 1.0) < 5e-3 else f"{name}^{power:.2g}"


def _about_joint(known: _Known, first: int, second: int, power: float) -> Iterator[_Form]:
    """Forms k / (izz + m r^2), with the inertia about the joint. first * second^power is constant."""
    for inertia, other, exponent in ((first, second, 1.0 / power if power else 0.0), (second, first, power)):
        names = [known.layout.entries[known.free[i]].name for i in (other, inertia)]
        beside = _beside(known, known.layout.entries[known.free[inertia]])
        size = float(known.values[inertia])
        if beside > 0.0 and abs(exponent * (size + beside) / size + 1.0) <= ABOUT:
            change = np.zeros(len(known.free))
            change[[other, inertia]] = 1.0, -size / (size + beside)
            text = f"{names[0]} / ({names[1]} + {beside:.3g} kg m^2, the inertia about the joint)"
            yield _Form(text, change, partial(_over, other, inertia, beside))


def _over(other: int, inertia: int, beside: float, values: Array) -> float:
    return float(values[other] / (values[inertia] + beside))


def _beside(known: _Known, entry: Entry) -> float:
    """Term m r^2 of the link if the entry is its moment of inertia about the joint's axis; 0 for other entries, or if m or r
    is free.
    """
    link, _, name = entry.parameter.key.rpartition(".")
    free = {one.parameter.key for one in known.layout.entries}
    if name not in AXES or free & {f"{link}.{what}" for what in ("mass", *"xyz")}:
        return 0.0
    robot = known.track.door.robot
    body = next((one for one in robot.links if one.name == link), None)
    joint = next((one for one in robot.moving_joints if one.child == link and one.kind != "prismatic"), None)
    if body is None or body.mass is None or joint is None or abs(joint.axis[AXES.index(name)]) < 0.99:
        return 0.0
    place = np.array(body.centre_of_mass)
    return body.mass * float(place @ place - (place @ np.array(joint.axis)) ** 2)


def _sum(known: _Known, other: int, pivot: int, power: float) -> Iterator[_Form]:
    """Sums other + n pivot of parameters with the same unit, n a small integer."""
    first, second = (known.layout.entries[known.free[i]] for i in (other, pivot))
    a, b = float(known.values[other]), float(known.values[pivot])
    # d a / a + power d b / b = 0: a + times b is constant nearby.
    times = power * a / b if b else 0.0
    signed, whole = min(a, b) <= 0.0, round(times)
    if 0 < abs(whole) <= MOST and abs(times - whole) <= WHOLE * abs(whole):
        times = float(whole)
    elif not signed:
        return
    total = a + times * b
    if first.parameter.unit == second.parameter.unit and times and (total > 0.0 or signed):
        change = np.zeros(len(known.free))
        change[[other, pivot]] = a / total, times * b / total
        size = "" if abs(times) == 1.0 else f"{abs(times):.3g} "
        text = f"{first.name} {'+' if times > 0 else '-'} {size}{second.name}"
        yield _Form(text, change, lambda values: float(values[other] + times * values[pivot]))


def _sparse(directions: Array) -> tuple[Array, list[int]]:
    """Sparse basis of the same space, in reduced echelon form with the largest elements as pivots, and the pivots' columns."""
    rows, pivots = directions.copy(), []
    for i in range(len(rows)):
        pivot = int(np.argmax(np.abs(rows[i])))
        pivots.append(pivot)
        rows[i] /= rows[i, pivot]
        for k in range(len(rows)):
            if k != i:
                rows[k] -= rows[k, pivot] * rows[i]
    return rows, pivots
