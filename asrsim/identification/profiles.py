"""Misfit along each parameter: whether its interval looks as slopes at the estimate say."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from asrsim.identification.layout import Entry
from asrsim.identification.problem import Problem, residuals
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

HALF, FINE = 3, 30
"""Places to each side, simulated, a deviation from each other, and by slopes."""
WIDEST = 0.5
"""Of the vector's units, to each side."""
UNTOLD = 0.1
"""The same of what has no deviation."""
TURN = 2.0
"""Change of another entry, at most, that may follow."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Of one parameter; misfits are chi squared above the best, if residuals are white."""

    alone: tuple[Array, Array]
    """Values in its unit, and misfit where the others stay: by slopes, or simulated where these do not hold."""
    followed: tuple[Array, Array] | None
    """The same where the others follow as is best, simulated, and never above; None where nothing is known of them."""


def profiles(problem: Problem, x: Array, found: Uncertainty) -> Iterator[Profile]:
    """Of every entry at the estimate x."""
    best = residuals(problem, x)
    least, unit = float(best @ best), max(found.variance, 1e-300)

    def misfit(there: Array) -> float:
        left = residuals(problem, there)
        return min((float(left @ left) - least) / unit, 1e6)

    lower, upper = problem.layout.bounds
    for i, entry in enumerate(problem.layout.entries):
        variance = float(found.covariance[i, i])
        width = min(HALF * float(np.sqrt(variance)), WIDEST) if variance > 0.0 else UNTOLD
        moves = np.linspace(-width, width, 2 * FINE + 1)
        slope = found.jacobian[:, i]
        alone = _values(entry, x[i] + moves), moves**2 * float(slope @ slope) / unit
        # The misfit's own valley: deviations, which the spread of blocks may widen, one more than another, lead out of it.
        follow = found.inverse[i] / found.inverse[i, i] if variance > 0.0 else None
        if follow is None or width * np.abs(follow).max() > TURN:
            yield Profile(alone, None)
            continue
        few = np.unique(np.clip(x[i] + np.linspace(-width, width, 2 * HALF + 1), lower[i], upper[i])) - x[i]
        followed = np.array([misfit(np.clip(x + move * follow, lower, upper)) if move else 0.0 for move in few])
        if np.any(followed > few**2 * float(slope @ slope) / unit):
            # The best that others can do is no worse than where they stay: slopes do not tell that here.
            stay = np.array([misfit(_with(x, i, x[i] + move)) if move else 0.0 for move in few])
            alone, followed = (_values(entry, x[i] + few), stay), np.minimum(followed, stay)
        yield Profile(alone, (_values(entry, x[i] + few), followed))


def _with(x: Array, i: int, place: float) -> Array:
    there = x.copy()
    there[i] = place
    return there


def _values(entry: Entry, places: Array) -> Array:
    return np.array([entry.value(float(place)) for place in places])
