"""Least squares within bounds by a trust region, its derivatives by differences and by Broyden's updates; Huber's cost."""

from __future__ import annotations

import numpy as np

from asrsim.identification.residuals import Residuals
from asrsim.samples import Array

REACH = 0.3
"""Of the first steps: a third of a parameter's size."""
ROUNDS = 60
"""Evaluations with derivatives of one search, at most."""
LINEAR = 0.3
"""Share of a step's effect that may come unforeseen, before derivatives are taken anew."""
HUBER = 3.0
"""Deviations beyond which a residual counts by its size, not its square."""


IDLE, PATIENCE, HOPELESS = 3e-3, 3, 10.0
"""Share of the cost by which so many steps, one after the other, do not better it where a search is given up, at a mean square
error (in the noise's) that so little would not bring near the noise: where a model cannot fit, its valleys are long.
"""

Known = tuple[Array, Array, Array]
"""A place (n,), the residuals there (m,) and their derivatives (m, n)."""


class _Slopes:
    """The Jacobian along a search: by differences, and where a step did what it promised, by Broyden's update of the last."""

    def __init__(self, residuals: Residuals, known: Known | None) -> None:
        self._residuals = residuals
        self._seen = self._there = self._at = self._here = np.empty(0)
        self._matrix: Array | None = None
        if known is not None:
            self._at, self._here, self._matrix = known
        self._cost, self._idle = np.inf, 0
        self._updates = 0

    def residuals(self, x: Array) -> Array:
        """(m,), kept for the Jacobian, which is asked for where a step was good."""
        self._seen, self._there = x.copy(), self._residuals(x)
        counter = self._residuals.counter
        counter.cost = min(counter.cost, cost_of(self._there, "huber"))
        return self._there

    def jacobian(self, x: Array) -> Array:
        """(m, n)."""
        there = self._there if np.array_equal(x, self._seen) else self._residuals(x)
        self._look(x, cost_of(there, "linear"))
        step = x - self._at if self._matrix is not None else x
        if self._matrix is not None and self._updates < max(2, len(x) // 2) and np.any(step):
            surprise = there - self._here - self._matrix @ step
            # The better the last one foretold the step, the less differences would tell.
            if float(np.linalg.norm(surprise)) < LINEAR * float(np.linalg.norm(self._matrix @ step)):
                self._matrix = self._matrix + np.outer(surprise, step / float(step @ step))
                self._updates += 1
                self._at, self._here = x.copy(), there
                return self._matrix
        self._matrix, self._updates = self._residuals.jacobian(x, base=there), 0
        self._at, self._here = x.copy(), there
        return self._matrix

    def _look(self, x: Array, cost: float) -> None:
        """Give up where nothing comes of it any more."""
        self._idle = self._idle + 1 if cost > (1.0 - IDLE) * self._cost else 0
        self._cost = cost
        if self._idle >= PATIENCE and cost > HOPELESS:
            raise _EnoughError(x)


class _EnoughError(Exception):
    """Raised with the place at which a search may end."""

    def __init__(self, x: Array) -> None:
        super().__init__()
        self.x = x


def solve(
    residuals: Residuals, x: Array, *, loss: str, rounds: int = ROUNDS, tolerance: float = 1e-6, known: Known | None = None
) -> Array:
    """Trust-region reflective least squares from x, within the bounds; known: what was looked at near x already."""
    from scipy.optimize import least_squares

    low, high = residuals.layout.bounds
    # The start must be inside; counted from it, the first trust region is REACH wide.
    span = np.where(np.isfinite(high - low), np.minimum(high - low, 1.0), 1.0)
    inside = np.clip(x, low + 1e-6 * span, high - 1e-6 * span)
    slopes = _Slopes(residuals, known)
    # What is not searched over its logarithm may have grown far beyond the size of its start.
    grown = [not entry.parameter.logarithmic for entry in residuals.layout.entries]
    scale = REACH * np.where(grown, np.maximum(np.abs(inside), 1.0), 1.0)
    try:
        found = least_squares(
            lambda move: slopes.residuals(inside + move), np.zeros(len(x)), jac=lambda move: slopes.jacobian(inside + move),
            bounds=(low - inside, high - inside), method="trf", x_scale=scale, loss=loss, f_scale=HUBER, ftol=tolerance,
            xtol=tolerance, gtol=1e-12, max_nfev=rounds,
        )  # fmt: skip
    except _EnoughError as end:
        return end.x
    return np.asarray(inside + found.x, dtype=np.float64)


def cost_of(residuals: Array, loss: str) -> float:
    """Mean of squares, beyond :data:`HUBER` of sizes."""
    size = np.abs(residuals)
    if loss == "linear":
        return float(np.mean(size**2))
    return float(np.mean(np.where(size <= HUBER, size**2, HUBER * (2.0 * size - HUBER))))
