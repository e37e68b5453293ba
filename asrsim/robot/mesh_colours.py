"""The colour that a COLLADA mesh has of its own: engines draw a mesh in one colour, and leave the file's materials unread."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from asrsim.errors import RobotError
from asrsim.robot.shapes import Colour, colour_numbers
from asrsim.robot.xmlfile import parse_xml, read_bytes


def mesh_colour(path: Path) -> Colour | None:
    """The diffuse colour of most triangles; None if the mesh is no COLLADA file or says none."""
    if path.suffix.lower() != ".dae":
        return None
    try:
        root = parse_xml(read_bytes(path), path, large=True)
    except RobotError:
        return None
    effects = {effect.get("id"): _diffuse(effect) for effect in root.iter("{*}effect")}
    materials = {
        material.get("id"): effects.get(instance.get("url", "").removeprefix("#"))
        for material in root.iter("{*}material")
        for instance in material.iter("{*}instance_effect")
    }
    bound = {
        instance.get("symbol"): instance.get("target", "").removeprefix("#") for instance in root.iter("{*}instance_material")
    }
    triangles: Counter[Colour] = Counter()
    for tag in ("triangles", "polylist", "polygons"):
        for primitive in root.iter(f"{{*}}{tag}"):
            symbol = primitive.get("material")
            colour = materials.get(bound.get(symbol, symbol))
            if colour is not None:
                triangles[colour] += _count(primitive)
    return triangles.most_common(1)[0][0] if triangles else None


def _diffuse(effect: Any) -> Colour | None:
    for diffuse in effect.iter("{*}diffuse"):
        for colour in diffuse.iter("{*}color"):
            numbers = colour_numbers(colour.text or "")
            if len(numbers) in (3, 4):
                red, green, blue = numbers[:3]
                # Exporters write opacity 0 where they have none: an invisible mesh is not meant.
                return red, green, blue, numbers[3] if len(numbers) == 4 and numbers[3] > 0.0 else 1.0
    return None


def _count(primitive: Any) -> int:
    text = primitive.get("count", "")
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 10 else 1
