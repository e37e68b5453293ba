"""Cartesian trajectories: the pose at any time, interpolated between waypoints with times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from asrsim.robot.poses import rotation_matrix
from asrsim.samples import Array
from asrsim.scenario.data import CartesianPose


def minimum_jerk(fraction: Array) -> Array:
    """Minimum-jerk profile 10 s^3 - 15 s^4 + 6 s^5 from 0 to 1, at rest at both ends (Flash and Hogan 1985)."""
    return fraction**3 * (10.0 + fraction * (-15.0 + 6.0 * fraction))


def linear(fraction: Array) -> Array:
    """Profile of constant speed; the velocity jumps at the waypoints."""
    return fraction


INTERPOLATIONS: dict[str, Callable[[Array], Array]] = {"minimum_jerk": minimum_jerk, "linear": linear}
"""Profiles by name: fraction of the segment's length that is covered after a fraction of its time."""


@dataclass(frozen=True, kw_only=True)
class PoseTrajectory:
    """Straight segments between poses, each turning about one axis; constant before the first and after the last pose."""

    times: Array
    """Ascending times (m,) at which the poses are reached, s."""
    positions: Array
    """Positions (m, 3) in the world frame, m."""
    rotations: Array | None
    """Rotations (m, 3, 3); None: the orientation is free."""
    interpolation: str = "minimum_jerk"

    @classmethod
    def through(
        cls, poses: tuple[CartesianPose, ...], interpolation: str, start: tuple[Array, Array] | None = None
    ) -> PoseTrajectory:
        """Trajectory through the poses of a task.

        start: position (3,) and rotation (3, 3) at time 0, prepended if the first pose is later than time 0.
        """
        times = [pose.time for pose in poses]
        positions = [np.asarray(pose.position, dtype=float) for pose in poses]
        turned = [rotation_matrix(pose.rpy) for pose in poses if pose.rpy is not None]
        if start is not None and times[0] > 0.0:
            times.insert(0, 0.0)
            positions.insert(0, start[0])
            if turned:
                turned.insert(0, start[1])
        return cls(
            times=np.array(times),
            positions=np.array(positions),
            rotations=np.array(turned) if turned else None,
            interpolation=interpolation,
        )

    def at(self, time: Array) -> tuple[Array, Array | None]:
        """Positions (n, 3) and rotations (n, 3, 3) (or None) at `time` (n,)."""
        if len(self.times) == 1:
            segment, way = np.zeros(len(time), dtype=int), np.zeros(len(time))
            ends = np.zeros(len(time), dtype=int)
        else:
            segment = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2)
            span = self.times[segment + 1] - self.times[segment]
            way = INTERPOLATIONS[self.interpolation](np.clip((time - self.times[segment]) / span, 0.0, 1.0))
            ends = segment + 1
        positions = self.positions[segment] + way[:, None] * (self.positions[ends] - self.positions[segment])
        if self.rotations is None:
            return positions, None
        from scipy.spatial.transform import Rotation

        turns = np.array([rotation_between(a, b) for a, b in pairwise(self.rotations)]).reshape(-1, 3)
        turns = np.vstack([turns, np.zeros(3)])
        turned = Rotation.from_rotvec(way[:, None] * turns[segment]).as_matrix()
        return positions, turned @ self.rotations[segment]


def rotation_between(start: Array, end: Array) -> Array:
    """Rotation vector (3,) in rad of an angle up to pi, world frame, that turns `start` into `end` (both (3, 3))."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(end @ start.T).as_rotvec(), dtype=float)
