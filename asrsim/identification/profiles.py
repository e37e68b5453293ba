"""Profiles: the misfit along each parameter, while the other parameters are adjusted. If a profile is a parabola, the
parameter's interval, which was computed from the derivatives at the estimate, is right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.identification.problem import FitProblem, residuals, residuals_at
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

WIDTHS = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
"""Positions at which a profile is computed, in standard deviations of the parameter: up to beyond a 99 % interval, 2.58."""
SIMULATED = 2.0
"""Position of the simulated point, in standard deviations, on the side that is farther from a bound: near the end of a 95 %
interval, 1.96.
"""
FARTHEST = 1.0
"""Largest change of a parameter along a profile, in the vector's units: for logarithms a factor e, up to which slopes hold."""
STRAIGHT = 0.1
"""Largest error with which the derivatives may predict a move along all directions together, relative to the change along one
direction, so that profiles count as parabolas. An interval is then wrong by a tenth at most, if the whole error belongs to one
direction.
"""


@dataclass(frozen=True)
class Profile:
    """Misfit along one parameter."""

    name: str
    values: Array
    """Values (k,) of the parameter, in its unit."""
    rise: Array
    """Rise (k,) of the misfit above its value at the estimate, in units of the rise at one standard deviation; a parabola rises
    by 1 at one standard deviation, and by 4 at two.
    """


def profiles(problem: FitProblem, x: Array, found: Uncertainty, names: tuple[str, ...]) -> tuple[Profile, ...]:
    """Profiles of the entries with a standard deviation and away from their bounds.

    Along a profile the other parameters follow the valley of least misfit, to first order: column i of the inverse of J'J over
    its diagonal element. Along the valley, a parabola approximates the residuals: it has the slope of the derivatives, and
    passes through one simulation. The misfit has its minimum at the estimate. If the derivatives predict moves along all
    directions together, all profiles are parabolas, and no parameter is simulated alone.
    """
    low, high = problem.layout.bounds
    known, points, squares = [], [], []
    for i in range(len(x)):
        deviation, own = float(found.deviation[i]), float(found.inverse[i, i])
        if not (np.isfinite(deviation) and deviation > 0.0 and own > 0.0) or found.at_bound[i]:
            continue
        valley = found.inverse[i] / own
        # Use the width of the valley, not the standard deviation, which may include the spread between parts of the recordings.
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
    """Whether the derivatives predict the residuals as far from the estimate as a profile is simulated, along the principal
    directions of the covariance together, once with equal and once with alternating signs. base: residuals (m,) at x.
    """
    squares, directions = np.linalg.eigh(found.inverse)
    widths = SIMULATED * np.sqrt(np.maximum(squares, 0.0))
    moves = np.array([directions @ (sign * widths) for sign in (1.0, (-1.0) ** np.arange(len(x)))])
    low, high = problem.layout.bounds
    if np.abs(moves).max() > FARTHEST or not ((x + moves >= low) & (x + moves <= high)).all():
        return False
    bends = residuals_at(problem, [*(x + moves)]) - base - moves @ found.jacobian.T
    return bool(np.linalg.norm(bends, axis=1).max() < STRAIGHT * SIMULATED)
