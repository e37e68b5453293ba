"""Reads the shapes of collisions and visuals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

from asrsim.robot.findings import Findings, words
from asrsim.robot.model import Shape, ShapeKind
from asrsim.robot.numbers import plain_number
from asrsim.robot.xmlfile import elements, name_of

SIZES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length"), "mesh": ()}
"""Required attributes of each shape."""
LARGEST = 1e6
"""Largest size of a shape, m."""
Rgba = tuple[float, float, float, float]


def read_shape(findings: Findings, element: Any, key: str, colours: Mapping[str, Rgba]) -> Shape | None:
    """Shape of a `<collision>` or `<visual>`; None, or a shape with other values, after an error.

    key: place of the element in messages; colours: colours of named materials.
    """
    geometries = elements(element, "geometry")
    shapes = elements(geometries[0]) if geometries else []
    # Look for the shape among all elements, since some programs add other elements.
    shapes = [shape for shape in shapes if shape.tag in SIZES] or shapes
    if not shapes:
        findings.error("must have a <geometry> with a shape", element, key, code="empty-shape")
        return None
    if len(geometries) > 1 or len(shapes) > 1:
        findings.warn("has several shapes; only the first has an effect", element, key, code="shape")
    shape, key = shapes[0], f"{key}.{shapes[0].tag}"
    if shape.tag not in SIZES:
        findings.error("this shape is unknown", shape, key, code="shape", choices=get_args(ShapeKind), meant=shape.tag)
        return None
    size: tuple[float, ...] = ()
    for name in SIZES[shape.tag]:
        if name == "size":
            size += findings.vector(shape, name, key, default=None)
        else:
            size += (findings.number(shape, name, key, required=True),)
        if not findings.errors and not 0.0 < min(size) <= max(size) <= LARGEST:
            message = f"'{name}' must be larger than 0 and at most {LARGEST:g} m"
            code = "empty-shape" if min(size) == 0.0 and max(size) <= LARGEST else "shape"
            findings.error(message, shape, key, code=code, value=shape.get(name))
    mesh, scale = "", (1.0, 1.0, 1.0)
    if shape.tag == "mesh":
        mesh = name_of(shape, "filename")
        if not mesh:
            code = "missing-attribute" if shape.get("filename") is None else "empty-shape"
            findings.error("attribute 'filename' is missing", shape, key, code=code)
        if len(words(shape.get("scale", ""))) == 1:
            # Accept one number for all three axes, a common mistake that all URDF readers accept.
            scale = (findings.number(shape, "scale", key, required=True),) * 3
        else:
            scale = findings.vector(shape, "scale", key, default=scale)
        if not findings.errors and 0.0 in scale:
            findings.error("'scale' must not be 0", shape, key, code="empty-shape", value=shape.get("scale"))
    origin, rpy = findings.origin(element, key)
    return Shape(
        kind=shape.tag,
        size=size,
        origin=origin,
        rpy=rpy,
        mesh=mesh,
        scale=scale,
        colour=_colour_of(element, colours),
        line=findings.line(element),
    )


def read_colours(root: Any) -> dict[str, Rgba]:
    """Colours of the materials of the robot and of the visuals, by name of the material."""
    colours: dict[str, Rgba] = {}
    for material in (*elements(root, "material"), *root.iterfind("link/visual/material")):
        colour = _colour(material)
        if colour is not None:
            colours.setdefault(name_of(material), colour)
    return colours


def _colour_of(element: Any, colours: Mapping[str, Rgba]) -> Rgba | None:
    for material in elements(element, "material"):
        return _colour(material) or colours.get(name_of(material))
    return None


def _colour(material: Any) -> Rgba | None:
    """Red, green, blue and opacity, each limited to 0 to 1; None if missing or invalid. An invalid colour is no error, since
    colours do not affect the motion."""
    for colour in elements(material, "color"):
        try:
            numbers = [min(max(plain_number(word), 0.0), 1.0) for word in words(colour.get("rgba") or "")]
        except ValueError:
            continue
        if len(numbers) == 4:
            return numbers[0], numbers[1], numbers[2], numbers[3]
    return None
