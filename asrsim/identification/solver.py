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


class _Slopes:
    """The Jacobian along a search: by differences, and where a step did what it promised, by Broyden's update of the last."""

    def __init__(self, residuals: Residuals) -> None:
        self._residuals = residuals
        self._seen = self._at = np.empty(0)
        self._there = self._here = np.empty(0)
        self._matrix: Array | None = None
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


def solve(residuals: Residuals, x: Array, *, loss: str, rounds: int = ROUNDS, tolerance: float = 1e-6) -> Array:
    """Trust-region reflective least squares from x, within the bounds."""
    from scipy.optimize import least_squares

    low, high = residuals.layout.bounds
    # The start must be inside; counted from it, the first trust region is REACH wide.
    span = np.where(np.isfinite(high - low), np.minimum(high - low, 1.0), 1.0)
    inside = np.clip(x, low + 1e-6 * span, high - 1e-6 * span)
    slopes = _Slopes(residuals)
    # What is not searched over its logarithm may have grown far beyond the size of its start.
    grown = [not entry.parameter.logarithmic for entry in residuals.layout.entries]
    scale = REACH * np.where(grown, np.maximum(np.abs(inside), 1.0), 1.0)
    found = least_squares(
        lambda move: slopes.residuals(inside + move), np.zeros(len(x)), jac=lambda move: slopes.jacobian(inside + move),
        bounds=(low - inside, high - inside), method="trf", x_scale=scale, loss=loss, f_scale=HUBER, ftol=tolerance,
        xtol=tolerance, gtol=1e-12, max_nfev=rounds,
    )  # fmt: skip
    return np.asarray(inside + found.x, dtype=np.float64)


def cost_of(residuals: Array, loss: str) -> float:
    """Mean of squares, beyond :data:`HUBER` of sizes."""
    size = np.abs(residuals)
    if loss == "linear":
        return float(np.mean(size**2))
    return float(np.mean(np.where(size <= HUBER, size**2, HUBER * (2.0 * size - HUBER))))
