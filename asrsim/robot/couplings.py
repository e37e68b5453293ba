"""Couplings of joints: a joint that mimics another one follows it exactly, q = multiplier q_master + offset.

The motion of a coupled robot is determined by the joints that follow no other joint. With the positions z of these joints, the
positions of all joints are q = N z + c, their velocities N dz, and the torques of all joints act on z as N^T torque.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from asrsim.robot.model import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Couplings:
    """Couplings of n joints. Arrays of joints (..., n) have all joints; leading axes count postures. Functions of a robot
    without couplings return their arguments."""

    master: NDArray[np.int64]
    """Index of the joint that each joint follows, (n,); its own index for a joint that follows none."""
    ratio: Array
    """Velocity of each joint per velocity of its master, (n,)."""
    offset: Array
    """Position of each joint where its master is at 0, (n,), rad or m."""

    @property
    def free(self) -> NDArray[np.int64]:
        """Indices of the joints that follow no other joint."""
        return np.flatnonzero(self.master == np.arange(len(self.master)))

    def __bool__(self) -> bool:
        return len(self.free) < len(self.master)

    def expand(self, positions: ArrayLike) -> Array:
        """Positions (..., n) in which the followers stand where their masters put them."""
        q = np.asarray(positions, dtype=float)
        return self.ratio * q[..., self.master] + self.offset if self else q

    def expand_rates(self, rates: ArrayLike) -> Array:
        """Velocities or accelerations (..., n) in which the followers move as their masters make them."""
        v = np.asarray(rates, dtype=float)
        return self.ratio * v[..., self.master] if self else v

    @property
    def spread(self) -> Array:
        """Matrix (n, n): velocity of each joint per velocity of each joint that follows none; 0 in the columns of followers."""
        return self.ratio[:, None] * np.eye(len(self.master))[self.master]

    def fold(self, torques: ArrayLike) -> Array:
        """Torques (..., n) on the joints that follow none, equivalent to the given torques; 0 for followers."""
        values = np.asarray(torques, dtype=float)
        return values @ self.spread if self else values

    def fold_sizes(self, torques: ArrayLike) -> Array:
        """Bounds (n,) of the torques on the joints that follow none, from bounds of the torques on all joints."""
        values = np.asarray(torques, dtype=float)
        return values @ np.abs(self.spread) if self else values

    def fold_gains(self, gains: ArrayLike) -> Array:
        """Stiffnesses or dampings (n,) that act on the joints that follow none, equivalent to those of all joints; 0 for
        followers."""
        values = np.asarray(gains, dtype=float)
        return values @ np.square(self.spread) if self else values

    def fold_matrix(self, matrix: Array) -> Array:
        """Mass matrix (..., n, n) of the joints that follow none; the rows of followers are those of the unit matrix."""
        if not self:
            return matrix
        spread = self.spread
        return np.asarray(spread.T @ matrix @ spread + np.diag(self.master != np.arange(len(self.master))))


def uncoupled(count: int) -> Couplings:
    """Couplings of joints of which none follows another."""
    return Couplings(master=np.arange(count), ratio=np.ones(count), offset=np.zeros(count))


def couplings_of(robot: Robot) -> Couplings:
    """Couplings of the moving joints of a robot, whose masters follow no other joint."""
    moving = robot.moving_joints
    index = {joint.name: j for j, joint in enumerate(moving)}
    return Couplings(
        master=np.array([index.get(joint.mimic, j) for j, joint in enumerate(moving)], dtype=np.int64),
        ratio=np.array([joint.multiplier if joint.mimic else 1.0 for joint in moving]),
        offset=np.array([joint.offset if joint.mimic else 0.0 for joint in moving]),
    )
