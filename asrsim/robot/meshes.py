"""Mesh files: finds, checks and reads them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.errors import Problem
from asrsim.robot.model import Robot, Shape, Vector
from asrsim.robot.numbers import plain_number
from asrsim.robot.packages import Packages, package_name, packages_of
from asrsim.robot.xmlfile import parse_xml, read_bytes

if TYPE_CHECKING:
    from trimesh import Trimesh

MESH_FORMATS = (".stl", ".obj", ".dae")
FLATTEST = 1e-9
"""Smallest area of a mesh, relative to the square of its size. A mesh that degenerates to a line would crash PyBullet."""
MAX_BYTES = 256 * 1024 * 1024
"""Largest size of a mesh file, bytes."""


def usable_shapes(
    robot: Robot, *, visuals: bool = False, package_paths: Mapping[str, Path | str] | None = None
) -> tuple[Robot, tuple[Problem, ...]]:
    """Robot with the paths of its mesh files, without unusable meshes, and warnings.

    Meshes must exist in the robot's folder, its package or a known package. Each collision that is left out has a warning with
    its link; all visuals share one warning. `visuals=False` leaves out all visuals.
    """
    packages = packages_of(robot.path, package_paths)
    warnings: list[Problem] = []
    missing: list[tuple[str, str]] = []
    links = []
    for link in robot.links:
        readable: dict[str, list[Shape]] = {"collisions": [], "visuals": []}
        for name, shapes in (("collisions", link.collisions), ("visuals", link.visuals if visuals else ())):
            for shape in shapes:
                found = _mesh_file(shape, packages) if shape.kind == "mesh" else None
                if not isinstance(found, str):
                    readable[name].append(shape if found is None else replace(shape, mesh=str(found)))
                elif name == "visuals":
                    missing.append((shape.mesh, found))
                else:
                    message = f"collision mesh {found}; the link does not collide with it"
                    warnings.append(
                        Problem(
                            message,
                            file=robot.path,
                            line=shape.line,
                            key=link.name,
                            value=shape.mesh,
                            hint=_cure(shape.mesh, found),
                            code="missing-collision-mesh",
                        )
                    )
        links.append(replace(link, collisions=tuple(readable["collisions"]), visuals=tuple(readable["visuals"])))
    if missing:
        first, fault = missing[0]
        message = f"{len(missing)} visual meshes are not drawn; the first {fault}"
        hint = _cure(first, fault)
        warnings.append(Problem(message, file=robot.path, value=first, hint=hint, code="missing-visual-mesh"))
    return replace(robot, links=tuple(links)), tuple(warnings)


def _mesh_file(shape: Shape, packages: Packages) -> Path | str:
    """File of a mesh, or the reason why it cannot be used."""
    if Path(shape.mesh).suffix.lower() not in MESH_FORMATS:
        return f"is none of {', '.join(MESH_FORMATS)}"
    found = packages.resolve(shape.mesh)
    return found if isinstance(found, str) else mesh_fault(found) or found


def _cure(mesh: str, fault: str) -> str | None:
    """Hint to state the folder of a package whose folder is unknown."""
    name = package_name(mesh)
    if name is None or not fault.endswith("is not known"):
        return None
    return f"State its folder: --package {name}=FOLDER, in a scenario robot: {{file: ..., packages: {{{name}: FOLDER}}}}"


def mesh_fault(path: Path) -> str | None:
    """Fault of a mesh file (.stl, .obj, .dae) as a phrase; None if it is valid."""
    try:
        if path.stat().st_size > MAX_BYTES:
            return f"is larger than {MAX_BYTES // 2**20} MB"
        with path.open("rb") as stream:
            start = stream.read(100)
        if not start.strip():
            return "is empty"
        if start.startswith(b"version https://git-lfs"):
            return "is a Git LFS pointer, not the mesh itself (git lfs pull fetches it)"
        parts = mesh_parts(path)
    except OSError as error:
        return f"cannot be read: {error.strerror or error}"
    except ValueError as error:
        return str(error)
    points = np.concatenate([part.vertices for part in parts])
    if not np.isfinite(points).all():
        return "has vertices that are not finite"
    area = sum(float(part.area) for part in parts)
    return None if area > FLATTEST * float(np.ptp(points, axis=0).max()) ** 2 else "has no area"


def mesh_parts(path: Path) -> list[Trimesh]:
    """Parts of the mesh in a file, in its unit (COLLADA: m). As in ROS, a COLLADA file's `<up_axis>` is ignored.

    Raises OSError if the file cannot be opened, and ValueError if it contains no valid mesh. The text of a ValueError
    continues a sentence about the file.
    """
    import trimesh

    if path.suffix.lower() not in MESH_FORMATS:
        raise ValueError(f"is none of {', '.join(MESH_FORMATS)}")
    try:
        scene: Any = trimesh.load_scene(path, process=False)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
        part: Any
        for part in parts:
            part.apply_scale(trimesh.units.unit_conversion(part.units, "meters") if part.units else 1.0)
    except OSError:
        raise
    except Exception as error:  # trimesh raises errors of many types for broken files
        raise ValueError(f"cannot be read: {type(error).__name__} {error}") from None
    if not parts:
        raise ValueError("has no triangle")
    return parts


def mesh_unit(path: Path) -> float:
    """Unit of length of a mesh file, m. A COLLADA file states its unit; the numbers of other files are in m."""
    if path.suffix.lower() != ".dae":
        return 1.0
    unit = parse_xml(read_bytes(path), path, large=True).find("{*}asset/{*}unit")
    return 1.0 if unit is None else plain_number(unit.get("meter", "1"))


def convex_hull(path: Path, scale: Vector) -> Trimesh:
    """Convex hull of the mesh in a file, scaled along its axes. Raises ValueError and OSError if the file cannot be read."""
    from trimesh.convex import convex_hull as hull_of

    points = np.concatenate([part.vertices for part in mesh_parts(path)]) * scale
    # Add the centre as a further point, so that a single triangle has the four points that a hull needs.
    with np.errstate(invalid="ignore"):
        hull: Trimesh = hull_of(np.vstack([points, points.mean(axis=0)]))
    return hull
