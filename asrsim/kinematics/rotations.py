"""Rotations between matrices and rotation vectors; scipy does the work."""

from __future__ import annotations

import numpy as np

from asrsim.samples import Array


def exponential(vector: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) in rad."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix(), dtype=float)


def rotation_between(start: Array, end: Array) -> Array:
    """Rotation vector (3,) in rad of an angle up to pi, world frame, that turns `start` into `end` (both (3, 3))."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(end @ start.T).as_rotvec(), dtype=float)
