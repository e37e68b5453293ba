"""A spring's law as pieces that MuJoCo's tendons can have: a C2 cubic spline of the torque over the deflection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

POINTS = 2001
"""Deflections at which a law is evaluated."""
FAR = 1e6
"""rad: an end of a dead band that no motion reaches."""
OFFSET = 1e3
"""rad: rest position of the weak linear piece that makes a constant torque."""


@dataclass(frozen=True)
class Piece:
    """Torque k_1 u + k_2 u^2 + k_3 u^3, where u is the deflection less the end of the dead band that it has passed."""

    low: float
    """rad, start of the dead band, in which the torque is 0."""
    high: float
    """rad, its end."""
    stiffness: tuple[float, float, float]
    """N m/rad, N m/rad^2, N m/rad^3."""

    def torque(self, deflection: Array) -> Array:
        """N m."""
        u = np.maximum(deflection - self.high, 0.0) + np.minimum(deflection - self.low, 0.0)
        return np.asarray(u * (self.stiffness[0] + u * (self.stiffness[1] + u * self.stiffness[2])))


@dataclass(frozen=True)
class Spline:
    """A law of the deflection as the sum of pieces."""

    pieces: tuple[Piece, ...]
    reach: float
    """rad: largest deflection for which the pieces were fitted."""
    saturates: bool
    """Whether the torque stays constant beyond `reach`, as the law's does; else the last cubic goes on."""
    error: float
    """rad: largest difference of the torques within `reach`, divided by the stiffness there."""

    def torque(self, deflection: Array) -> Array:
        """N m."""
        return np.asarray(np.sum([piece.torque(deflection) for piece in self.pieces], axis=0))


def spline_of(law: Callable[[float], float], *, reach: float, limit: float, knots: int) -> Spline:
    """Fit a law between -reach and reach with so many knots on each side.

    The error is weighted by one over the stiffness: then it is a difference of positions under the same torque. limit: rad,
    the deflection beyond which the law is constant. A law that is odd gets pieces that act on both sides.
    """
    saturates = limit <= reach
    reach = min(limit, reach)
    x = np.linspace(-reach, reach, POINTS)
    y = np.array([law(float(one)) for one in x])
    size = float(np.abs(y).max())
    stiffness = np.abs(np.gradient(y, x))
    # A law may have flat parts, where any position has the same torque.
    stiffness = np.maximum(stiffness, max(1e-3 * float(stiffness.max()), 1e-12))
    odd = float(np.abs(y + y[::-1]).max()) <= 1e-9 * size
    shapes = _shapes(reach, knots, odd=odd)
    columns = np.column_stack([shape.torque(x) for shape in shapes])
    scale = np.linalg.norm(columns / stiffness[:, None], axis=0)
    found = np.linalg.lstsq(columns / stiffness[:, None] / scale, y / stiffness, rcond=None)[0] / scale
    pieces = _joined(shapes, found.tolist())
    fitted = np.sum([piece.torque(x) for piece in pieces], axis=0)
    error = float((np.abs(fitted - y) / stiffness).max())
    if saturates:
        pieces += [_flat_beyond(pieces, edge) for edge in (reach, -reach)]
    return Spline(tuple(pieces), reach, saturates, error)


def _shapes(reach: float, knots: int, *, odd: bool) -> list[Piece]:
    """Pieces of size 1 that span the splines: a cubic polynomial, and a cubic from each knot outward."""
    cubic = (0.0, 0.0, 1.0)
    places = [reach * i / (knots + 1) for i in range(1, knots + 1)]
    line, bend = Piece(0.0, 0.0, (1.0, 0.0, 0.0)), Piece(0.0, 0.0, cubic)
    if odd:
        return [line, bend, *(Piece(-place, place, cubic) for place in places)]
    constant = Piece(-OFFSET, -OFFSET, (1.0 / OFFSET, 0.0, 0.0))
    sides = [Piece(*band, cubic) for place in places for band in ((-FAR, place), (-place, FAR))]
    return [line, bend, Piece(0.0, 0.0, (0.0, 1.0, 0.0)), constant, *sides]


def _joined(shapes: Sequence[Piece], factors: Sequence[float]) -> list[Piece]:
    """Shapes times their factors; those with the same dead band are one piece."""
    found: dict[tuple[float, float], tuple[float, ...]] = {}
    for shape, factor in zip(shapes, factors, strict=True):
        band = shape.low, shape.high
        before = found.get(band, (0.0, 0.0, 0.0))
        found[band] = tuple(a + factor * b for a, b in zip(before, shape.stiffness, strict=True))
    return [Piece(*band, (k[0], k[1], k[2])) for band, k in found.items() if any(k)]


def _flat_beyond(pieces: Sequence[Piece], edge: float) -> Piece:
    """The piece that takes back all growth of the others beyond an edge."""
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
