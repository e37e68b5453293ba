"""Shapes of collisions and visuals: read, or refused for the reason that they have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

from asrsim.errors import did_you_mean
from asrsim.robot.attributes import words
from asrsim.robot.model import Shape, ShapeKind, Vector
from asrsim.robot.numbers import plain_number
from asrsim.robot.xmlfile import elements, name_of

SIZES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length"), "mesh": ()}
"""Shape -> attributes that it must have."""
LARGEST = 1e6
"""m."""
Colour = tuple[float, float, float, float]


class ShapeError(ValueError):
    """What is wrong with a shape, a phrase to stand behind its name."""


def read_shape(element: Any, colours: Mapping[str, Colour], line: int | None) -> Shape:
    """A `<collision>` or `<visual>`. colours: of the materials that have a name. Raises ShapeError."""
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
        if shape.get(key) is None:
            raise ShapeError(f"has a {shape.tag} without {key}")
        size += _numbers(shape, key, 3 if key == "size" else 1, f"has a {shape.tag} whose")
        if min(size) <= 0.0:
            sign = "negative" if min(size) < 0.0 else "zero"
            raise ShapeError(f"has a {shape.tag} whose {key} is {sign}, '{shape.get(key)}'")
    mesh, scale = "", (1.0, 1.0, 1.0)
    if shape.tag == "mesh":
        mesh = name_of(shape, "filename")
        if not mesh:
            raise ShapeError("has a mesh without filename")
        scale = _scale(shape)
    origins = elements(element, "origin")
    origin, rpy = (_vector(origins[0], key) if origins else (0.0, 0.0, 0.0) for key in ("xyz", "rpy"))
    return Shape(
        kind=shape.tag, size=tuple(size), origin=origin, rpy=rpy, mesh=mesh, scale=scale,
        colour=_colour_of(element, colours), line=line,
    )  # fmt: skip


def read_colours(root: Any) -> dict[str, Colour]:
    """Material name -> colour, of the robot's materials and of those that a visual defines."""
    colours: dict[str, Colour] = {}
    for material in (*elements(root, "material"), *root.iterfind("link/visual/material")):
        colour = _colour(material)
        if colour is not None:
            colours.setdefault(name_of(material), colour)
    return colours


def _numbers(element: Any, key: str, count: int, whose: str) -> list[float]:
    text = element.get(key) or ""
    try:
        numbers = [plain_number(word) for word in words(text)]
    except ValueError:
        raise ShapeError(f"{whose} {key} is not made of numbers, '{text}'") from None
    if len(numbers) != count:
        raise ShapeError(f"{whose} {key} is not {count} number{'s' if count > 1 else ''}, '{text}'")
    if not all(abs(number) <= LARGEST for number in numbers):
        raise ShapeError(f"{whose} {key} is not finite or beyond {LARGEST:g} m, '{text}'")
    return numbers


def _vector(origin: Any, key: str) -> Vector:
    if origin.get(key) is None:
        return (0.0, 0.0, 0.0)
    x, y, z = _numbers(origin, key, 3, "has an <origin> whose")
    return x, y, z


def _scale(mesh: Any) -> Vector:
    text = mesh.get("scale")
    if text is None:
        return (1.0, 1.0, 1.0)
    # One number for all three axes is a common slip that every reader of URDFs understands.
    numbers = _numbers(mesh, "scale", 1 if len(words(text)) == 1 else 3, "has a mesh whose")
    x, y, z = numbers * 3 if len(numbers) == 1 else numbers
    if not x * y * z:
        raise ShapeError(f"has a mesh whose scale is zero, '{text}'")
    return x, y, z


def _colour_of(element: Any, colours: Mapping[str, Colour]) -> Colour | None:
    for material in elements(element, "material"):
        return _colour(material) or colours.get(name_of(material))
    return None


def _colour(material: Any) -> Colour | None:
    """Red, green, blue, opacity; None if it says none that can be used: a colour moves nothing."""
    for colour in elements(material, "color"):
        numbers = colour_numbers(colour.get("rgba") or "")
        if len(numbers) == 4:
            red, green, blue, opacity = numbers
            return red, green, blue, opacity
    return None


def colour_numbers(text: str) -> list[float]:
    """The numbers of a colour, each brought into 0 to 1; none where the text is not made of numbers."""
    try:
        return [min(max(plain_number(word), 0.0), 1.0) for word in words(text)]
    except ValueError:
        return []
