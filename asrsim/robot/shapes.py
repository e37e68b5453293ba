"""Shapes of collisions and visuals: whether their numbers are some that an engine takes."""

from __future__ import annotations

import math
from typing import Any

from asrsim.robot.xmlfile import elements

SIZES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}
"""Shape -> attributes that it must have."""
LARGEST = 1e6
"""m."""


def shape_fault(element: Any) -> str | None:
    """What is wrong with a `<collision>` or `<visual>`, a phrase to stand behind its name, or None."""
    geometries = elements(element, "geometry")
    if len(geometries) != 1:
        return "has no <geometry>" if not geometries else "has more than one <geometry>"
    shapes = elements(geometries[0])
    if len(shapes) != 1:
        return "has an empty <geometry>" if not shapes else "has more than one shape in its <geometry>"
    for origin in elements(element, "origin"):
        for key in ("xyz", "rpy"):
            if (fault := _numbers_fault(origin, key, 3)) is not None:
                return f"has an <origin> whose {fault}"
    shape = shapes[0]
    if shape.tag == "mesh":
        fault = _numbers_fault(shape, "scale", 3) if len((shape.get("scale") or "").split()) != 1 else None
        return f"has a mesh whose {fault}" if fault else None
    for key in SIZES.get(shape.tag, ()):
        if shape.get(key) is None:
            return f"has a {shape.tag} without {key}"
        fault = _numbers_fault(shape, key, 3 if key == "size" else 1, negative=False)
        if fault is not None:
            return f"has a {shape.tag} whose {fault}"
    return None


def _numbers_fault(element: Any, key: str, count: int, *, negative: bool = True) -> str | None:
    text = element.get(key)
    if text is None:
        return None
    try:
        numbers = [float(part) for part in text.split()]
    except ValueError:
        return f"{key} is not made of numbers, '{text}'"
    if len(numbers) != count:
        return f"{key} is not {count} number{'s' if count > 1 else ''}, '{text}'"
    if not all(math.isfinite(number) and abs(number) <= LARGEST for number in numbers):
        return f"{key} is not finite or beyond {LARGEST:g} m, '{text}'"
    if not negative and min(numbers) < 0.0:
        return f"{key} is negative, '{text}'"
    return None
