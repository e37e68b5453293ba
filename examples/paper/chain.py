"""Inverse dynamics of the arm in figure 14: Newton-Euler equations of five links with the masses of AlterEgo's description.

The equations are independent: they use neither the robot file nor the engines nor the kinematics (as in `paper.newton`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array
from paper.statics import GRAVITY

X, Y, Z = 0, 1, 2
"""Indices of the axes."""


@dataclass(frozen=True)
class Link:
    """A link and the joint that carries it. At zero angles, all links are stretched out along x."""

    axis: int
    """Axis of the joint: X, Y or Z. At zero angles, the frames of all links are parallel."""
    place: tuple[float, float, float]
    """Position of the joint in the frame of the previous link, m."""
    mass: float
    """Mass, kg."""
    centre: tuple[float, float, float]
    """Centre of mass, relative to the joint, m."""
    inertia: tuple[float, float, float]
    """Principal moments of inertia about the centre of mass, kg m^2."""


ARM = (
    Link(Z, (0.0, 0.0, 0.12), 0.4961, (0.0, 0.0, 0.0339), (2.44e-4, 2.49e-4, 2.12e-4)),
    Link(Y, (0.0, 0.0, 0.0365), 0.5408, (0.0793, 0.0, 0.0), (2.55e-4, 6.40e-4, 6.05e-4)),
    Link(X, (0.1305, 0.0, 0.0), 0.4961, (0.0339, 0.0, 0.0), (2.12e-4, 2.49e-4, 2.44e-4)),
    Link(Z, (0.037, 0.0, 0.0), 0.5408, (0.0793, 0.0, 0.0), (2.55e-4, 6.05e-4, 6.40e-4)),
    Link(X, (0.1305, 0.0, 0.0), 0.3668, (0.0543, 0.0, 0.0), (2.12e-4, 8.39e-4, 7.14e-4)),
)


def five_links(q: Array, v: Array, acceleration: Array) -> Array:
    """Joint torques (n, 5) that a motion of the arm needs under gravity without losses, N m."""
    count = len(q)
    spin, spinning = np.zeros((count, 3)), np.zeros((count, 3))
    pull = np.tile([0.0, 0.0, GRAVITY], (count, 1))
    turns, forces, moments = [], [], []
    for j, link in enumerate(ARM):
        turn, axis, place, centre = (
            _turns(link.axis, q[:, j]),
            np.eye(3)[link.axis],
            np.array(link.place),
            np.array(link.centre),
        )
        pull = _apply(turn, pull + _carried(spin, spinning, place), back=True)
        before = _apply(turn, spin, back=True)
        spinning = _apply(turn, spinning, back=True) + np.outer(acceleration[:, j], axis)
        spinning += np.cross(before, np.outer(v[:, j], axis))
        spin = before + np.outer(v[:, j], axis)
        turns.append(turn)
        forces.append(link.mass * (pull + _carried(spin, spinning, centre)))
        inertia = np.array(link.inertia)
        moments.append(spinning * inertia + np.cross(spin, spin * inertia) + np.cross(centre, forces[-1]))
    torques = np.zeros_like(q)
    for j in reversed(range(len(ARM))):
        torques[:, j] = moments[j][:, ARM[j].axis]
        if j:
            force = _apply(turns[j], forces[j])
            forces[j - 1] += force
            moments[j - 1] += _apply(turns[j], moments[j]) + np.cross(np.array(ARM[j].place), force)
    return torques


def _carried(spin: Array, spinning: Array, place: Array) -> Array:
    """Acceleration (n, 3) of a point of a rotating link relative to the origin of the link, m/s^2."""
    return np.asarray(np.cross(spinning, place) + np.cross(spin, np.cross(spin, place)))


def _turns(axis: int, angles: Array) -> Array:
    """Rotation matrices (n, 3, 3) from the frame of a link to the frame of the previous link."""
    turns = np.tile(np.eye(3), (len(angles), 1, 1))
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turns[:, one, one] = turns[:, other, other] = np.cos(angles)
    turns[:, other, one] = np.sin(angles)
    turns[:, one, other] = -np.sin(angles)
    return turns


def _apply(turns: Array, vectors: Array, *, back: bool = False) -> Array:
    return np.asarray(np.einsum("nji,nj->ni" if back else "nij,nj->ni", turns, vectors))
