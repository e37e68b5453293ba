"""Springs as polynomial tendons of MuJoCo: a C2 cubic spline of the torque over the deflection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

POINTS = 2001
"""Number of deflections at which a spring law is evaluated."""
KNOTS, ERROR = (4, 6, 9, 13, 20, 30), 1e-4
"""Numbers of knots that are tried in turn; bound of the spline's error, rad, below which the first number is accepted."""
FAR = 1e6
"""End of a dead band that no motion reaches, rad."""
OFFSET = 1e3
"""Rest position of a weak linear spring that produces a nearly constant torque, rad."""


@dataclass(frozen=True)
class Piece:
    """Torque k_1 u + k_2 u^2 + k_3 u^3, where u is the deflection minus the nearest end of the dead band."""

    low: float
    """Lower end of the dead band, in which the torque is 0, rad."""
    high: float
    """Upper end of the dead band, rad."""
    stiffness: tuple[float, float, float]
    """Coefficients k_1, k_2, k_3 in N m/rad, N m/rad^2, N m/rad^3."""

    def torque(self, deflection: Array) -> Array:
        """Torques at deflections in rad, N m."""
        u = np.maximum(deflection - self.high, 0.0) + np.minimum(deflection - self.low, 0.0)
        return np.asarray(u * (self.stiffness[0] + u * (self.stiffness[1] + u * self.stiffness[2])))


@dataclass(frozen=True)
class Spline:
    """Approximation of a spring law, torque over deflection, by a sum of pieces."""

    pieces: tuple[Piece, ...]
    reach: float
    """Largest deflection for which the pieces were fitted, rad."""
    knots: int
    """Number of knots on each side."""
    saturates: bool
    """Whether the torque is constant beyond `reach`, as in the spring law; if not, the last cubic continues."""
    error: float
    """Largest difference of the torques within `reach`, divided by the stiffness there, rad."""

    def torque(self, deflection: Array) -> Array:
        """Torques at deflections in rad, N m."""
        return np.asarray(np.sum([piece.torque(deflection) for piece in self.pieces], axis=0))


def spline_of(law: Callable[[float], float], *, reach: float, limit: float, knots: int | None = None) -> Spline:
    """Spline of a spring law between -reach and reach. knots: number of knots on each side; None: the first of `KNOTS` with an
    error below `ERROR`.

    The error is weighted by one over the stiffness, so that it is a difference of positions under equal torques. limit:
    deflection beyond which the law is constant, rad. An odd law gets pieces that act for positive and negative deflections.
    """
    saturates = limit <= reach
    reach = min(limit, reach)
    x = np.linspace(-reach, reach, POINTS)
    y = np.array([law(deflection) for deflection in x.tolist()])
    stiffness = np.abs(np.gradient(y, x))
    # In flat parts of a law the stiffness is zero, so a lower bound avoids a division by zero.
    stiffness = np.maximum(stiffness, max(1e-3 * float(stiffness.max()), 1e-12))
    odd = float(np.abs(y + y[::-1]).max()) <= 1e-9 * float(np.abs(y).max())
    for count in KNOTS if knots is None else (knots,):
        shapes = _shapes(reach, count, odd=odd)
        columns = np.column_stack([shape.torque(x) for shape in shapes])
        scale = np.linalg.norm(columns / stiffness[:, None], axis=0)
        factors = np.linalg.lstsq(columns / stiffness[:, None] / scale, y / stiffness, rcond=None)[0] / scale
        pieces = _joined(shapes, factors.tolist())
        fitted = np.sum([piece.torque(x) for piece in pieces], axis=0)
        error = float((np.abs(fitted - y) / stiffness).max())
        if error < ERROR:
            break
    if saturates:
        pieces += [_flat_beyond(pieces, edge) for edge in (reach, -reach)]
    return Spline(tuple(pieces), reach, count, saturates, error)


def _shapes(reach: float, knots: int, *, odd: bool) -> list[Piece]:
    """Pieces with unit coefficients whose sums are the splines: a cubic polynomial, and a cubic from each knot outward."""
    cubic = (0.0, 0.0, 1.0)
    positions = [reach * i / (knots + 1) for i in range(1, knots + 1)]
    line, bend = Piece(0.0, 0.0, (1.0, 0.0, 0.0)), Piece(0.0, 0.0, cubic)
    if odd:
        return [line, bend, *(Piece(-knot, knot, cubic) for knot in positions)]
    constant = Piece(-OFFSET, -OFFSET, (1.0 / OFFSET, 0.0, 0.0))
    sides = [Piece(*band, cubic) for knot in positions for band in ((-FAR, knot), (-knot, FAR))]
    return [line, bend, Piece(0.0, 0.0, (0.0, 1.0, 0.0)), constant, *sides]


def _joined(shapes: Sequence[Piece], factors: Sequence[float]) -> list[Piece]:
    """Pieces that result from shapes multiplied by factors; shapes with equal dead bands become one piece."""
    found: dict[tuple[float, float], tuple[float, ...]] = {}
    for shape, factor in zip(shapes, factors, strict=True):
        band = shape.low, shape.high
        before = found.get(band, (0.0, 0.0, 0.0))
        found[band] = tuple(a + factor * b for a, b in zip(before, shape.stiffness, strict=True))
    return [Piece(*band, (k[0], k[1], k[2])) for band, k in found.items() if any(k)]


def _flat_beyond(pieces: Sequence[Piece], edge: float) -> Piece:
    """Piece that makes the total torque constant beyond a deflection `edge`."""
    slope = curve = third = 0.0
    for piece in pieces:
        u = max(edge - piece.high, 0.0) + min(edge - piece.low, 0.0)
        k_1, k_2, k_3 = piece.stiffness
        if piece.low < piece.high and u == 0.0:
            continue
        slope += k_1 + 2.0 * k_2 * u + 3.0 * k_3 * u * u
        curve += k_2 + 3.0 * k_3 * u
        third += k_3
    band = (-FAR, edge) if edge > 0.0 else (edge, FAR)
    return Piece(*band, (-slope, -curve, -third))
