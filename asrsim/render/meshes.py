"""Triangle meshes of solids and of STL, OBJ and COLLADA files with their colours, made by trimesh.

As in ROS, a COLLADA file's `<up_axis>` is ignored: the z axis of the file is the z axis of the link.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.robot.meshes import mesh_parts
from asrsim.samples import Array

if TYPE_CHECKING:
    from trimesh import Trimesh

SIDES = 28
"""Number of facets around a round solid."""
CREASE = 0.6
"""Angle between two triangles, rad, above which their common edge is drawn sharp; other edges are shaded smoothly."""
MOST = 20_000
"""Number of triangles from which the mesh of a file is simplified: points closer together than a pixel are merged."""
CELLS = 192
"""Number of cells along the longest side of the grid in which points are first merged."""


def solid(kind: str, size: Sequence[float]) -> Trimesh:
    """Box (edges x, y, z), sphere (radius), or cylinder or capsule about z (radius, length); sizes in m."""
    from trimesh import creation

    if kind == "box":
        return _smooth(creation.box(size))
    if kind == "cylinder":
        return _smooth(creation.cylinder(radius=size[0], height=size[1], sections=SIDES))
    if kind == "sphere":
        return _smooth(creation.uv_sphere(size[0], count=(SIDES // 2, SIDES)))
    return _smooth(creation.capsule(radius=size[0], height=size[1], count=(SIDES // 2, SIDES)))


def read_mesh(path: Path) -> list[tuple[Trimesh, Array | None]]:
    """Parts of the mesh in a file, in its unit (COLLADA: m), each with its colour (red, green, blue; 0 to 1) or None.

    Raises ValueError and OSError if the file cannot be read.
    """
    from trimesh import Trimesh

    parts = mesh_parts(path)
    # Meshes without textures, which would be copied with each mesh.
    plain = [Trimesh(part.vertices, part.faces) for part in parts]
    return [(_smooth(mesh), _colour(part)) for mesh, part in zip(simplified(plain, most=MOST), parts, strict=True)]


def simplified(meshes: Sequence[Trimesh], *, most: int) -> Sequence[Trimesh]:
    """Meshes in which close points are merged, as coarsely as `most` triangles in all require."""
    longest = max((float(mesh.extents.max()) for mesh in meshes), default=0.0)
    cells, coarse = CELLS, meshes
    while sum(len(mesh.faces) for mesh in coarse) > most and cells > 4:
        coarse = [_simplified(mesh, longest / cells) for mesh in meshes]
        cells = int(0.7 * cells)
    return coarse


def _simplified(mesh: Any, cell: float) -> Any:
    """Mesh in which all points in the same cell of a grid are one point. cell: edge of a cell, m."""
    coarse = mesh.copy()
    coarse.apply_scale(1.0 / cell)
    coarse.merge_vertices(digits_vertex=0, merge_norm=True)
    coarse.update_faces(coarse.nondegenerate_faces() & coarse.unique_faces())
    coarse.apply_scale(cell)
    return coarse


def _smooth(mesh: Trimesh) -> Trimesh:
    """Mesh whose triangles share the normals of their points, except along sharp edges."""
    from trimesh.graph import smooth_shade

    smooth: Trimesh = smooth_shade(mesh, angle=CREASE, facet_minarea=None)
    return smooth


def _colour(part: Any) -> Array | None:
    """Colour (3,) of a part's material; None without a colour."""
    material = getattr(part.visual, "material", None)
    colour = None if material is None else getattr(material, "diffuse", getattr(material, "baseColorFactor", None))
    return None if colour is None else np.asarray(colour[:3], dtype=np.float64) / 255.0
