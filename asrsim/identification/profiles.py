"""Misfit along each parameter, the others following: whether its interval looks as slopes at the estimate say."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from asrsim.identification.problem import Problem, residuals
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

HALF, WIDEST, UNKNOWN = 3, 0.5, 0.1
"""Places to each side, a deviation from each other; the vector's units to each side, at most, and of what has no deviation."""
TURN = 2.0
"""Change of another entry, at most, that may follow."""

Profile = tuple[Array, Array]
"""Values of a parameter in its unit, and misfit there: chi squared above the best, if residuals are white."""


def profiles(problem: Problem, x: Array, found: Uncertainty) -> Iterator[Profile]:
    """Of every entry at the estimate x; where nothing is known of the others, these stay."""
    low, high = problem.layout.bounds
    least = float(np.sum(residuals(problem, x) ** 2))
    for i, entry in enumerate(problem.layout.entries):
        variance, alone = float(found.covariance[i, i]), np.eye(len(x))[i]
        width = min(HALF * float(np.sqrt(variance)), WIDEST) if variance > 0.0 else UNKNOWN
        # The misfit's own valley: deviations, which the spread of blocks may widen, one more than another, lead out of it.
        follow = found.inverse[i] / found.inverse[i, i] if variance > 0.0 else alone
        ways = [alone] if width * np.abs(follow).max() > TURN else [follow, alone]
        moves = np.unique(np.clip(x[i] + np.linspace(-width, width, 2 * HALF + 1), low[i], high[i])) - x[i]
        # The best that others can do is no worse than where they stay: slopes do not tell that everywhere.
        places = [[np.clip(x + move * way, low, high) for way in ways] for move in moves]
        misfits = [min(float(np.sum(residuals(problem, one) ** 2)) for one in several) - least for several in places]
        values = np.array([entry.value(float(x[i] + move)) for move in moves])
        yield values, np.minimum(np.array(misfits) / max(found.variance, 1e-300), 1e6)
