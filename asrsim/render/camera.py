"""Places the camera so that the whole motion is in the picture, seen from the side from which it is most visible."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

FIELD = 32.0
"""Vertical angle of view, degrees. The angle is so small that perspective hardly distorts the robot."""
MARGIN = 1.1
"""Size of the picture relative to the size of the motion; the difference is the margin."""
PLANAR = 0.97
"""Fraction of the motion that must be rotation about a single direction for the motion to count as planar."""


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Camera at `eye` (m) that looks at `target` (m)."""

    eye: Array
    target: Array
    field: float = FIELD

    @property
    def axes(self) -> tuple[Array, Array, Array]:
        """Unit vectors (3,) in the world: right, up and forward in the picture."""
        return view_axes(self.target - self.eye)


def view_axes(direction: Array) -> tuple[Array, Array, Array]:
    """Unit vectors (3,) to the right, up and forward of an upright camera that looks in a direction (3,)."""
    forward = direction / np.linalg.norm(direction)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward), forward


def _direction(azimuth: float, elevation: float) -> Array:
    """Unit vector (3,) with an azimuth from x about z and an elevation, both in degrees."""
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])


def main_axis(axes: Mapping[str, Array], travel: Mapping[str, float]) -> Array | None:
    """Common direction (3,) of the axes about which the robot moves; None if the axes have several directions.

    axes: axis (3,) of each joint in the world; travel: range of each joint's motion, rad.
    """
    total = np.zeros((3, 3))
    for name, axis in axes.items():
        total += max(travel.get(name, 0.0), 1e-6) * np.outer(axis, axis)
    values, vectors = np.linalg.eigh(total)
    if not values.sum() > 0 or values[-1] < PLANAR * values.sum():
        return None
    return np.asarray(vectors[:, -1])


def viewpoint(axis: Array | None) -> Array:
    """Preferred direction (3,) from the scene to the camera: near the axis of a planar motion, but higher and to one side; for
    other motions, from a corner of the scene.

    axis: common axis (3,) of a planar motion; None for other motions.
    """
    if axis is None:
        return _direction(-52.0, 24.0)
    if abs(axis[2]) > 0.8:
        # Show a motion in the horizontal plane from above.
        return _direction(-75.0, 58.0)
    # Choose the side from which x points to the right, or y if x points away from the camera.
    right = np.cross([0.0, 0.0, 1.0], axis)
    turned = right[0] < -1e-9 or (abs(right[0]) <= 1e-9 and right[1] < 0)
    x, y = (-axis if turned else axis)[:2]
    return _direction(float(np.degrees(np.arctan2(y, x))) + 18.0, 14.0)


TURNS, RISES = (0.0, 35.0, -35.0, 70.0, -70.0, 110.0, -110.0, 180.0), (0.0, 25.0)
"""Directions from which the camera may look, in degrees relative to the preferred view. TURNS: azimuths; RISES: elevations."""
STEEPEST = 70.0
"""Largest elevation of the camera, degrees."""


def viewpoints(preferred: Array) -> Iterator[Array]:
    """Directions (3,) from the scene to the camera: first the preferred direction, then other directions around the scene, and
    last directions from higher up.
    """
    azimuth = float(np.degrees(np.arctan2(preferred[1], preferred[0])))
    elevation = float(np.degrees(np.arcsin(preferred[2] / np.linalg.norm(preferred))))
    for rise in RISES:
        for turn in TURNS:
            yield _direction(azimuth + turn, min(elevation + rise, max(STEEPEST, elevation)))


def fitting_aspect(points: Array, towards: Array) -> float:
    """Ratio of width to height of the points (k, 3) as seen from far away in the direction `towards`; limited to 0.7 to 1.6."""
    right, up, _ = view_axes(-towards)
    width, height = np.ptp(points @ right), np.ptp(points @ up)
    return float(np.clip(width / max(float(height), 1e-9), 0.7, 1.6))


def fit_camera(points: Array, towards: Array, *, aspect: float) -> Camera:
    """Camera in the direction `towards` from the points, as near to them as possible with all points in the picture.

    points: points (k, 3), m; towards: direction (3,) from the scene to the camera; aspect: width / height of the picture.
    """
    right, up, forward = view_axes(-towards)
    tangent = np.tan(np.radians(FIELD / 2)) / MARGIN
    target = 0.5 * (points.min(axis=0) + points.max(axis=0))
    # Centre the points in the picture, not their bounding box in the world.
    for _ in range(4):
        seen = points - target
        x, y, depth = seen @ right, seen @ up, seen @ forward
        distance = max(float(np.max(np.abs(x) / (tangent * aspect) - depth)), float(np.max(np.abs(y) / tangent - depth)), 1e-3)
        far = distance + depth
        a, b = x / far, y / far
        target = target + distance * (0.5 * (a.min() + a.max()) * right + 0.5 * (b.min() + b.max()) * up)
    return Camera(eye=target - distance * forward, target=target)
