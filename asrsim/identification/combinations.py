"""Combinations: directions that a recording does not tell, and what it tells in their place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations as combinations_of

import numpy as np

from asrsim.identification.layout import Entry
from asrsim.identification.problem import Problem, residuals
from asrsim.identification.told import UNKNOWN, Told, percent
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

NOTHING = 1.0
"""The same from which on its estimate is noise."""
CHANCE = 6.0
"""Chi squared that noise alone gives to a few directions."""
NICE, NICER = 1.5, 2e-3
"""How many times wider, and by how much more, the interval of a simpler form may be."""
HIGHEST = 8.0
"""Power in a combination, at most."""
NEARLY = 0.02
"""By which a power may be off a whole number."""
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
    """What is known of the entries that lie together in unknown directions, one direction after the other.

    free: entries that are not at a bound and have an effect.
    """
    if len(free) < 2:
        return []
    told = Told(problem.layout, x, found, free)
    places = _swayed(told, x, partial(residuals, problem))
    pairs: list[Combination] = []
    groups: list[set[int]] = []
    for direction in _sparse(told.directions):
        parts = told.parts(direction)
        if len(parts) < 2:
            continue
        for pivot, other in combinations_of(parts, 2):
            # What pairs tell already, by way of others, is not told again.
            if _joined(pairs, free[pivot], free[other]):
                continue
            # Constant along the direction: d log(other) + power d log(pivot) = 0.
            power = -float(direction[other] / direction[pivot])
            one = _about_joint(problem, told, other, pivot, power, places) or _pair(told, other, pivot, power, places)
            if one is not None:
                pairs.append(one)
        joined = [group for group in groups if group & set(parts)]
        groups = [group for group in groups if group not in joined] + [set(parts).union(*joined)]
    result: list[Combination] = []
    for group in groups:
        result += (one for one in pairs if set(one.keys) <= {free[i] for i in group})
        # Beyond pairs, products of more are told by one of each that hang together.
        alone: list[int] = []
        for i in sorted(group):
            if not any(_joined(pairs, free[i], free[other]) for other in alone):
                alone.append(i)
        result += _products(told, alone, places)
    return result


def _joined(pairs: Sequence[Combination], first: int, second: int) -> bool:
    """Whether entries hang together by pairs."""
    reached, grown = {first}, True
    while grown:
        more = {i for one in pairs if reached & set(one.keys) for i in one.keys} - reached
        reached, grown = reached | more, bool(more)
    return second in reached


def _swayed(told: Told, x: Array, left: Callable[[Array], Array]) -> list[Array]:
    """Values (n,) of vectors that fit as x does, some way along the unknown directions."""
    base, found = left(x), []
    for direction, extent in zip(told.directions, told.extent.tolist(), strict=True):
        for sway in (-min(extent, SWAY), min(extent, SWAY)):
            there = told.moved(x, sway * direction / np.abs(direction).max())
            found.append(told.layout.values(told.fitted(there, base, left)))
    return found


def _sway(told: Told, exponents: Array, places: Sequence[Array]) -> float:
    """By how much a product of powers differs, at most, where others fit as well."""
    moving = np.flatnonzero(exponents)
    here = told.values[told.free][moving]
    ratios = [there[told.free][moving] / here for there in places]
    return max((abs(float(exponents[moving] @ np.log(r))) for r in ratios if np.all(r > 0.0)), default=0.0)


def _pair(told: Told, other: int, pivot: int, power: float, places: Sequence[Array]) -> Combination | None:
    """other * pivot^power, a simpler form of it, or a sum, if that is known."""
    half = round(2.0 * power) / 2.0
    best = None
    for one in (power, half, 1.0 / (round(2.0 / power) / 2.0) if power and round(2.0 / power) else 0.0):
        exponents = np.zeros(len(told.free))
        exponents[other], exponents[pivot] = 1.0, one
        margin = float(np.hypot(told.margin(exponents), _sway(told, exponents, places)))
        # A simpler form may be a little wider.
        if one != 0.0 and margin < UNKNOWN and (best is None or margin < NICE * best[0] + NICER):
            best = margin, one
    total = _sum(told, other, pivot, power, places)
    if best is None or (total is not None and (best[1] != half or total.margin < best[0] / NICE - NICER)):
        return total
    names = [told.layout.entries[told.free[i]].name for i in (other, pivot)]
    numbers = [float(told.values[told.free[i]]) for i in (other, pivot)]
    text, value, factor = _shown(names, numbers, best[1])
    # What is written the other way round is less sure; high powers are of what is nearly known alone.
    if best[0] * factor > UNKNOWN or max(abs(best[1]), 1.0 / abs(best[1])) > HIGHEST:
        return None
    return Combination(text, value, best[0] * factor, (told.free[other], told.free[pivot]))


def _about_joint(
    problem: Problem, told: Told, first: int, second: int, power: float, places: Sequence[Array]
) -> Combination | None:
    """k / (izz + m r^2): what a motion tells of an inertia is that about the joint. first * second^power is constant."""
    for inertia, other, exponent in ((first, second, 1.0 / power if power else 0.0), (second, first, power)):
        entries = [problem.layout.entries[told.free[i]] for i in (other, inertia)]
        beside = _beside(problem, entries[1])
        size = float(told.values[told.free[inertia]])
        if beside <= 0.0 or abs(exponent * (size + beside) / size + 1.0) > ABOUT:
            continue
        exponents = np.zeros(len(told.free))
        exponents[other], exponents[inertia] = 1.0, -size / (size + beside)
        value, *moved = (
            float(there[told.free[other]] / (there[told.free[inertia]] + beside)) for there in (told.values, *places)
        )
        margin = float(np.hypot(told.margin(exponents), max((abs(one / value - 1.0) for one in moved), default=0.0)))
        if margin < UNKNOWN:
            text = f"{entries[0].name} / ({entries[1].name} + {beside:.3g} kg m^2, the inertia about the joint)"
            return Combination(text, value, margin, (told.free[other], told.free[inertia]))
    return None


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


def _sum(told: Told, other: int, pivot: int, power: float, places: Sequence[Array]) -> Combination | None:
    """other + n pivot, of one unit, n a small whole number, if that is known: its parts may change much while it stays."""
    first, second = (told.layout.entries[told.free[i]] for i in (other, pivot))
    a, b = (float(told.values[told.free[i]]) for i in (other, pivot))
    # d a / a + power d b / b = 0: a + (power a / b) b is constant nearby.
    times = round(power * a / b) if b else 0
    total = a + times * b
    if first.parameter.unit != second.parameter.unit or not 0 < abs(times) <= MOST or total <= 0.0:
        return None
    if abs(power * a / b - times) > WHOLE * abs(times):
        return None
    exponents = np.zeros(len(told.free))
    exponents[other], exponents[pivot] = 1.0, times * b / a
    sways = [float(there[told.free[other]] + times * there[told.free[pivot]]) / total - 1.0 for there in places]
    margin = float(np.hypot(told.margin(exponents) * abs(a) / total, max(map(abs, sways), default=0.0)))
    if margin > UNKNOWN:
        return None
    text = f"{first.name} {'+' if times > 0 else '-'} {'' if abs(times) == 1 else f'{abs(times)} '}{second.name}"
    return Combination(text, total, margin, (told.free[other], told.free[pivot]))


def _products(told: Told, lost: Sequence[int], places: Sequence[Array]) -> Iterator[Combination]:
    """What is known of more than two parameters together, where no pair of them is known; the others follow."""
    values = told.values[[told.free[i] for i in lost]]
    if len(lost) < 2 or np.any(values <= 0.0):
        return
    # Powers that move nothing unknown: what is orthogonal to the unknown directions, among these parameters.
    _, size, vectors = np.linalg.svd(told.directions[:, list(lost)])
    for vector in vectors[int(np.sum(size > 0.15)) :]:
        powers = np.zeros(len(told.free))
        powers[list(lost)] = _whole(vector / vector[int(np.argmax(np.abs(vector)))])
        margin = float(np.hypot(told.margin(powers), _sway(told, powers, places)))
        if margin < UNKNOWN:
            parts = [(told.layout.entries[told.free[i]].name, float(powers[i])) for i in lost if abs(powers[i]) > 0.005]
            text = " * ".join(name if abs(p - 1.0) < 0.005 else f"{name}^{p:.2g}" for name, p in parts)
            value = float(np.exp(np.sum(powers[list(lost)] * np.log(values))))
            yield Combination(text, value, margin, tuple(told.free[i] for i in lost))


def _whole(powers: Array) -> Array:
    """The same in whole numbers, where small ones will do."""
    for factor in (1.0, 2.0, 3.0, 4.0):
        if float(np.max(np.abs(factor * powers - np.round(factor * powers)))) < NEARLY:
            return np.round(factor * powers)
    return powers


def settled(problem: Problem, x: Array, start: Array, found: Uncertainty, free: Sequence[int]) -> Array:
    """x with what its recordings do not tell as it was at the start, where noise alone has moved that, and the rest found anew;
    x where that does not fit as well.
    """
    told = Told(problem.layout, x, found, free, NOTHING)
    if not len(told.directions):
        return x
    away = (start - x)[told.free] / told.units
    there = x.copy()
    there[told.free] += told.directions.T @ (told.directions @ away) * told.units
    there = told.fitted(there, np.zeros(len(found.jacobian)), partial(residuals, problem), 5)
    worse = float(np.sum(residuals(problem, there) ** 2) - np.sum(residuals(problem, x) ** 2))
    return x if worse > CHANCE * found.variance else there


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
    """other * pivot^power as people write it, its value, and how many times wider its interval is than the product's."""
    (other, pivot), (a, b) = names, values
    if abs(power) < 1.0 and abs(2.0 / power - round(2.0 / power)) < 1e-9:
        # r / k^0.5 is better known as k / r^2.
        text, value, factor = _shown((pivot, other), (b, a), 1.0 / power)
        return text, value, factor / abs(power)
    half = round(2.0 * power) / 2.0
    if abs(power - half) < 1e-9 and a > 0.0 and b > 0.0:
        size = "" if abs(half) == 1.0 else f"^{abs(half):g}"
        return f"{other} {'*' if half > 0.0 else '/'} {pivot}{size}", a * b**half, 1.0
    if a > 0.0 and b > 0.0:
        return f"{other} * {pivot}^{power:.2g}", a * b**power, 1.0
    # What has a sign has no powers: a + (power a / b) b is constant nearby.
    factor = power * a / b if b else 0.0
    total = a + factor * b
    return f"{other} {'+' if factor > 0.0 else '-'} {abs(factor):.3g} {pivot}", total, abs(a / total) if total else np.inf
