"""Couplings of joints. A joint that mimics another joint follows it exactly: q = multiplier q_master + offset. The joints of a
closed chain follow the master of the chain with a ratio that depends on the positions (`asrsim.robot.loops`).

The motion of a coupled robot is determined by the joints that follow no other joint. With the positions z of these joints, the
positions of all joints are q(z), their velocities N dz, and the torques of all joints act on z as N^T torque.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from asrsim.robot.loops import Linkage, closed, linkages_of

if TYPE_CHECKING:
    from asrsim.robot.model import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Couplings:
    """Couplings of n joints. Arrays (..., n) have an entry for each joint; leading axes count postures. Without couplings, the
    methods return their arguments. Positions `q` are positions that `expand` returns; they have an effect only in closed
    chains.
    """

    master: NDArray[np.int64]
    """Index of the joint that each joint follows, (n,); the joint's own index if it follows no other joint."""
    ratio: Array
    """Velocity of each joint per velocity of its master, (n,); 1 for the joints of closed chains, see `ratios`."""
    offset: Array
    """Position of each joint where its master is at 0, (n,), rad or m; 0 for the joints of closed chains."""
    linkages: tuple[Linkage, ...] = ()
    """Closed chains."""

    @property
    def free(self) -> NDArray[np.int64]:
        """Indices of the joints that follow no other joint."""
        return np.flatnonzero(self.master == np.arange(len(self.master)))

    def __bool__(self) -> bool:
        return bool((self.master != np.arange(len(self.master))).any())

    def expand(self, positions: ArrayLike) -> Array:
        """Positions (..., n) in which the followers follow their masters."""
        q = np.asarray(positions, dtype=float)
        return closed(self.linkages, self.ratio * q[..., self.master] + self.offset) if self else q

    def ratios(self, q: Array) -> Array:
        """Velocity (..., n) of each joint per velocity of its master."""
        if not self.linkages:
            return self.ratio
        found = np.broadcast_to(self.ratio, q.shape).copy()
        for linkage in self.linkages:
            found[..., list(linkage.joints)] = linkage.ratios(q)
        return found

    def expand_rates(self, rates: ArrayLike, q: Array) -> Array:
        """Velocities (..., n) in which the followers follow their masters."""
        v = np.asarray(rates, dtype=float)
        return self.ratios(q) * v[..., self.master] if self else v

    def expand_accelerations(self, accelerations: ArrayLike, v: Array, q: Array) -> Array:
        """Accelerations (..., n) in which the followers follow their masters, at the velocities v (..., n)."""
        found = self.expand_rates(accelerations, q)
        for linkage in self.linkages:
            joints = list(linkage.joints)
            found = np.broadcast_to(found, np.broadcast_shapes(found.shape, q.shape, v.shape)).copy()
            found[..., joints] += linkage.gamma(*np.broadcast_arrays(q, v))
        return found

    def spread(self, q: Array) -> Array:
        """Matrix (..., n, n): velocity of each joint per velocity of each joint that follows no other joint; 0 in the columns
        of followers.
        """
        return self.ratios(q)[..., None] * np.eye(len(self.master))[self.master]

    def fold(self, torques: ArrayLike, q: Array) -> Array:
        """Torques (..., n) on the joints that follow no other joint, equivalent to the given torques; 0 for followers."""
        values = np.asarray(torques, dtype=float)
        return _fold(values, self.spread(q)) if self else values

    def fold_sizes(self, torques: ArrayLike, q: Array) -> Array:
        """Bounds (..., n) of the torques on the joints that follow no other joint, from bounds of the torques on all joints."""
        values = np.asarray(torques, dtype=float)
        return _fold(values, np.abs(self.spread(q))) if self else values

    def fold_gains(self, gains: ArrayLike, q: Array) -> Array:
        """Stiffnesses or dampings (..., n) that act on the joints that follow no other joint, equivalent to the stiffnesses or
        dampings of all joints; 0 for followers.
        """
        values = np.asarray(gains, dtype=float)
        return _fold(values, np.square(self.spread(q))) if self else values

    def fold_matrix(self, matrix: Array, q: Array) -> Array:
        """Mass matrix (..., n, n) of the joints that follow no other joint; the rows of followers are rows of the identity
        matrix.
        """
        if not self:
            return matrix
        spread = self.spread(q)
        return np.swapaxes(spread, -1, -2) @ matrix @ spread + np.diag(self.master != np.arange(len(self.master)))


def _fold(values: Array, spread: Array) -> Array:
    """Sums (..., n) of values (..., n) over the joints, with the factors (..., n, n)."""
    if spread.ndim == 2:
        return np.asarray(values @ spread)
    return np.asarray((values[..., None, :] @ spread)[..., 0, :])


def uncoupled(count: int) -> Couplings:
    """Couplings of joints that are not coupled."""
    return Couplings(master=np.arange(count), ratio=np.ones(count), offset=np.zeros(count))


def couplings_of(robot: Robot) -> Couplings:
    """Couplings of the moving joints of a robot, whose masters follow no other joint. Raises RobotError for loops that no joint
    can close.
    """
    moving, linkages = robot.moving_joints, linkages_of(robot)
    index = {joint.name: j for j, joint in enumerate(moving)}
    mimics = [bool(joint.mimic) for joint in moving]
    master = np.array([index.get(joint.mimic, j) for j, joint in enumerate(moving)], dtype=np.int64)
    for linkage in linkages:
        for j in linkage.joints:
            master[j], mimics[j] = linkage.master, False
    laws = [(joint.multiplier, joint.offset) if mimic else (1.0, 0.0) for joint, mimic in zip(moving, mimics, strict=True)]
    ratio, offset = np.array(laws).reshape(-1, 2).T.copy()
    return Couplings(master=master, ratio=ratio, offset=offset, linkages=linkages)
