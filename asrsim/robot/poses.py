"""Poses as in URDFs: positions in m, and roll, pitch, yaw in rad about fixed x, y, z."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, sin
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from asrsim.robot.model import Robot, Vector

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Pose:
    """Pose of a frame in another frame: a point x lies at `position + rotation @ x`."""

    position: Array
    """Position (3,), m."""
    rotation: Array
    """Rotation matrix (3, 3)."""

    def then(self, position: Vector, rpy: Vector) -> Pose:
        """Pose, in the parent frame of this pose, of a frame with `position` (m) and `rpy` (rad) relative to this pose."""
        return Pose(position=self.position + self.rotation @ position, rotation=self.rotation @ rotation_matrix(rpy))

    @property
    def is_identity(self) -> bool:
        """Whether the pose is exactly the identity."""
        return not self.position.any() and bool((self.rotation == _UNTURNED).all())


_UNTURNED = np.eye(3)
HERE = Pose(position=np.zeros(3), rotation=_UNTURNED)


def frame(position: ArrayLike, rotation: ArrayLike) -> Array:
    """Pose (..., 4, 4) of a frame at a position (..., 3) in m with a rotation matrix (..., 3, 3), as a homogeneous matrix."""
    turned = np.asarray(rotation)
    pose = np.zeros((*turned.shape[:-2], 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = turned, position, 1.0
    return pose


def cross_matrix(vector: Vector | Array) -> Array:
    """Matrix (3, 3) whose product with a second vector is the cross product of the two vectors."""
    x, y, z = vector
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


def rotation_matrix(rpy: Vector) -> Array:
    """Rotation matrix (3, 3) of roll, pitch, yaw in rad (about fixed x, y, z)."""
    (cr, cp, cy), (sr, sp, sy) = map(cos, rpy), map(sin, rpy)
    return np.array(
        (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
    )


def rotation_about(axis: Vector, angle: float) -> Array:
    """Rotation matrix (3, 3) of an angle in rad about a unit vector, by Rodrigues' formula."""
    cross = cross_matrix(axis)
    rotation: Array = np.eye(3) + sin(angle) * cross + (1.0 - cos(angle)) * cross @ cross
    return rotation


def roll_pitch_yaw(rotation: Array) -> Vector:
    """Roll, pitch, yaw in rad, the inverse of `rotation_matrix`. The result is also accurate at a pitch of 90 degrees, where
    yaw is arbitrary.

    Yaw is computed first. Roll and pitch are computed from the rotation without this yaw, so the three angles are always
    consistent.
    """
    yaw = atan2(rotation[1, 0], rotation[0, 0])
    c, s = cos(yaw), sin(yaw)
    pitch = atan2(-rotation[2, 0], c * rotation[0, 0] + s * rotation[1, 0])
    roll = atan2(s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1])
    return roll, pitch, yaw


def quaternion(rpy: Vector) -> tuple[float, float, float, float]:
    """Unit quaternion (x, y, z, w) of roll, pitch, yaw in rad."""
    (sr, cr), (sp, cp), (sy, cy) = ((sin(0.5 * angle), cos(0.5 * angle)) for angle in rpy)
    return (sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy)


def rotation_of(quaternion: Sequence[float]) -> Array:
    """Rotation matrix (3, 3) of a unit quaternion x, y, z, w."""
    vector, w = np.asarray(quaternion[:3]), quaternion[3]
    cross = cross_matrix(vector)
    rotation: Array = np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross
    return rotation


def link_poses(robot: Robot) -> dict[str, Pose]:
    """Pose of each link in the root's frame at the zero posture, by name of the link; parents precede children."""
    poses = {robot.root.name: HERE}
    for joint in robot.outward_joints:
        poses[joint.child] = poses[joint.parent].then(joint.origin, joint.rpy)
    return poses
