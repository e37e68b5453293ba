"""Profiles: the misfit as a function of one parameter, while the other parameters are adjusted. Intervals are computed from the
derivatives at the estimate. The interval of a parameter is right if its profile is a parabola.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.identification.problem import FitProblem, residuals, residuals_at
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

WIDTHS = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
"""Positions at which a profile is computed, in standard deviations of the parameter. They cover more than a 99 % interval,
whose half width is 2.58 standard deviations.
"""
SIMULATED = 2.0
"""Distance of the simulated point from the estimate, in standard deviations. It is close to the half width of a 95 % interval,
1.96.
"""
FARTHEST = 1.0
"""Largest change of a parameter along a profile, in the vector's units. For a logarithm it is the factor e, over which
derivatives still hold approximately.
"""
STRAIGHT = 0.1
"""Largest error with which the derivatives may predict a move along all directions together, so that profiles count as
parabolas. It is relative to the change along one direction. If the whole error belongs to one direction, an interval is wrong
by a tenth.
"""


@dataclass(frozen=True)
class Profile:
    """Misfit as a function of one parameter."""

    name: str
    values: Array
    """Values (k,) of the parameter, in its unit."""
    rise: Array
    """Rise (k,) of the misfit above its value at the estimate. The unit is the rise of the ideal parabola at one standard
    deviation, so that this parabola rises by 1 at one standard deviation and by 4 at two.
    """


def profiles(problem: FitProblem, x: Array, found: Uncertainty, names: tuple[str, ...]) -> tuple[Profile, ...]:
    """Profiles of the entries that have a standard deviation and are not at a bound. names: displayed names of the entries.

    Along a profile, the other parameters follow the valley of smallest misfit to first order. The direction of the valley is
    column i of the inverse of J'J, divided by its diagonal element. A parabola approximates the residuals along the valley. Its
    slope at the estimate is the derivative, and it passes through the residuals of one simulation. The misfit has its minimum
    at the estimate. If the derivatives predict moves along all directions together, all profiles are parabolas, and no
    parameter is simulated alone.
    """
    low, high = problem.layout.bounds
    known, points, squares = [], [], []
    for i in range(len(x)):
        deviation, own = float(found.deviation[i]), float(found.inverse[i, i])
        if not (np.isfinite(deviation) and deviation > 0.0 and own > 0.0) or found.at_bound[i]:
            continue
        valley = found.inverse[i] / own
        # Use the width of the valley. The standard deviation may also include the spread between parts of the recordings.
        width = min(own**0.5, FARTHEST / (WIDTHS[-1] * float(np.abs(valley).max())))
        ahead = width if high[i] - x[i] >= min(x[i] - low[i], SIMULATED * width) else -width
        known.append(i)
        points.append(np.clip(x + ahead * SIMULATED * valley, low, high))
        squares.append(width**2 / own)
    if not known:
        return ()
    base = residuals(problem, x)
    moves = np.array(points) - x
    slopes = moves @ found.jacobian.T
    straight = len(known) > 2 and _are_straight(problem, x, found, base)
    bends = np.zeros_like(slopes) if straight else residuals_at(problem, points) - base - slopes
    result = []
    for i, move, slope, bend, square in zip(known, moves, slopes, bends, squares, strict=True):
        entry = problem.layout.entries[i]
        steps = np.clip(x[i] + abs(move[i]) * WIDTHS / SIMULATED, low[i], high[i]) - x[i]
        way = steps / move[i]
        terms = (slope @ slope + 2.0 * (base @ bend), 2.0 * (slope @ bend), bend @ bend)
        rise = way**2 * (terms[0] + terms[1] * way + terms[2] * way**2)
        values = np.array([entry.value(float(x[i] + step)) for step in steps])
        result.append(Profile(names[i], values, rise / square))
    return tuple(result)


def _are_straight(problem: FitProblem, x: Array, found: Uncertainty, base: Array) -> bool:
    """Whether the derivatives predict the residuals as far from the estimate as profiles are simulated. Two moves along all
    principal directions of the covariance show this: one with equal signs, and one with alternating signs. base: residuals
    (m,) at x.
    """
    squares, directions = np.linalg.eigh(found.inverse)
    widths = SIMULATED * np.sqrt(np.maximum(squares, 0.0))
    moves = np.array([directions @ (sign * widths) for sign in (1.0, (-1.0) ** np.arange(len(x)))])
    low, high = problem.layout.bounds
    if np.abs(moves).max() > FARTHEST or not ((x + moves >= low) & (x + moves <= high)).all():
        return False
    bends = residuals_at(problem, [*(x + moves)]) - base - moves @ found.jacobian.T
    return bool(np.linalg.norm(bends, axis=1).max() < STRAIGHT * SIMULATED)
