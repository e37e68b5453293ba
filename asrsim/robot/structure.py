"""Links and joints of a URDF: read, each checked to be a body or joint that physics allows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from asrsim.errors import did_you_mean
from asrsim.robot.findings import EMPTY_LIMIT
from asrsim.robot.inertials import InertialReader, largest_moment
from asrsim.robot.model import Joint, Link, Mimic, Shape, Vector
from asrsim.robot.shapes import Colour, ShapeError, read_colours, read_shape
from asrsim.robot.xmlfile import elements, name_of

JOINT_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
UNIT = 2e-4
"""How far an axis may be from length 1 without a word: 0.707 and 0.7071, as people write them, pass."""
LONGEST_NAME = 255
"""Characters; PyBullet crashes at 1024 bytes."""


class StructureReader(InertialReader):
    """Reads `<link>` and `<joint>`; problems go to `findings`."""

    def links(self, root: Any) -> tuple[Link, ...]:
        """All links with a name, in file order; the first of two equal names."""
        colours = read_colours(root)
        self.largest = largest_moment(root)
        found = [self._link(element, name, colours) for element, name in self._named(root, "link")]
        if not elements(root, "link"):
            self.findings.error("has no link", code="no-links", key="robot")
        return tuple(found)

    def joints(self, root: Any, links: Sequence[Link]) -> tuple[Joint, ...]:
        """All joints with a name, in file order; what has a fault has a default in its place."""
        names = tuple(link.name for link in links)
        return tuple(self._joint(element, name, names) for element, name in self._named(root, "joint"))

    # -- parts -----------------------------------------------------------------------------------------------------

    def _named(self, root: Any, tag: str) -> list[tuple[Any, str]]:
        seen: dict[str, int | None] = {}
        found = []
        for element in elements(root, tag):
            name = name_of(element)
            if not name:
                self.error(f"a {tag} has no name", element, tag, code="missing-name")
            elif len(name) > LONGEST_NAME:
                self.error(
                    f"the name of a {tag} is longer than {LONGEST_NAME} characters", element, f"{name[:20]}...",
                    code="long-name",
                )  # fmt: skip
            elif name in seen:
                first = f" (the first is on line {seen[name]})" if seen[name] else ""
                self.error(f"two {tag}s have this name{first}", element, name, code=f"duplicate-{tag}")
            else:
                seen[name] = self.line(element)
                found.append((element, name))
        return found

    def _link(self, element: Any, name: str, colours: Mapping[str, Colour]) -> Link:
        link = Link(
            name=name, mass=None, inertia=None, line=self.line(element),
            collisions=self._shapes(element, "collision", name, colours),
            visuals=self._shapes(element, "visual", name, colours),
        )  # fmt: skip
        inertials = elements(element, "inertial")
        if len(inertials) > 1:
            self.error("has more than one <inertial>", inertials[1], name, code="duplicate-tag")
        if not inertials:
            return link
        inertial = inertials[0]
        centre, rpy = self.origin(inertial, name)
        mass = self.mass(inertial, name)
        inertia = self.inertia(inertial, name, mass)
        return replace(link, mass=mass, inertia=inertia, centre_of_mass=centre, inertial_rpy=rpy)

    def _shapes(self, element: Any, tag: str, name: str, colours: Mapping[str, Colour]) -> tuple[Shape, ...]:
        """A collision that cannot be made is an error, since contacts would go missing; a visual is left out."""
        shapes = []
        for shape in elements(element, tag):
            line = self.line(shape)
            try:
                shapes.append(read_shape(shape, colours, line))
            except ShapeError as fault:
                if tag == "collision":
                    self.findings.error(f"a collision {fault}", code="collision-shape", line=line, key=name)
                else:
                    self.findings.warn(f"a visual {fault}; it is not drawn", code="visual-shape", line=line, key=name)
        return tuple(shapes)

    def _joint(self, element: Any, name: str, links: tuple[str, ...]) -> Joint:
        line = self.line(element)
        kind = name_of(element, "type")
        if kind not in JOINT_KINDS:
            self.findings.error(
                "joint type is unknown" if kind else "joint has no type",
                code="joint-type", line=line, key=name, value=kind or None, choices=JOINT_KINDS,
                meant=kind,
            )  # fmt: skip
            kind = "continuous"
        parent = self._end(element, "parent", name, links)
        child = self._end(element, "child", name, links)
        origin, rpy = self.origin(element, name)
        moves = kind in ("revolute", "continuous", "prismatic")
        axis = self._axis(element, name) if moves else (1.0, 0.0, 0.0)
        limits = self._limits(element, name, kind)
        damping, friction = self._dynamics(element, name)
        mimic = self._mimic(element, name)
        lower, upper, effort, velocity = limits
        return Joint(
            name=name, kind=kind, parent=parent, child=child, axis=axis, origin=origin, rpy=rpy, lower=lower, upper=upper,
            effort=effort, velocity=velocity, damping=damping, friction=friction, mimic=mimic, line=line,
        )  # fmt: skip

    def _end(self, element: Any, tag: str, name: str, links: tuple[str, ...]) -> str:
        """The link's name; empty: there is no such link."""
        tags = elements(element, tag)
        if len(tags) != 1:
            count = "no" if not tags else "more than one"
            self.error(f"joint has {count} <{tag}>", element, name, code="missing-tag")
            return ""
        link = name_of(tags[0], "link")
        if link not in links:
            self.error(
                f"the {tag} link does not exist", tags[0], name, code="unknown-link", value=link,
                hint=did_you_mean(link, links),
            )  # fmt: skip
            return ""
        return link

    def _axis(self, element: Any, name: str) -> Vector:
        tags = elements(element, "axis")
        if not tags:
            return (1.0, 0.0, 0.0)
        if tags[0].get("xyz") is None:
            self.error("attribute 'xyz' is missing", tags[0], f"{name}.axis", code="missing-attribute")
            return (1.0, 0.0, 0.0)
        x, y, z = self.vector(tags[0], "xyz", f"{name}.axis", default=(1.0, 0.0, 0.0))
        length = math.hypot(x, y, z)
        if length == 0.0:
            self.error("the axis of a moving joint is zero", tags[0], name, code="zero-axis")
            return (1.0, 0.0, 0.0)
        if abs(length - 1.0) > UNIT:
            self.warn(
                "the axis is not of length 1; its direction is used", tags[0], name, code="axis-length", value=f"{length:.9g}"
            )
        # A length that is 1 to rounding stays as it is, so that a written robot reads back to the bit.
        return (x, y, z) if abs(length - 1.0) < 1e-15 else (x / length, y / length, z / length)

    def _limits(self, element: Any, name: str, kind: str) -> tuple[float | None, float | None, float | None, float | None]:
        tags = elements(element, "limit")
        if not tags:
            if kind in ("revolute", "prismatic"):
                self.warn(
                    "has no <limit>, which the URDF format asks for; taken as unlimited", element, name, code="missing-limit"
                )
            return None, None, None, None
        tag, line = tags[0], self.line(tags[0])

        def optional(key: str) -> float | None:
            if tag.get(key) is None:
                return None
            return self.number(tag, key, f"{name}.limit.{key}", required=True, finite=False)

        lower, upper, effort, velocity = (optional(key) for key in ("lower", "upper", "effort", "velocity"))
        for key, value in (("effort", effort), ("velocity", velocity)):
            if value is not None and value < 0.0:
                self.findings.error(
                    f"limit {key} must not be negative", code="negative-limit", line=line, key=name, value=f"{value:g}"
                )
        if kind not in ("revolute", "prismatic"):
            return None, None, effort, velocity
        if (lower is None) != (upper is None):
            # The format's default for a missing one is 0.
            lower, upper = lower or 0.0, upper or 0.0
        if lower is not None and upper is not None and lower > upper:
            self.findings.error(
                "lower limit is above the upper limit", code="limits-crossed", line=line, key=name,
                value=f"{lower:g} > {upper:g}",
            )  # fmt: skip
            return None, None, effort, velocity
        if lower is not None and lower == upper:
            self.findings.warn(
                "lower and upper limit are equal: the joint cannot move", code="locked-joint", line=line, key=name,
                hint=EMPTY_LIMIT if lower == 0.0 else None,
            )  # fmt: skip
        lower = None if lower is not None and math.isinf(lower) else lower
        upper = None if upper is not None and math.isinf(upper) else upper
        return lower, upper, effort, velocity

    def _mimic(self, element: Any, name: str) -> Mimic | None:
        tags = elements(element, "mimic")
        if not tags:
            return None
        place = f"{name}.mimic"
        multiplier, offset = (
            self.number(tags[0], key, place, required=True) if tags[0].get(key) is not None else default
            for key, default in (("multiplier", 1.0), ("offset", 0.0))
        )
        return Mimic(joint=name_of(tags[0], "joint"), multiplier=multiplier, offset=offset)

    def _dynamics(self, element: Any, name: str) -> tuple[float, float]:
        tags = elements(element, "dynamics")
        if not tags:
            return 0.0, 0.0
        values = []
        for key in ("damping", "friction"):
            value = self.number(tags[0], key, f"{name}.{key}", required=False)
            if value < 0.0:
                self.error(f"{key} must not be negative", tags[0], name, code=f"negative-{key}", value=f"{value:g}")
            values.append(value)
        return values[0], values[1]
