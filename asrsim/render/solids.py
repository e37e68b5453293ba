"""Triangle meshes: boxes, spheres, cylinders, capsules, and meshes read from files."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from asrsim.samples import Array

Triangles = NDArray[np.intp]
SIDES = 28
"""Number of facets around a round solid; its shading is smooth."""
MOST = 20_000
"""Number of triangles from which a mesh is simplified: triangles smaller than a pixel are merged."""


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """Triangles with normals at their corners."""

    points: Array
    """Points (k, 3), m."""
    triangles: Triangles
    """Indices of the three points of each triangle (m, 3)."""
    normals: Array
    """Unit normal of each corner (m, 3, 3); the three corners of a flat triangle have equal normals."""
    colours: Array | None = None
    """Red, green and blue of each triangle (m, 3), 0 to 1, from the file; NaN for a triangle without colour."""


def flat(points: Array, triangles: Triangles, colours: Array | None = None) -> Mesh:
    """Mesh of flat triangles; triangles without area are omitted."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    kept = length > 0.0
    normals = np.repeat((normals[kept] / length[kept, None])[:, None], 3, axis=1)
    return Mesh(points=points, triangles=triangles[kept], normals=normals, colours=None if colours is None else colours[kept])


def merged(mesh: Mesh, *, most: int = MOST) -> Mesh:
    """Mesh of at most about `most` triangles: points in the same cell of a grid are replaced by their mean."""
    cells = 192.0
    while len(mesh.triangles) > most and cells > 4:
        size = max(float(np.ptp(mesh.points, axis=0).max()), 1e-12) / cells
        keys = np.floor((mesh.points - mesh.points.min(axis=0)) / size).astype(np.int64)
        _, place, counts = np.unique(keys @ [1, 1 << 20, 1 << 40], return_inverse=True, return_counts=True)
        points = np.stack([np.bincount(place, mesh.points[:, i]) for i in range(3)], axis=1) / counts[:, None]
        triangles = place[mesh.triangles]
        ordered = np.sort(triangles, axis=1)
        whole = (np.diff(ordered, axis=1) > 0).all(axis=1)
        _, first = np.unique(ordered[whole], axis=0, return_index=True)
        colours = None if mesh.colours is None else mesh.colours[whole][first]
        mesh = flat(points, triangles[whole][first], colours)
        cells *= 0.7
    return mesh


def box(size: Array) -> Mesh:
    """Box with the edge lengths `size` (3,), m."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return flat(corners, np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))], dtype=np.intp))


def sphere(radius: float) -> Mesh:
    """Sphere; radius in m."""
    return capsule(radius, 0.0)


def cylinder(radius: float, length: float) -> Mesh:
    """Cylinder about z; radius and length in m."""
    half = 0.5 * length
    profile = [(0.0, -half), (radius, -half), (radius, -half), (radius, half), (radius, half), (0.0, half)]
    normals = [(0.0, -1.0), (0.0, -1.0), (1.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, 1.0)]
    return _turned(np.array(profile), np.array(normals))


def capsule(radius: float, length: float) -> Mesh:
    """Cylinder about z with a half sphere at each end; `length` is that of the cylinder, m."""
    angles = np.linspace(-0.5 * math.pi, 0.5 * math.pi, SIDES // 2)
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return _turned(radius * normals + [[0.0, math.copysign(0.5 * length, angle)] for angle in angles], normals)


def _turned(profile: Array, normals: Array) -> Mesh:
    """Solid of revolution: a profile (k, 2) of distances from z and heights, with its normals (k, 2), rotated about z."""
    angles = np.linspace(0.0, 2 * math.pi, SIDES, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def around(values: Array) -> Array:
        flat_part = values[:, None, :1] * ring[None]
        return np.concatenate([flat_part, np.broadcast_to(values[:, None, 1:], (len(values), SIDES, 1))], axis=2).reshape(-1, 3)

    points, directions = around(profile), around(normals)
    triangles = []
    for row in range(len(profile) - 1):
        for i in range(SIDES):
            a, b = row * SIDES + i, row * SIDES + (i + 1) % SIDES
            triangles += [(a, b, b + SIDES), (a, b + SIDES, a + SIDES)]
    numbers = np.array(triangles, dtype=np.intp)
    corners = points[numbers]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    numbers = numbers[area > 0.0]
    return Mesh(points=points, triangles=numbers, normals=directions[numbers])
