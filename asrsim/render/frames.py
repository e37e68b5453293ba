"""Rotations and frames for pictures."""

from __future__ import annotations

import numpy as np

from asrsim.robot.model import Vector
from asrsim.robot.poses import rotation_matrix
from asrsim.samples import Array


def about(axis: Array, angle: float) -> Array:
    """Rotation (3, 3) about an axis (3,) by an angle in rad (Rodrigues' formula)."""
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        return np.eye(3)
    x, y, z = axis / length
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k))


def frame(position: Array, rotation: Array) -> Array:
    """Homogeneous frame (4, 4) at a position (3,) in m."""
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = rotation, position
    return result


def rpy_frame(position: Vector, rpy: Vector) -> Array:
    """Frame (4, 4) of a URDF `<origin xyz rpy>`, m and rad."""
    return frame(np.array(position), rotation_matrix(rpy))


def pose_frame(pose: Array) -> Array:
    """Frame (4, 4) of a logged pose: x y z (m), quaternion x y z w."""
    x, y, z, w = pose[3:7] / np.linalg.norm(pose[3:7])
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return frame(pose[:3], rotation)
