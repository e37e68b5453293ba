"""Springs as polynomial tendons of MuJoCo: a cubic spline of the torque over the deflection."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

POINTS = 1001
"""Number of deflections on each side of 0 at which a spring law is evaluated."""
KNOTS, ERROR = (0, 4, 6, 9, 13, 20, 30), 1e-4
"""KNOTS: numbers of knots that are tried in turn. The first number for which the error of the spline is below `ERROR` rad is
taken."""
LINE_KNOTS, LINE_ERROR = (0, 6, 12, 20, 30, 45), 5e-4
"""LINE_KNOTS, LINE_ERROR: as `KNOTS` and `ERROR`, for springs that are made of linear pieces."""
FAR = 1e6
"""End of a dead band that no motion reaches, rad; also the rest position of a weak spring, which gives a nearly constant
torque.
"""


@dataclass(frozen=True, kw_only=True)
class Spline:
    """Approximation of a spring law (torque over deflection) by a sum of polynomial springs, each with a dead band."""

    pieces: Array
    """Rows (n, 5): lower and upper end of the dead band, rad; coefficients k_1, k_2, k_3 in N m/rad, N m/rad^2, N m/rad^3.

    Outside the dead band, at the distance u from its nearer end, the torque is k_1 u + k_2 u^2 + k_3 u^3.
    """
    reach: float
    """Largest deflection for which the pieces were fitted, rad."""
    knots: int
    """Number of knots of the spline on each side of 0."""
    error: float
    """Largest difference of the torques within `reach`, divided by the local stiffness, rad."""

    def torque(self, deflection: Array) -> Array:
        """Torques of the spring in N m at deflections in rad."""
        low, high, *stiffness = self.pieces.T
        x = np.asarray(deflection)[..., None]
        u = np.maximum(x - high, 0.0) + np.minimum(x - low, 0.0)
        return np.asarray((u * (stiffness[0] + u * (stiffness[1] + u * stiffness[2]))).sum(axis=-1))


def spline_of(
    law: Callable[[float], float], *, reach: float, limit: float, knots: int | None = None, curved: bool = True
) -> Spline:
    """Spline of a spring law between -reach and reach. knots: number of knots on each side; None: the first number in `KNOTS`
    with an error below `ERROR`. curved: whether the pieces are cubic; False: they are linear.

    The error of the torque is divided by the stiffness, so that it is a difference of positions under equal torques. limit:
    deflection beyond which the law is constant, rad. If the law is odd, its pieces act for positive and negative deflections.
    """
    saturates, edge = limit <= reach, min(limit, reach)
    x, constant = np.linspace(0.0, edge, POINTS), law(0.0)
    # Compute the torques of each side as a function of positive deflections x. They are law(x) for the positive side, and
    # -law(-x) for the negative side.
    sides = {
        sign: sign * (np.array([law(sign * value) for value in x.tolist()]) - constant * (1.0 + sign * x / FAR))
        for sign in (1.0, -1.0)
    }
    odd = bool(np.abs(sides[1.0] - sides[-1.0]).max() <= 1e-9 * np.abs(sides[1.0]).max())
    numbers, bound = (KNOTS, ERROR) if curved else (LINE_KNOTS, LINE_ERROR)
    for count in numbers if knots is None else (knots,):
        positions = edge * np.arange(count + 1) / (count + 1)
        fits = {sign: _fit(x, y, positions, odd=odd, saturates=saturates, curved=curved) for sign, y in sides.items()}
        error = max(error for _, error in fits.values())
        if error < bound:
            break
    pieces = [[-FAR, -FAR, constant / FAR, 0.0, 0.0]] if constant else []
    for sign, (rows, _) in fits.items():
        for position, first, second, third in rows.tolist():
            symmetric = odd and not second
            if symmetric and sign > 0.0:
                pieces.append([-position, position, first, second, third])
            elif not symmetric:
                band = [-FAR, position] if sign > 0.0 else [-position, FAR]
                pieces.append([*band, first, sign * second, third])
    return Spline(pieces=np.array(pieces), reach=edge, knots=count, error=error)


def _fit(x: Array, y: Array, knots: Array, *, odd: bool, saturates: bool, curved: bool) -> tuple[Array, float]:
    """Spline of torques y over deflections x >= 0, and its largest error divided by the stiffness, rad. Each row of the spline
    is a knot, and the three coefficients of the piece that begins at this knot.
    """
    stiffness = np.abs(np.gradient(y, x))
    # Apply a lower bound, since in flat parts of a law the stiffness is 0, by which it must not be divided.
    stiffness = np.maximum(stiffness, max(1e-3 * float(stiffness.max()), 1e-12))
    # The pieces that begin at knots have only a cubic or only a linear term. An odd law has no curvature at deflection 0.
    last = 3 if curved else 1
    powers = ([x] if odd else [x, x**2]) if curved else []
    columns = np.column_stack([*powers, np.maximum(x[:, None] - knots, 0.0) ** last]) / stiffness[:, None]
    scale = np.linalg.norm(columns, axis=0)
    factors = np.linalg.lstsq(columns / scale, y / stiffness, rcond=None)[0] / scale
    error = float(np.abs(columns @ factors - y / stiffness).max())
    pieces = factors[len(powers) :]
    rows = np.column_stack([knots, np.zeros((len(knots), 3))])
    rows[:, last] = pieces
    rows[0, 1 : 1 + len(powers)] += factors[: len(powers)]
    if saturates:
        # Add a piece that cancels the slope and the curvature of all other pieces beyond the deflection limit.
        edge = x[-1]
        if curved:
            first, second, _ = rows[0, 1:]
            u = edge - knots
            flat = first + 2.0 * second * edge + 3.0 * pieces @ u**2, second + 3.0 * pieces @ u, pieces.sum()
        else:
            flat = pieces.sum(), 0.0, 0.0
        rows = np.vstack([rows, [edge, *(-value for value in flat)]])
    return rows, error
