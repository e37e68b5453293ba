"""Prepares triangle meshes for pictures: fewer triangles, smooth shading, and one colour for each mesh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.samples import Array

if TYPE_CHECKING:
    from trimesh import Trimesh

CREASE = 0.6
"""Angle between two triangles, rad, above which their common edge is drawn sharp and not shaded smoothly."""
MOST = 20_000
"""Number of triangles of a body above which its meshes are simplified. The merged points are closer together than a pixel."""
CELLS = 192
"""Number of cells along the longest side of the grid in which points are first merged."""


def simplified(meshes: Sequence[Trimesh], *, most: int = MOST) -> list[Trimesh]:
    """Meshes in which close points are merged, so that all meshes together have at most `most` triangles."""
    longest = max((float(mesh.extents.max()) for mesh in meshes), default=0.0)
    cells, coarse = CELLS, list(meshes)
    while sum(len(mesh.faces) for mesh in coarse) > most and cells > 4:
        coarse = [_merged(mesh, longest / cells) for mesh in meshes]
        cells = int(0.7 * cells)
    return coarse


def _merged(mesh: Any, cell: float) -> Any:
    """Mesh in which all points in the same cell of a grid are merged to one point. cell: length of a cell's edge, m."""
    coarse = mesh.copy()
    coarse.apply_scale(1.0 / cell)
    coarse.merge_vertices(digits_vertex=0, merge_norm=True)
    coarse.update_faces(coarse.nondegenerate_faces() & coarse.unique_faces())
    coarse.apply_scale(cell)
    return coarse


def smooth(mesh: Trimesh) -> Trimesh:
    """Mesh in which neighbouring triangles have the same normals at their common points, except along sharp edges."""
    from trimesh.graph import smooth_shade

    shaded: Trimesh = smooth_shade(mesh, angle=CREASE, facet_minarea=None)
    return shaded


def main_colour(mesh: Any) -> Array | None:
    """Colour (red, green, blue; 0 to 1) of a mesh: the colour of its material, else the colour of most of its faces; None
    without a colour.
    """
    visual = mesh.visual
    if not visual.defined:
        return None
    colour = visual.material.main_color if visual.kind == "texture" else visual.main_color
    return np.asarray(colour[:3], dtype=np.float64) / 255.0
