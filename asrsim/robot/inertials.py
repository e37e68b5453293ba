"""Masses and inertias of links in a URDF: read, each checked to be one that a body can have."""

from __future__ import annotations

from typing import Any

import numpy as np

from asrsim.robot.attributes import ROUNDING, SMALLEST, AttributeReader
from asrsim.robot.model import INERTIAS
from asrsim.robot.xmlfile import elements

ROUNDED, NEGLIGIBLE = 1e-3, 1e-6
"""Shares of a link's own largest moment of inertia, and of its robot's: a negative moment up to either is a slip of digits."""


class InertialReader(AttributeReader):
    """Reads what stands in `<inertial>`; problems go to `findings`."""

    largest = 0.0
    """kg m^2, of all moments of inertia in the file."""

    def mass(self, inertial: Any, name: str) -> float:
        tags = elements(inertial, "mass")
        if not tags:
            self.error("<inertial> has no <mass>", inertial, name, code="missing-tag")
            return 0.0
        before = len(self.findings.errors)
        mass = self.number(tags[0], "value", f"{name}.mass", required=True)
        if mass < 0.0:
            self.error("mass must not be negative", tags[0], name, code="negative-mass", value=f"{mass:g}")
        elif 0.0 < mass < SMALLEST:
            self._too_small(tags[0], f"{name}.mass", mass)
        elif mass == 0.0 and len(self.findings.errors) == before:
            self.warn("mass is zero", tags[0], name, code="massless-link")
        return mass

    def inertia(self, inertial: Any, name: str, mass: float) -> tuple[float, float, float, float, float, float]:
        tags = elements(inertial, "inertia")
        if not tags:
            self.error("<inertial> has no <inertia>", inertial, name, code="missing-tag")
            return (0.0,) * 6
        before = len(self.findings.errors)
        # Left-out products of inertia are zero in every URDF reader; left-out moments are mistakes.
        values = [self.number(tags[0], key, f"{name}.{key}", required=key in ("ixx", "iyy", "izz")) for key in INERTIAS]
        xx, xy, xz, yy, yz, zz = values
        for moment in (xx, yy, zz):
            if 0.0 < abs(moment) < SMALLEST:
                self._too_small(tags[0], f"{name}.inertia", moment)
        if max(abs(value) for value in values) < ROUNDING:
            xx = xy = xz = yy = yz = zz = 0.0
        tensor = np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
        if len(self.findings.errors) == before:
            tensor = self._physical(name, mass, tensor, self.line(tags[0]))
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor.tolist()
        return xx, xy, xz, yy, yz, zz

    def _too_small(self, element: Any, place: str, value: float) -> None:
        self.error(
            f"is closer to 0 than {SMALLEST:g}, which no body is", element, place, code="out-of-range", value=f"{value:g}"
        )

    def _physical(self, name: str, mass: float, matrix: np.ndarray, line: int | None) -> np.ndarray:
        """The tensor, or the nearest one that a body can have where a slip of digits made it none."""
        moments, axes = np.linalg.eigh(matrix)
        scale = float(np.abs(matrix).max())
        shown = ", ".join(f"{moment:.4g}" for moment in moments)
        if scale == 0.0:
            if mass > 0.0:
                self.findings.warn("inertia is zero", code="zero-inertia", line=line, key=name)
        elif -1e-9 * scale > moments[0] >= -max(ROUNDED * scale, NEGLIGIBLE * self.largest):
            self.findings.warn(
                "inertia has a negative principal moment, too small to matter: taken as the nearest that a body can have",
                code="rounded-inertia", line=line, key=name, value=f"{shown} kg m^2",
            )  # fmt: skip
            nearest: np.ndarray = axes * np.maximum(moments, 0.0) @ axes.T
            return nearest
        elif moments[0] < -1e-9 * scale:
            self.findings.error(
                "inertia has a negative principal moment, which no body has",
                code="negative-inertia", line=line, key=name, value=f"{shown} kg m^2",
            )  # fmt: skip
        elif moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-6):
            self.findings.warn(
                "inertia breaks the triangle inequality (largest principal moment above the sum of the others): no "
                "body has it",
                code="triangle-inequality", line=line, key=name, value=f"{shown} kg m^2",
            )  # fmt: skip
        return matrix


def largest_moment(root: Any) -> float:
    """kg m^2, of all moments of inertia in the file that are numbers; 0 without any."""
    found = [0.0]
    for value in (tag.get(key, "0") for tag in root.iter("inertia") for key in ("ixx", "iyy", "izz")):
        try:
            found.append(float(value))
        except ValueError:
            continue
    return max(found)
