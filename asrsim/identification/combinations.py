"""Combinations: directions that a recording does not tell, and what it tells in their place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from asrsim.identification.layout import Entry
from asrsim.identification.problem import Problem, residuals
from asrsim.identification.told import UNKNOWN, Told, percent
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

NICE, NICER = 1.5, 2e-3
"""How many times wider, and by how much more, the interval of a simpler form may be."""
HIGHEST = 8.0
"""Power in a combination, at most."""
NEARLY = 0.15
"""By which a power may be off a whole number, if its interval is no wider."""
MOST, WHOLE = 4, 0.08
"""Times that a part of a sum is in it, at most, and share by which that may be off a whole number."""
AXES, ABOUT = ("ixx", "iyy", "izz"), 0.1
"""Moments of inertia about the axes; share by which a power may differ from that of an inertia about its joint."""
SWAY = 0.7
"""Relative change along an unknown direction, at most, under which a combination is looked at again."""


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
        return f"{self.text} = {self.value:.4g} +- {percent(self.margin)}"


def combinations(problem: Problem, x: Array, found: Uncertainty, free: Sequence[int]) -> list[Combination]:
    """What is known of the entries that lie together in unknown directions.

    free: entries that are not at a bound and have an effect.
    """
    if len(free) < 2:
        return []
    told = Told(problem.layout, x, found, free)
    rows, pivots = _sparse(told.directions)
    parts = [told.parts(row) for row in rows]
    places, result = _swayed(told, x, partial(residuals, problem)), []
    for j in set(range(len(free))) - set(pivots):
        exponents = np.eye(len(free))[j]
        for row, pivot, mine in zip(rows, pivots, parts, strict=True):
            # Along a direction its pivot changes by 1 and entry j by row[j]: what stays is their product to these powers.
            exponents[pivot] = -row[j] if {j, pivot} <= set(mine) else 0.0
        if np.count_nonzero(exponents) > 1 and (one := _form(problem, told, exponents, places)) is not None:
            result.append(one)
    return result


Form = tuple[str, Array, Callable[[Array], float]]
"""Its text, its relative change by those of the free entries (k,), and its value from theirs (k,)."""


def _form(problem: Problem, told: Told, exponents: Array, places: Sequence[Array]) -> Combination | None:
    """A product of powers in its simplest form: a ratio to an inertia about its joint, a sum, or whole powers."""
    moving = np.flatnonzero(exponents)
    if len(moving) == 2:
        first, second = moving.tolist()
        power = float(exponents[second] / exponents[first])
        for form in (*_about_joint(problem, told, first, second, power), *_sum(told, first, second, power)):
            if (special := _known(told, form, places)) is not None:
                return special
    if np.any(told.values[told.free][moving] <= 0.0):
        return None
    best = None
    for powers in (exponents, *_whole(exponents)):
        # The same combination: margins are compared at one power of the same entry.
        size = float(np.abs(powers[moving]).min())
        one = _known(told, _product(told, powers, moving), places) if np.abs(powers).max() <= HIGHEST * size else None
        if one is not None and (best is None or one.margin / size < NICE * best[0] + NICER):
            best = one.margin / size, one
    return None if best is None else best[1]


def _known(told: Told, form: Form, places: Sequence[Array]) -> Combination | None:
    """A form with its interval, which holds by how much it differs where others fit as well; None where it is wide."""
    text, change, value = form
    here, *moved = (value(values[told.free]) for values in (told.values, *places))
    margin = float(np.hypot(told.margin(change), max((abs(one / here - 1.0) for one in moved), default=0.0)))
    keys = tuple(told.free[i] for i in np.flatnonzero(change))
    return Combination(text, here, margin, keys) if margin < UNKNOWN else None


def _product(told: Told, exponents: Array, moving: NDArray[np.intp]) -> Form:
    # What has the least power is no divisor.
    least = moving[int(np.argmin(np.abs(exponents[moving]) - 1e-9 * (exponents[moving] > 0.0)))]
    powers = exponents * np.sign(exponents[least])
    named = [(told.layout.entries[told.free[i]].name, float(powers[i])) for i in moving]
    text = " * ".join(_power(name, p) for name, p in named if p > 0.0)
    text += "".join(f" / {_power(name, -p)}" for name, p in named if p < 0.0)
    return text, powers, lambda values: float(np.prod(np.maximum(values[moving], 1e-300) ** powers[moving]))


def _power(name: str, power: float) -> str:
    return name if abs(power - 1.0) < 5e-3 else f"{name}^{power:.2g}"


def _whole(exponents: Array) -> Iterator[Array]:
    """The same in whole numbers, of small ones the nearest."""
    least = float(np.abs(exponents[exponents != 0.0]).min())
    for factor in (1.0, 2.0, 3.0, 4.0):
        powers = factor * exponents / least
        if float(np.abs(powers - np.round(powers)).max()) < NEARLY * factor:
            yield np.round(powers)
            return


def _swayed(told: Told, x: Array, left: Callable[[Array], Array]) -> list[Array]:
    """Values (n,) of vectors that fit as x does, some way along the unknown directions."""
    base, found = left(x), []
    for direction, extent in zip(told.directions, told.extent.tolist(), strict=True):
        for sway in (-min(extent, SWAY), min(extent, SWAY)):
            there = told.moved(x, sway * direction / np.abs(direction).max())
            found.append(told.layout.values(told.fitted(there, base, left)))
    return found


def _about_joint(problem: Problem, told: Told, first: int, second: int, power: float) -> Iterator[Form]:
    """k / (izz + m r^2): what a motion tells of an inertia is that about the joint. first * second^power is constant."""
    for inertia, other, exponent in ((first, second, 1.0 / power if power else 0.0), (second, first, power)):
        names = [problem.layout.entries[told.free[i]].name for i in (other, inertia)]
        beside = _beside(problem, problem.layout.entries[told.free[inertia]])
        size = float(told.values[told.free[inertia]])
        if beside > 0.0 and abs(exponent * (size + beside) / size + 1.0) <= ABOUT:
            change = np.zeros(len(told.free))
            change[[other, inertia]] = 1.0, -size / (size + beside)
            text = f"{names[0]} / ({names[1]} + {beside:.3g} kg m^2, the inertia about the joint)"
            yield text, change, partial(_over, other, inertia, beside)


def _over(other: int, inertia: int, beside: float, values: Array) -> float:
    return float(values[other] / (values[inertia] + beside))


def _beside(problem: Problem, entry: Entry) -> float:
    """m r^2 of the link whose moment of inertia about the joint's axis an entry is; 0 of others, and where m or r is free."""
    link, _, name = entry.parameter.key.rpartition(".")
    free = {one.parameter.key for one in problem.layout.entries}
    if name not in AXES or free & {f"{link}.{what}" for what in ("mass", *"xyz")}:
        return 0.0
    robot = problem.tracks[0].door.robot
    body = next((one for one in robot.links if one.name == link), None)
    joint = next((one for one in robot.moving_joints if one.child == link and one.kind != "prismatic"), None)
    if body is None or body.mass is None or joint is None or abs(joint.axis[AXES.index(name)]) < 0.99:
        return 0.0
    place = np.array(body.centre_of_mass)
    return body.mass * float(place @ place - (place @ np.array(joint.axis)) ** 2)


