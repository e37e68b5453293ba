"""Meshes from files: STL (binary and text), OBJ and COLLADA, with the colours that they bring along.

The files are those that :func:`asrsim.robot.meshes.mesh_fault` found nothing against. As in ROS, a COLLADA file's `<up_axis>`
is not applied: its z is the link's z.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.render.solids import Mesh, Triangles, flat, merged
from asrsim.samples import Array

_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("attribute", "<u2")])


def read_mesh(path: Path) -> Mesh:
    """The mesh in a file, in the file's unit (COLLADA: m). Raises ValueError and OSError where it cannot be read."""
    reader = {".stl": _stl, ".obj": _obj, ".dae": _dae}.get(path.suffix.lower())
    if reader is None:
        raise ValueError(f"{path.name} is no .stl, .obj or .dae file")
    mesh = merged(reader(path))
    if not len(mesh.triangles):
        raise ValueError(f"{path.name} has no triangle")
    return mesh


def _stl(path: Path) -> Mesh:
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    if len(data) == 84 + count * _STL_TRIANGLE.itemsize:
        corners = np.frombuffer(data, _STL_TRIANGLE, offset=84)["points"].astype(np.float64).reshape(-1, 3)
    else:
        numbers = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", data)
        corners = np.array(numbers, dtype=np.float64).reshape(-1, 3)
    corners = corners[: len(corners) // 3 * 3]
    return flat(corners, np.arange(len(corners), dtype=np.intp).reshape(-1, 3))


def _obj(path: Path) -> Mesh:
    points: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    colours: list[tuple[float, ...]] = []
    materials: dict[str, tuple[float, ...]] = {}
    colour: tuple[float, ...] = (np.nan,) * 3
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            points.append([float(word) for word in words[1:4]])
        elif words[0] == "f":
            corners = [int(word.split("/")[0]) for word in words[1:]]
            corners = [corner - 1 if corner > 0 else len(points) + corner for corner in corners]
            triangles += [(corners[0], a, b) for a, b in pairwise(corners[1:])]
            colours += [colour] * max(len(corners) - 2, 0)
        elif words[0] == "mtllib" and len(words) > 1:
            materials |= _mtl(path.parent / Path(line.split(None, 1)[1].strip()).name)
        elif words[0] == "usemtl" and len(words) > 1:
            colour = materials.get(words[1], (np.nan,) * 3)
    shape = np.array(colours, dtype=np.float64).reshape(-1, 3)
    return flat(np.array(points), np.array(triangles, dtype=np.intp).reshape(-1, 3), shape)


def _mtl(path: Path) -> dict[str, tuple[float, ...]]:
    """Material -> its diffuse colour; nothing from a file beside the mesh that is not there."""
    if not path.is_file():
        return {}
    found: dict[str, tuple[float, ...]] = {}
    name = ""
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        words = line.split()
        if words[:1] == ["newmtl"] and len(words) > 1:
            name = words[1]
        elif words[:1] == ["Kd"] and len(words) >= 4:
            found[name] = tuple(float(word) for word in words[1:4])
    return found


def _dae(path: Path) -> Mesh:
    from asrsim.robot.xmlfile import parse_xml

    root = parse_xml(path.read_bytes(), path)
    by_id = {element.get("id"): element for element in root.iter() if isinstance(element.tag, str) and element.get("id")}
    unit = root.find("{*}asset/{*}unit")
    metres = float(unit.get("meter", "1")) if unit is not None else 1.0
    parts: list[tuple[Array, Triangles, Array]] = []
    for geometry, transform, bound in _instances(root, by_id):
        for points, triangles, symbol in _primitives(geometry, by_id):
            colour = _dae_colour(by_id.get(bound.get(symbol, symbol)), by_id)
            moved = points @ transform[:3, :3].T + transform[:3, 3]
            parts.append((moved, triangles, np.tile(colour, (len(triangles), 1))))
    if not parts:
        raise ValueError(f"{path.name} shows no geometry")
    offsets = np.cumsum([0, *(len(points) for points, _, _ in parts)])
    return flat(
        metres * np.concatenate([points for points, _, _ in parts]),
        np.concatenate([triangles + offset for (_, triangles, _), offset in zip(parts, offsets, strict=False)]),
        np.concatenate([colours for _, _, colours in parts]),
    )


def _instances(root: Any, by_id: dict[str, Any]) -> Iterator[tuple[Any, Array, dict[str, str]]]:
    """Every geometry of the scene with its (4, 4) transform and its materials by symbol."""

    def walk(node: Any, parent: Array, depth: int) -> Iterator[tuple[Any, Array, dict[str, str]]]:
        transform = parent @ _node_transform(node)
        for instance in node.findall("{*}instance_geometry"):
            geometry = by_id.get(instance.get("url", "").removeprefix("#"))
            bound = {m.get("symbol", ""): m.get("target", "").removeprefix("#") for m in instance.iter("{*}instance_material")}
            if geometry is not None:
                yield geometry, transform, bound
        inner = [by_id.get(one.get("url", "").removeprefix("#")) for one in node.findall("{*}instance_node")]
        for child in (*node.findall("{*}node"), *(one for one in inner if one is not None)):
            # A file that nests nodes in themselves has no end.
            if depth < 32:
                yield from walk(child, transform, depth + 1)

    nodes = [node for scene in root.iter("{*}visual_scene") for node in scene.findall("{*}node")]
    if nodes:
        for node in nodes:
            yield from walk(node, np.eye(4), 0)
    else:
        for geometry in root.iter("{*}geometry"):
            yield geometry, np.eye(4), {}


def _node_transform(node: Any) -> Array:
    total = np.eye(4)
    for element in node:
        kind = str(element.tag).rpartition("}")[2]
        if kind not in ("matrix", "translate", "rotate", "scale"):
            continue
        numbers = np.array((element.text or "").split(), dtype=np.float64)
        step = np.eye(4)
        if kind == "matrix" and len(numbers) == 16:
            step = numbers.reshape(4, 4)
        elif kind == "translate" and len(numbers) == 3:
            step[:3, 3] = numbers
        elif kind == "scale" and len(numbers) == 3:
            step[:3, :3] = np.diag(numbers)
        elif kind == "rotate" and len(numbers) == 4:
            from asrsim.render.frames import about

            step[:3, :3] = about(numbers[:3], np.radians(numbers[3]))
        total = total @ step
    return total


def _primitives(geometry: Any, by_id: dict[str, Any]) -> Iterator[tuple[Array, Triangles, str]]:
    """(points, triangles, symbol of the material) of each group of a geometry's triangles and polygons."""
    for group in (g for tag in ("triangles", "polylist", "polygons") for g in geometry.iter(f"{{*}}{tag}")):
        inputs = group.findall("{*}input")
        vertex = next((entry for entry in inputs if entry.get("semantic") == "VERTEX"), None)
        numbers = [np.array((p.text or "").split(), dtype=np.intp) for p in group.findall("{*}p")]
        if vertex is None or not numbers:
            continue
        width = 1 + max(int(entry.get("offset", "0")) for entry in inputs)
        offset = int(vertex.get("offset", "0"))
        counts = group.find("{*}vcount")
        if counts is not None:
            sizes = [int(word) for word in (counts.text or "").split()]
        elif str(group.tag).endswith("polygons"):
            sizes = [len(part) // width for part in numbers]
        else:
            sizes = [3] * (sum(map(len, numbers)) // (3 * width))
        corners = np.concatenate(numbers)[offset::width]
        points = _positions(by_id.get(vertex.get("source", "").removeprefix("#")), by_id)
        if points is None:
            continue
        starts = np.cumsum([0, *sizes[:-1]])
        fans = [(a, a + k, a + k + 1) for a, size in zip(starts.tolist(), sizes, strict=True) for k in range(1, size - 1)]
        if fans and max(map(max, fans)) < len(corners) and corners.max() < len(points):
            yield points, corners[np.array(fans, dtype=np.intp)], group.get("material", "")


def _positions(vertices: Any, by_id: dict[str, Any]) -> Array | None:
    if vertices is None:
        return None
    source = vertices
    if str(vertices.tag).endswith("vertices"):
        entry = next((e for e in vertices.findall("{*}input") if e.get("semantic") == "POSITION"), None)
        source = None if entry is None else by_id.get(entry.get("source", "").removeprefix("#"))
    numbers = None if source is None else source.find("{*}float_array")
    if numbers is None:
        return None
    accessor = source.find("{*}technique_common/{*}accessor")
    stride = int(accessor.get("stride", "3")) if accessor is not None else 3
    values = np.array((numbers.text or "").split(), dtype=np.float64)
    return values[: len(values) // stride * stride].reshape(-1, stride)[:, :3]


def _dae_colour(material: Any, by_id: dict[str, Any]) -> Array:
    """(3,) diffuse colour of a material, NaN where it has none."""
    instance = None if material is None else material.find("{*}instance_effect")
    effect = None if instance is None else by_id.get(instance.get("url", "").removeprefix("#"))
    colour = None if effect is None else next(effect.iter("{*}diffuse"), None)
    colour = None if colour is None else colour.find("{*}color")
    values = np.array((colour.text or "").split(), dtype=np.float64) if colour is not None else np.empty(0)
    return values[:3] if len(values) >= 3 else np.full(3, np.nan)
