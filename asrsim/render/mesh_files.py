"""Meshes from STL, OBJ and COLLADA files with their colours, read by trimesh.

As in ROS, a COLLADA file's `<up_axis>` is ignored: the z axis of the file is the z axis of the link.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from asrsim.render.solids import Mesh, flat, merged
from asrsim.robot.meshes import MESH_FORMATS
from asrsim.samples import Array


def read_mesh(path: Path) -> Mesh:
    """Mesh from a file, in the unit of the file (COLLADA: m). Raises ValueError and OSError if it cannot be read."""
    import trimesh

    if path.suffix.lower() not in MESH_FORMATS:
        raise ValueError(f"{path.name} is no .stl, .obj or .dae file")
    try:
        parts = [part for part in trimesh.load_scene(path, process=False).dump() if isinstance(part, trimesh.Trimesh)]
        metres = [trimesh.units.unit_conversion(part.units, "meters") if part.units else 1.0 for part in parts]
        if not parts:
            raise ValueError("no triangle")
    except OSError:
        raise
    except Exception as error:  # trimesh raises errors of many types for broken files
        raise ValueError(f"{path.name} cannot be read: {type(error).__name__} {error}") from None
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts)])
    mesh = flat(
        np.concatenate([part.vertices * size for part, size in zip(parts, metres, strict=True)]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=False)]),
        np.concatenate([np.tile(_colour(part), (len(part.faces), 1)) for part in parts]),
    )
    if not len(mesh.triangles):
        raise ValueError(f"{path.name} has no triangle")
    return merged(mesh)


def _colour(part: Any) -> Array:
    """Colour (3,) of a part's material; NaN without a colour."""
    material = getattr(part.visual, "material", None)
    colour = None if material is None else getattr(material, "diffuse", getattr(material, "baseColorFactor", None))
    return np.full(3, np.nan) if colour is None else np.asarray(colour[:3], dtype=np.float64) / 255.0
