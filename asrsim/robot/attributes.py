"""Numbers in XML attributes: read, and refused with file, line and key where they are none."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from asrsim.robot.findings import Reader
from asrsim.robot.model import Vector
from asrsim.robot.numbers import plain_number
from asrsim.robot.xmlfile import BLANKS, elements

LARGEST = 1e12
"""In SI units: masses, inertias and lengths beyond it are mistakes, and their products would overflow."""
SMALLEST = 1e-30
"""In SI units: masses, inertias and parameters closer to 0, and not 0, are mistakes, and their inverses would overflow."""
ROUNDING = 1e-15
"""kg m^2, below which all of a link's inertia is 0 with the rounding of the program that wrote it."""


def words(text: str) -> list[str]:
    """The parts of an attribute, parted by XML's own blanks."""
    return [word for word in re.split(f"[{BLANKS}]+", text) if word]


def beyond_a_turn(angles: Sequence[float]) -> bool:
    """Whether an orientation's angles in rad are degrees, most likely."""
    return max(map(abs, angles)) > math.tau + 1e-3


class AttributeReader(Reader):
    """Reads attributes; problems go to `findings`, and a harmless value comes back."""

    def origin(self, element: Any, name: str) -> tuple[Vector, Vector]:
        """Position in m and roll, pitch, yaw in rad of an `<origin>`, zero where it is absent."""
        tags = elements(element, "origin")
        if not tags:
            return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        zero = (0.0, 0.0, 0.0)
        key = f"{name}.origin"
        position, angles = self.vector(tags[0], "xyz", key, default=zero), self.vector(tags[0], "rpy", key, default=zero)
        if beyond_a_turn(angles):
            self.warn(
                "turns by more than once round; angles are in rad", tags[0], key, code="rpy-in-degrees",
                value=tags[0].get("rpy"), hint="90 degrees are 1.5708 rad",
            )  # fmt: skip
        return position, angles

    def number(self, element: Any, key: str, place: str, *, required: bool, finite: bool = True) -> float:
        """Attribute as a number; 0 if it is absent or wrong (the wrong is an error, so is a missing required one)."""
        text = element.get(key)
        if text is None:
            if required:
                self.error(f"attribute '{key}' is missing", element, place, code="missing-attribute")
            return 0.0
        return self._float(text, text, element, place, finite=finite)

    def vector(self, element: Any, key: str, place: str, *, default: Vector) -> Vector:
        """Attribute as three numbers; the default if it is absent or wrong."""
        text = element.get(key)
        if text is None:
            return default
        parts = words(text)
        if len(parts) != 3:
            self.error(f"'{key}' must be three numbers", element, place, code="not-a-number", value=text)
            return default
        x, y, z = (self._float(part, text, element, place, finite=True) for part in parts)
        return x, y, z

    def _float(self, text: str, shown: str, element: Any, place: str, *, finite: bool) -> float:
        try:
            value = plain_number(text)
        except ValueError:
            self.error("is not a number", element, place, code="not-a-number", value=shown)
            return 0.0
        return self.bounded(value, shown, element, place, finite=finite)

    def bounded(self, value: float, shown: str, element: Any, place: str, *, finite: bool) -> float:
        """The value, or 0 and an error if it is no number, infinite where it must not be, or beyond all reason."""
        if math.isnan(value) or (finite and math.isinf(value)):
            self.error("must be finite", element, place, code="not-finite", value=shown)
            return 0.0
        if finite and abs(value) > LARGEST:
            self.error(f"is larger than {LARGEST:g}, which no robot has", element, place, code="out-of-range", value=shown)
            return 0.0
        return value
