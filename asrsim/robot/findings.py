"""Collects the errors and warnings of one file while its elements are read, and reads their attributes."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Unpack

from asrsim.errors import Details, Problem
from asrsim.robot.model import ZERO, Vector
from asrsim.robot.numbers import plain_number
from asrsim.robot.xmlfile import BLANKS, elements

LARGEST_NUMBER = 1e12
"""Largest plausible mass, inertia or length, SI units; products of larger values would overflow."""
SMALLEST = 1e-30
"""Smallest plausible mass, inertia or parameter other than 0, SI units; inverses of smaller values would overflow."""


_HINTS = (
    (re.compile(r"[\d.]+\s*[:/]\s*[\d.]+"), "Write a ratio as one number: a reduction of 50:1 is 50"),
    (re.compile(r"[-+]?\d+,\d+"), "Write a decimal point"),
    (re.compile(r"[-+]?[\d.]+\s*[^\W\d].*"), "Write the number without its unit, in SI units"),
)
"""Patterns of texts that are not numbers, each with advice on what to write instead."""


_BLANKS = re.compile(f"[{BLANKS}]+")


def words(text: str) -> list[str]:
    """Words of an attribute, separated by the white space of XML."""
    return [word for word in _BLANKS.split(text) if word]


def beyond_a_turn(angles: Sequence[float]) -> bool:
    """Whether the angles of an orientation, read in rad, are probably degrees."""
    return max(map(abs, angles)) > math.tau + 1e-3


class Findings:
    """Reads the attributes of one file's elements and collects its errors and warnings, each with its line.

    `at` is an element, a line, or None.
    """

    def __init__(self, file: Path, *, expanded: bool = False) -> None:
        self.file = file
        self.errors: list[Problem] = []
        self.warnings: list[Problem] = []
        self.expanded = expanded
        """Whether the elements are from an expanded xacro file, whose lines differ from the lines of the user's file."""

    def line(self, at: Any) -> int | None:
        """Line of an element in the user's file; None if unknown."""
        if at is None or isinstance(at, int):
            return at
        return None if self.expanded else at.sourceline

    def error(self, message: str, at: Any, key: str, *, code: str, **details: Unpack[Details]) -> None:
        """Add an error, which means that the file cannot be simulated."""
        self.errors.append(Problem(message, code=code, file=self.file, line=self.line(at), key=key, **details))

    def warn(self, message: str, at: Any, key: str, *, code: str, **details: Unpack[Details]) -> None:
        """Add a warning. The message must not repeat the name in `key`, so that equal messages can be merged."""
        self.warnings.append(Problem(message, code=code, file=self.file, line=self.line(at), key=key, **details))

    def origin(self, element: Any, name: str) -> tuple[Vector, Vector]:
        """Position in m, and roll, pitch, yaw in rad of an `<origin>`; zero without an `<origin>`."""
        tags = elements(element, "origin")
        if not tags:
            return ZERO, ZERO
        key = f"{name}.origin"
        position, angles = self.vector(tags[0], "xyz", key, default=ZERO), self.vector(tags[0], "rpy", key, default=ZERO)
        if beyond_a_turn(angles):
            self.warn(
                "turns by more than one revolution; angles are in rad",
                tags[0],
                key,
                code="rpy-in-degrees",
                value=tags[0].get("rpy"),
                hint="90 degrees are 1.5708 rad",
            )
        return position, angles

    def number(self, element: Any, key: str, place: str, *, required: bool, finite: bool = True) -> float:
        """Attribute as a number; 0 if it is absent or invalid. Invalid and missing required attributes are errors."""
        text = element.get(key)
        if text is None:
            if required:
                self.error(f"attribute '{key}' is missing", element, place, code="missing-attribute")
            return 0.0
        return self.value(text, text, element, place, finite=finite)

    def vector(self, element: Any, key: str, place: str, *, default: Vector | None) -> Vector:
        """Attribute as three numbers; the default if it is absent or invalid. default: None if a missing attribute is an
        error."""
        text = element.get(key)
        if text is None:
            if default is None:
                self.error(f"attribute '{key}' is missing", element, place, code="missing-attribute")
            return default or ZERO
        parts = words(text)
        if len(parts) > 3:
            message = f"'{key}' has {len(parts)} numbers; the first three are used, as other readers do"
            self.warn(message, element, place, code="too-many-numbers", value=text)
            parts = parts[:3]
        if len(parts) != 3:
            self.error(f"'{key}' must be three numbers", element, place, code="not-a-number", value=text)
            return default or ZERO
        x, y, z = (self.value(part, text, element, place) for part in parts)
        return x, y, z

    def value(self, text: str, shown: str, at: Any, place: str, *, finite: bool = True) -> float:
        """Number in a text; 0 with an error if the text is not a number, is infinite where this is invalid, or is too large."""
        fault, code = "", "not-a-number"
        try:
            number = plain_number(text)
        except ValueError:
            fault = "is not a number"
        else:
            if math.isnan(number) or (finite and math.isinf(number)):
                fault, code = "must be finite", "not-finite"
            elif finite and abs(number) > LARGEST_NUMBER:
                fault, code = f"is larger than {LARGEST_NUMBER:g}, too large for a robot", "out-of-range"
        if fault:
            hint = next((hint for pattern, hint in _HINTS if pattern.fullmatch(text.strip())), None)
            self.error(fault, at, place, code=code, value=shown, hint=hint)
        return 0.0 if fault else number
