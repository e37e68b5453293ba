"""Mesh files: finds, checks and reads them. Engines accept invalid files silently, and some invalid files crash them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.errors import Problem
from asrsim.robot.model import Robot, Shape, Vector
from asrsim.robot.packages import Packages, package_name, packages_of

if TYPE_CHECKING:
    from trimesh import Trimesh

MESH_FORMATS = (".stl", ".obj", ".dae")
MAX_BYTES = 256 * 1024 * 1024
"""Largest size of a mesh file, bytes."""
MAX_LINE = 4000
"""Longest word in an OBJ file, bytes: PyBullet's reader copies words into buffers of fixed size."""
_STL_HEAD = 84
"""Bytes before the triangles of a binary STL: 80 of text, 4 of the number of triangles."""
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("attribute", "<u2")])


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
                            message, file=robot.path, line=shape.line, key=link.name, value=shape.mesh,
                            hint=_cure(shape.mesh, found), code="missing-collision-mesh",
                        )
                    )  # fmt: skip
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
    return f"Say where it is: --package {name}=FOLDER, in a scenario robot: {{file: ..., packages: {{{name}: FOLDER}}}}"


def mesh_fault(path: Path) -> str | None:
    """Fault of a mesh file (.stl, .obj, .dae) as a phrase; None if it is valid."""
    try:
        if path.stat().st_size > MAX_BYTES:
            return f"is larger than {MAX_BYTES // 2**20} MB"
        data = path.read_bytes()
    except OSError as error:
        return f"cannot be read: {error.strerror or error}"
    if not data.strip():
        return "is empty"
    if data.startswith(b"version https://git-lfs"):
        return "is a Git LFS pointer, not the mesh itself (git lfs pull fetches it)"
    check = {".stl": _stl_fault, ".obj": _obj_fault, ".dae": _dae_fault}.get(path.suffix.lower())
    return f"is none of {', '.join(MESH_FORMATS)}" if check is None else check(data)


def mesh_parts(path: Path) -> list[Trimesh]:
    """Parts of the mesh in a file, in its unit (COLLADA: m). As in ROS, a COLLADA file's `<up_axis>` is ignored.

    Raises ValueError and OSError if the file cannot be read.
    """
    import trimesh

    if path.suffix.lower() not in MESH_FORMATS:
        raise ValueError(f"{path.name} is no .stl, .obj or .dae file")
    try:
        scene: Any = trimesh.load_scene(path, process=False)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
        part: Any
        for part in parts:
            part.apply_scale(trimesh.units.unit_conversion(part.units, "meters") if part.units else 1.0)
    except OSError:
        raise
    except Exception as error:  # trimesh raises errors of many types for broken files
        raise ValueError(f"{path.name} cannot be read: {type(error).__name__} {error}") from None
    if not parts:
        raise ValueError(f"{path.name} has no triangle")
    return parts


def convex_hull(path: Path, scale: Vector) -> Trimesh:
    """Convex hull of the mesh in a file, scaled along its axes. Raises ValueError and OSError if the file cannot be read."""
    from trimesh.convex import convex_hull as hull_of

    points = np.concatenate([part.vertices for part in mesh_parts(path)]) * scale
    hull: Trimesh = hull_of(points)
    return hull


def _stl_fault(data: bytes) -> str | None:
    count = int.from_bytes(data[80:_STL_HEAD], "little")
    if len(data) < _STL_HEAD or len(data) != _STL_HEAD + count * _STL_TRIANGLE.itemsize:
        if data.lstrip().startswith(b"solid") and b"vertex" in data:
            return "is a text STL file, of which PyBullet reads only binary ones"
        return "is no STL file: its size does not match its number of triangles"
    if count == 0:
        return "has no triangle"
    points = np.frombuffer(data, _STL_TRIANGLE, offset=_STL_HEAD)["points"]
    return None if np.isfinite(points).all() else "has vertices that are not finite"


def _obj_fault(data: bytes) -> str | None:
    if max(map(len, data.splitlines())) > MAX_LINE:
        return f"has a line longer than {MAX_LINE} characters"
    count = len(re.findall(rb"^\s*v\s", data, re.MULTILINE))
    faces = re.findall(rb"^\s*f\s+(.*)$", data, re.MULTILINE)
    if not count or not faces:
        return "has no face"
    if re.search(rb"^\s*v\s.*(?:nan|inf)", data, re.MULTILINE | re.IGNORECASE):
        return "has vertices that are not finite"
    try:
        corners = [int(corner.split(b"/")[0]) for face in faces for corner in face.split()]
    except ValueError:
        return "has a face that is not made of numbers"
    if corners and (max(corners) > count or min(corners) < -count or 0 in corners):
        return f"has a face with a vertex that is not there (there are {count})"
    return None


def _dae_fault(data: bytes) -> str | None:
    from asrsim.errors import RobotError
    from asrsim.robot.xmlfile import parse_xml

    try:
        root = parse_xml(data, Path("mesh.dae"), large=True)
    except RobotError as error:
        return f"is no COLLADA file: {error.problems[0].message}"
    if not str(root.tag).endswith("COLLADA"):
        return "is no COLLADA file"
    primitives = [part for tag in ("triangles", "polylist", "polygons") for part in root.iter(f"{{*}}{tag}")]
    if not primitives:
        return "has no triangle"
    return next((fault for fault in map(_primitive_fault, primitives) if fault), None)


def _primitive_fault(element: Any) -> str | None:
    """Fault of triangles with indices outside of their arrays, which engines do not check; None if all are valid."""
    mesh = element.getparent()
    names = {part.get("id") for part in mesh.iter() if isinstance(part.tag, str)}
    inputs = list(element.iter("{*}input"))
    if any(entry.get("source", "").removeprefix("#") not in names for entry in inputs):
        return "has triangles of vertices that are not there"
    longest = max((len((array.text or "").split()) for array in mesh.iter("{*}float_array")), default=0)
    try:
        indices = [int(index) for part in element.iter("{*}p") for index in (part.text or "").split()]
        needed = int(element.get("count") or 0) * 3 * (1 + max((int(entry.get("offset") or 0) for entry in inputs), default=0))
    except ValueError:
        return "has triangles that are not made of numbers"
    if indices and not 0 <= min(indices) <= max(indices) < longest:
        return "has triangles of vertices that are not there"
    if str(element.tag).endswith("triangles") and needed > len(indices):
        return "has fewer triangles than it says"
    return None
