"""Reads the shapes of collisions and visuals, or refuses them with the reason."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

from asrsim.errors import counted, did_you_mean
from asrsim.robot.findings import ZERO, words
from asrsim.robot.model import Shape, ShapeKind
from asrsim.robot.numbers import plain_number
from asrsim.robot.xmlfile import elements, name_of

SIZES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length"), "mesh": ()}
"""Required attributes of each shape."""
LARGEST = 1e6
"""Largest size of a shape, m."""
Colour = tuple[float, float, float, float]


class ShapeError(ValueError):
    """Raised for a faulty shape. The message is a phrase that follows the shape's name."""


def read_shape(element: Any, colours: Mapping[str, Colour], line: int | None) -> Shape:
    """Shape of a `<collision>` or `<visual>`. colours: colours of named materials. Raises ShapeError."""
    geometries = elements(element, "geometry")
    if len(geometries) != 1:
        raise ShapeError("has no <geometry>" if not geometries else "has more than one <geometry>")
    shapes = elements(geometries[0])
    if len(shapes) != 1:
        raise ShapeError("has an empty <geometry>" if not shapes else "has more than one shape in its <geometry>")
    shape = shapes[0]
    if shape.tag not in SIZES:
        known = get_args(ShapeKind)
        hint = did_you_mean(shape.tag, known)
        raise ShapeError(f"has a shape <{shape.tag}> that is not known, only {', '.join(known)}{f'. {hint}' if hint else ''}")
    size: list[float] = []
    for key in SIZES[shape.tag]:
        size += _numbers(shape, key, 3 if key == "size" else 1)
        if min(size) <= 0.0:
            raise ShapeError(f"has a {shape.tag} whose {key} is not larger than 0, '{shape.get(key)}'")
    mesh, scale = "", [1.0, 1.0, 1.0]
    if shape.tag == "mesh":
        mesh = name_of(shape, "filename")
        if not mesh:
            raise ShapeError("has a mesh without filename")
        # One number for all three axes is a common slip that every reader of URDFs understands.
        single = len(words(shape.get("scale", ""))) == 1
        scale = _numbers(shape, "scale", 1, scale) * 3 if single else _numbers(shape, "scale", 3, scale)
        if 0.0 in scale:
            raise ShapeError(f"has a mesh whose scale is zero, '{shape.get('scale')}'")
    origins = elements(element, "origin")
    (x, y, z), (roll, pitch, yaw) = (_numbers(origins[0], key, 3, ZERO) if origins else ZERO for key in ("xyz", "rpy"))
    return Shape(
        kind=shape.tag, size=tuple(size), origin=(x, y, z), rpy=(roll, pitch, yaw), mesh=mesh,
        scale=(scale[0], scale[1], scale[2]), colour=_colour_of(element, colours), line=line,
    )  # fmt: skip


def read_colours(root: Any) -> dict[str, Colour]:
    """Colours of the materials of the robot and of the visuals, by name of the material."""
    colours: dict[str, Colour] = {}
    for material in (*elements(root, "material"), *root.iterfind("link/visual/material")):
        colour = _colour(material)
        if colour is not None:
            colours.setdefault(name_of(material), colour)
    return colours


def _numbers(element: Any, key: str, count: int, default: Any = None) -> list[float]:
    text = element.get(key)
    if text is None and default is not None:
        return list(default)
    if text is None:
        raise ShapeError(f"has a {element.tag} without {key}")
    try:
        numbers = [plain_number(word) for word in words(text)]
        fault = "" if len(numbers) == count else f"is not {counted(count, 'number')}"
    except ValueError:
        numbers, fault = [], "is not made of numbers"
    if not all(abs(number) <= LARGEST for number in numbers):
        fault = f"is not finite or beyond {LARGEST:g} m"
    if fault:
        raise ShapeError(f"has a {element.tag} whose {key} {fault}, '{text}'")
    return numbers


def _colour_of(element: Any, colours: Mapping[str, Colour]) -> Colour | None:
    for material in elements(element, "material"):
        return _colour(material) or colours.get(name_of(material))
    return None


def _colour(material: Any) -> Colour | None:
    """Red, green, blue and opacity, each limited to 0 to 1; None if missing or invalid, as colours do not affect the motion."""
    for colour in elements(material, "color"):
        try:
            numbers = [min(max(plain_number(word), 0.0), 1.0) for word in words(colour.get("rgba") or "")]
        except ValueError:
            continue
        if len(numbers) == 4:
            return numbers[0], numbers[1], numbers[2], numbers[3]
    return None
