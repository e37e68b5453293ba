"""Measures of a body's motion, from poses (n, 7) or positions (n, 3) in m."""

from __future__ import annotations

import math

import numpy as np

from asrsim.samples import Array

AXES = {"x": 0, "y": 1, "z": 2}
"""Column of each axis in a position."""


def displacement(_time: Array, values: Array, *, axis: str | None = None) -> float:
    """Distance between the first and the last position in m; with `axis` (x, y, z) the signed displacement along the axis."""
    way = values[-1, :3] - values[0, :3]
    if axis is None:
        return float(np.linalg.norm(way))
    return float(way[AXES[axis]]) if axis in AXES else math.nan


def maximum_displacement(_time: Array, values: Array) -> float:
    """Largest distance from the first position in m."""
    return float(np.max(np.linalg.norm(values[:, :3] - values[0, :3], axis=1)))


def distance(_time: Array, values: Array, *, x: float, y: float, z: float) -> float:
    """Distance of the last position from the point x, y, z in m."""
    return float(np.linalg.norm(values[-1, :3] - np.array((x, y, z))))
