"""Profiles: the misfit along each parameter while the others follow. If a profile is a parabola, the interval from slopes at
the estimate is right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.identification.problem import Problem, residuals_at
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

WIDTHS = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
"""Places of a profile, in standard deviations of the parameter."""
FARTHEST = 1.0
"""Largest move of a parameter or of a follower, in the vector's units; farther out the others do not follow slopes."""


@dataclass(frozen=True)
class Profile:
    """Misfit along one parameter."""

    name: str
    values: Array
    """Values (k,) of the parameter, in its unit."""
    rise: Array
    """Rise (k,) of the misfit above its value at the estimate, in units of the rise at one standard deviation; a parabola has
    1 at one and 4 at two standard deviations.
    """


def profiles(problem: Problem, x: Array, found: Uncertainty, names: tuple[str, ...]) -> tuple[Profile, ...]:
    """Profiles of the entries with a standard deviation and away from their bounds.

    Along a profile the other parameters follow the valley of least misfit, to first order: column i of the inverse of J'J over
    its diagonal element. Each place is one simulation.
    """
    low, high = problem.layout.bounds
    known, points, moves = [], [], []
    for i in range(len(x)):
        deviation, own = float(found.deviation[i]), float(found.inverse[i, i])
        if not (np.isfinite(deviation) and deviation > 0.0 and own > 0.0) or found.at_bound[i]:
            continue
        valley = found.inverse[i] / own
        # The valley's own width: the standard deviation may include the spread between parts of the recordings.
        width = min(own**0.5, FARTHEST / (WIDTHS[-1] * float(np.abs(valley).max())))
        places = np.clip(x + np.outer(width * WIDTHS, valley), low, high)
        known.append(i)
        points.append(places)
        moves.append(np.square(width) / own)
    if not known:
        return ()
    sums = np.sum(np.square(residuals_at(problem, [*np.concatenate(points)])), axis=1).reshape(len(known), len(WIDTHS))
    middle = len(WIDTHS) // 2
    result = []
    for i, places, share, row in zip(known, points, moves, sums, strict=True):
        entry = problem.layout.entries[i]
        values = np.array([entry.value(float(value)) for value in places[:, i]])
        result.append(Profile(names[i], values, (row - row[middle]) / share))
    return tuple(result)