def _sum(told: Told, other: int, pivot: int, power: float) -> Iterator[Form]:
    """other + n pivot, of one unit, n a small whole number, if that is known: its parts may change much while it stays."""
    first, second = (told.layout.entries[told.free[i]] for i in (other, pivot))
    a, b = (float(told.values[told.free[i]]) for i in (other, pivot))
    # d a / a + power d b / b = 0: a + times b is constant nearby.
    times = power * a / b if b else 0.0
    signed, whole = min(a, b) <= 0.0, round(times)
    if 0 < abs(whole) <= MOST and abs(times - whole) <= WHOLE * abs(whole):
        times = float(whole)
    elif not signed:
        return
    total = a + times * b
    if first.parameter.unit == second.parameter.unit and times and (total > 0.0 or signed):
        change = np.zeros(len(told.free))
        change[[other, pivot]] = a / total, times * b / total
        size = "" if abs(times) == 1.0 else f"{abs(times):.3g} "
        text = f"{first.name} {'+' if times > 0 else '-'} {size}{second.name}"
        yield text, change, lambda values: float(values[other] + times * values[pivot])


def _sparse(directions: Array) -> tuple[Array, list[int]]:
    """The same space by directions with few parts, reduced to echelon form by largest parts, and these: 1 in one row alone."""
    rows, pivots = directions.copy(), []
    for i in range(len(rows)):
        pivot = int(np.argmax(np.abs(rows[i])))
        pivots.append(pivot)
        rows[i] /= rows[i, pivot]
        for k in range(len(rows)):
            if k != i:
                rows[k] -= rows[k, pivot] * rows[i]
    return rows, pivots
