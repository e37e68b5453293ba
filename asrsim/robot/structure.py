"""Reads the links and joints of a URDF, and checks that each is physically possible."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from lxml import etree

from asrsim.errors import did_you_mean
from asrsim.robot.findings import SMALLEST, Findings
from asrsim.robot.freedoms import FREEDOMS
from asrsim.robot.inertia import numbers_of, tensor_of
from asrsim.robot.model import INERTIAS, Inertia, Joint, Link, Shape, Vector, is_locked
from asrsim.robot.shapes import Rgba, read_colours, read_shape
from asrsim.robot.tags import JOINT_TAGS
from asrsim.robot.xmlfile import elements, name_of, text_of

JOINT_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating")
UNIT = 2e-4
"""Largest deviation of an axis from length 1 without a warning; it covers rounded values such as 0.707 and 0.7071."""
LONGEST_NAME = 255
"""Largest length of a name, characters; PyBullet crashes at 1024 bytes."""
EMPTY_LIMIT = "Exporters write 0 for an empty field: give the joint's limits, or make it continuous, which needs no limits"
"""Hint for limits of 0."""
_SLACK = 0.1
"""Range of limits, and difference of this range from a turn, that exporters write for a continuous joint, rad."""
ROUNDING = 1e-15
"""Moments of inertia below this value are rounding errors of the exporting program, kg m^2."""
ROUNDED, NEGLIGIBLE = 1e-3, 1e-6
"""ROUNDED, NEGLIGIBLE: largest magnitude of a negative moment of inertia that counts as a rounding error, as a fraction of the
largest moment of the link (ROUNDED) or of the robot (NEGLIGIBLE).
"""
X_AXIS: Vector = (1.0, 0.0, 0.0)
WORLD = "world"
"""Parent link that files of Drake and Gazebo need not declare."""


def declare_world(findings: Findings, root: Any) -> bool:
    """Add a link for a parent `world` that the file does not declare, as Drake and Gazebo do; returns whether it was added."""
    joints = [parent for joint in elements(root, "joint") for parent in elements(joint, "parent")]
    users = [parent for parent in joints if name_of(parent, "link") == WORLD]
    if not users or any(name_of(link) == WORLD for link in elements(root, "link")):
        return False
    message = f"the parent link '{WORLD}' is not declared: it is taken as the fixed world"
    findings.warn(message, users[0], name_of(users[0].getparent()), code="undeclared-world", hint='Add <link name="world"/>')
    etree.SubElement(root, "link", name=WORLD)
    return True


def read_links(findings: Findings, root: Any) -> tuple[Link, ...]:
    """All links with a name, in file order; of two links with the same name, only the first is returned."""
    colours, largest = read_colours(root), _largest_moment(root)
    if not elements(root, "link"):
        findings.error("has no link", None, "robot", code="no-links")
    return tuple(_link(findings, element, name, colours, largest) for element, name in _named(findings, root, "link"))


def read_joints(findings: Findings, root: Any, links: Sequence[Link], locked: Sequence[str] = ()) -> tuple[Joint, ...]:
    """All joints with a name, in file order; invalid values are replaced by their defaults. locked: joints that are fixed."""
    names = tuple(link.name for link in links)
    joints = [
        _joint(findings, element, name, names, fixed=is_locked(name, locked))
        for element, name in _named(findings, root, "joint")
    ]
    return _with_passive(findings, root, joints)


def _named(findings: Findings, root: Any, tag: str) -> list[tuple[Any, str]]:
    seen: dict[str, Any] = {}
    for element in elements(root, tag):
        name = name_of(element)
        if not name:
            findings.error(f"a {tag} has no name", element, tag, code="missing-name")
        elif len(name) > LONGEST_NAME:
            message = f"the name of a {tag} is longer than {LONGEST_NAME} characters"
            findings.error(message, element, f"{name[:20]}...", code="long-name")
        elif name in seen:
            line = findings.line(seen[name])
            first = f" (the first is on line {line})" if line else ""
            findings.error(f"two {tag}s have this name{first}", element, name, code=f"duplicate-{tag}")
        else:
            seen[name] = element
    return [(element, name) for name, element in seen.items()]


# -- links -------------------------------------------------------------------------------------------------------------


def _link(findings: Findings, element: Any, name: str, colours: Mapping[str, Rgba], largest: float) -> Link:
    link = Link(
        name=name,
        mass=None,
        inertia=None,
        line=findings.line(element),
        collisions=_shapes(findings, element, "collision", name, colours),
        visuals=_shapes(findings, element, "visual", name, colours),
    )
    inertials = elements(element, "inertial")
    if len(inertials) > 1:
        message = "has more than one <inertial>; only the first is read, as in other readers"
        findings.warn(message, inertials[1], name, code="duplicate-tag")
    if not inertials:
        return link
    centre, rpy = findings.origin(inertials[0], name)
    mass = _mass(findings, inertials[0], name)
    inertia = _inertia(findings, inertials[0], name, mass, largest)
    return replace(link, mass=mass, inertia=inertia, centre_of_mass=centre, inertial_rpy=rpy)


def _shapes(findings: Findings, element: Any, tag: str, name: str, colours: Mapping[str, Rgba]) -> tuple[Shape, ...]:
    """Collisions or visuals of a link. A collision with invalid numbers is an error, since contacts would be lost. A collision
    without volume (no shape, or a size of 0) and an invalid visual are left out.
    """
    shapes = []
    for shape in elements(element, tag):
        own = Findings(findings.file, expanded=findings.expanded)
        found = read_shape(own, shape, f"{name}.{tag}", colours)
        empty = all(one.code == "empty-shape" for one in own.errors)
        if found is not None and not own.errors:
            shapes.append(found)
        elif tag == "visual":
            own.warnings += [replace(one, message=f"{one.message}; it is not drawn", code="visual-shape") for one in own.errors]
        elif empty:
            own.warnings += [replace(one, message=f"{one.message}; the link does not collide with it") for one in own.errors]
        else:
            findings.errors += own.errors
        findings.warnings += own.warnings
    return tuple(shapes)


def _only_tag(findings: Findings, inertial: Any, tag: str, name: str) -> Any:
    tags = elements(inertial, tag)
    if not tags:
        findings.error(f"<inertial> has no <{tag}>", inertial, name, code="missing-tag")
        return None
    return tags[0]


def _mass(findings: Findings, inertial: Any, name: str) -> float:
    tag = _only_tag(findings, inertial, "mass", name)
    if tag is None:
        return 0.0
    before = len(findings.errors)
    mass = findings.number(tag, "value", f"{name}.mass", required=True)
    if mass < 0.0:
        findings.error("mass must not be negative", tag, name, code="negative-mass", value=f"{mass:g}")
    elif 0.0 < mass < SMALLEST:
        _too_small(findings, tag, f"{name}.mass", mass)
    elif mass == 0.0 and len(findings.errors) == before:
        findings.warn("mass is zero", tag, name, code="massless-link")
    return mass


def _inertia(findings: Findings, inertial: Any, name: str, mass: float, largest: float) -> Inertia:
    """Six numbers of a link's inertia tensor, kg m^2. largest: largest moment of inertia in the file."""
    tag = _only_tag(findings, inertial, "inertia", name)
    if tag is None:
        return (0.0,) * 6
    before = len(findings.errors)
    # A missing product of inertia is 0, as in every URDF reader. A missing moment of inertia is a mistake.
    values = [findings.number(tag, key, f"{name}.{key}", required=key[1] == key[2]) for key in INERTIAS]
    for moment in (values[0], values[3], values[5]):
        if 0.0 < abs(moment) < SMALLEST:
            _too_small(findings, tag, f"{name}.inertia", moment)
    if max(map(abs, values)) < ROUNDING:
        values = [0.0] * 6
    tensor = tensor_of(values)
    if len(findings.errors) == before:
        tensor = _physical(findings, tag, name, mass, tensor, largest)
    return numbers_of(tensor)


def _too_small(findings: Findings, tag: Any, place: str, value: float) -> None:
    message = f"is closer to 0 than {SMALLEST:g}, too small for a body"
    findings.error(message, tag, place, code="out-of-range", value=f"{value:g}")


def _physical(findings: Findings, tag: Any, name: str, mass: float, matrix: np.ndarray, largest: float) -> np.ndarray:
    """Inertia tensor, kg m^2. A tensor with a negative principal moment is replaced by the nearest physical tensor."""
    moments, axes = np.linalg.eigh(matrix)
    scale = float(np.abs(matrix).max())
    shown = f"{_listed(moments)} kg m^2"
    if scale == 0.0:
        if mass > 0.0:
            findings.warn("inertia is zero: the link is a point mass", tag, name, code="zero-inertia")
    elif np.diag(matrix).min() < -max(ROUNDED * scale, NEGLIGIBLE * largest):
        message = "inertia has a negative moment, which is impossible"
        findings.error(message, tag, name, code="negative-inertia", value=shown)
    elif moments[0] < -1e-9 * scale:
        # `spreads` are the integrals of x^2, y^2 and z^2 over the mass, along the principal axes. They are not negative for a
        # real body.
        spreads = np.maximum(0.5 * moments.sum() - moments, 0.0)
        nearest: np.ndarray = axes * (spreads.sum() - spreads) @ axes.T
        message = (
            "inertia has a negative principal moment, which is impossible: the nearest possible inertia, "
            f"with {_listed(spreads.sum() - spreads)} kg m^2, is used"
        )
        findings.warn(message, tag, name, code="impossible-inertia", value=shown)
        return nearest
    elif moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-6):
        message = "inertia breaks the triangle inequality: its largest principal moment is above the sum of the other two"
        findings.warn(message, tag, name, code="triangle-inequality", value=shown)
    return matrix


def _listed(moments: np.ndarray) -> str:
    return ", ".join(f"{moment:.4g}" for moment in moments)


def _largest_moment(root: Any) -> float:
    """Largest moment of inertia in the file, kg m^2; 0 if the file states no moment."""
    found = [0.0]
    for value in (tag.get(key, "0") for tag in root.iter("inertia") for key in ("ixx", "iyy", "izz")):
        try:
            found.append(float(value))
        except ValueError:
            continue
    return max(found)


# -- joints ------------------------------------------------------------------------------------------------------------


def _joint(findings: Findings, element: Any, name: str, links: tuple[str, ...], *, fixed: bool) -> Joint:
    kind = "fixed" if fixed else name_of(element, "type")
    if kind not in JOINT_KINDS:
        message = "joint type is unknown" if kind else "joint has no type"
        findings.error(
            message, element, name, code="joint-type", value=kind or None, choices=(*JOINT_KINDS, *FREEDOMS), meant=kind
        )
        kind = "continuous"
    parent, child = (_end(findings, element, tag, name, links) for tag in ("parent", "child"))
    origin, rpy = findings.origin(element, name)
    joint = Joint(name=name, kind=kind, parent=parent, child=child, origin=origin, rpy=rpy, line=findings.line(element))
    if fixed:
        return joint
    changes: dict[str, Any] = {}
    if joint.moves:
        changes["axis"] = _axis(findings, element, name)
    for tag, read in TAGS.items():
        tags = elements(element, tag)
        changes |= read(findings, tags[0], name, joint) if tags else {}
    if kind in ("revolute", "prismatic") and not elements(element, "limit"):
        message = "has no <limit>, which the URDF format requires: the joint is taken as unlimited"
        findings.warn(message, element, name, code="missing-limit")
    return replace(joint, **changes)


def _end(findings: Findings, element: Any, tag: str, name: str, links: tuple[str, ...]) -> str:
    """Name of the link; empty if the robot has no link with this name."""
    tags = elements(element, tag)
    if len(tags) != 1:
        count = "no" if not tags else "more than one"
        findings.error(f"joint has {count} <{tag}>", element, name, code="missing-tag")
        return ""
    link = name_of(tags[0], "link")
    if link in links:
        return link
    hint = did_you_mean(link, links)
    findings.error(f"the {tag} link does not exist", tags[0], name, code="unknown-link", value=link, hint=hint)
    return ""


def _axis(findings: Findings, element: Any, name: str) -> Vector:
    tags = elements(element, "axis")
    if not tags:
        return X_AXIS
    if tags[0].get("xyz") is None:
        findings.error("attribute 'xyz' is missing", tags[0], f"{name}.axis", code="missing-attribute")
        return X_AXIS
    x, y, z = findings.vector(tags[0], "xyz", f"{name}.axis", default=X_AXIS)
    length = math.hypot(x, y, z)
    if length == 0.0:
        findings.error("the axis of a moving joint is zero", tags[0], name, code="zero-axis")
        return X_AXIS
    if abs(length - 1.0) > UNIT:
        message = "the axis is not of length 1; its direction is used"
        findings.warn(message, tags[0], name, code="axis-length", value=f"{length:.9g}")
    # Do not normalise an axis whose length is 1 except for rounding, so that a written robot is read back bit for bit.
    return (x, y, z) if abs(length - 1.0) < 1e-15 else (x / length, y / length, z / length)


def _limits(findings: Findings, tag: Any, name: str, joint: Joint) -> dict[str, float | None]:
    limits = {
        key: None if tag.get(key) is None else findings.number(tag, key, f"{name}.limit.{key}", required=True, finite=False)
        for key in ("lower", "upper", "effort", "velocity")
    }
    for key in ("effort", "velocity"):
        if (limits[key] or 0.0) < 0.0:
            message = f"a negative limit of {key} means no limit, as in SDF"
            findings.warn(message, tag, name, code="negative-limit", value=f"{limits[key]:g}")
            limits[key] = None
    lower, upper = limits.pop("lower"), limits.pop("upper")
    if joint.kind == "continuous" and _SLACK < (upper or 0.0) - (lower or 0.0) < math.tau - _SLACK:
        message = "a continuous joint turns without limits: its lower and upper limit have no effect, as in ROS"
        hint = "If the joint has stops, write type='revolute'"
        value = f"{lower or 0.0:g} to {upper or 0.0:g}"
        findings.warn(message, tag, name, code="continuous-limits", value=value, hint=hint)
    if joint.kind not in ("revolute", "prismatic"):
        return limits
    if lower is None and upper is None:
        message = (
            "its <limit> states neither lower nor upper: the joint is taken as unlimited. ROS and Gazebo take both as 0 and "
            "hold the joint"
        )
        hint = "Give the joint's limits; a revolute joint without limits is of type='continuous'"
        findings.warn(message, tag, name, code="missing-limit", hint=hint)
        return limits
    # A missing lower or upper limit is 0 in the URDF format.
    lower, upper = lower or 0.0, upper or 0.0
    if lower > upper:
        value = f"{lower:g} > {upper:g}"
        message = "lower limit is above the upper limit: the joint has no limits, as in PyBullet"
        hint = "Exchange the limits; if the joint has no limits, write type='continuous'"
        findings.warn(message, tag, name, code="limits-crossed", value=value, hint=hint)
        return limits
    if lower == upper:
        empty = EMPTY_LIMIT if lower == 0.0 else None
        findings.warn("lower and upper limit are equal: the joint cannot move", tag, name, code="locked-joint", hint=empty)
    return limits | {"lower": lower if math.isfinite(lower) else None, "upper": upper if math.isfinite(upper) else None}


def _dynamics(findings: Findings, tag: Any, name: str, _joint: Joint) -> dict[str, float]:
    values = {key: findings.number(tag, key, f"{name}.{key}", required=False) for key in ("damping", "friction")}
    for key, value in values.items():
        if value < 0.0:
            findings.error(f"{key} must not be negative", tag, name, code=f"negative-{key}", value=f"{value:g}")
    return values


def _mimic(findings: Findings, tag: Any, name: str, _joint: Joint) -> dict[str, Any]:
    multiplier = findings.number(tag, "multiplier", f"{name}.mimic", required=False) if "multiplier" in tag.attrib else 1.0
    offset = findings.number(tag, "offset", f"{name}.mimic", required=False)
    return {"mimic": name_of(tag, "joint"), "multiplier": multiplier, "offset": offset}


TAGS: dict[str, Callable[[Findings, Any, str, Joint], Mapping[str, Any]]] = {
    "limit": _limits,
    "dynamics": _dynamics,
    "mimic": _mimic,
}
"""Functions that read the fields of a joint, by tag."""

_PASSIVE = {tag: field for field, tag in JOINT_TAGS.items()}
_SIGNED = ("spring_stiffness", "spring_reference")


def _with_passive(findings: Findings, root: Any, joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """Joints with the passive springs and friction of `<gazebo reference>`. Of two equal tags, the last one is used, as in
    Gazebo."""
    found = {joint.name: joint for joint in joints}
    for gazebo in elements(root, "gazebo"):
        name = name_of(gazebo, "reference")
        for tag in elements(gazebo):
            field = _PASSIVE.get(tag.tag)
            key = f"{name}.{tag.tag}"
            if field is None:
                continue
            if name not in found or not found[name].moves:
                why = f"a {found[name].kind} joint does not move" if name in found else "the robot has no such joint"
                hint = None if name in found else did_you_mean(name, tuple(found))
                findings.warn(f"has no effect: {why}", tag, key, code="misplaced-tag", hint=hint)
                continue
            text = text_of(tag)
            if not text and tag.get("value") is not None:
                text = str(tag.get("value"))
                findings.warn(
                    "states its number as an attribute 'value'; Gazebo also reads this form", tag, key, code="value-attribute"
                )
            value = findings.value(text, text, tag, key)
            if field not in _SIGNED and (value < 0.0 or (value == 0.0 and field == "stribeck_velocity")):
                bound = "larger than" if field == "stribeck_velocity" else "at least"
                findings.error(f"must be {bound} 0", tag, key, code="out-of-range", value=f"{value:g}")
                continue
            changed: dict[str, Any] = {field: value}
            found[name] = replace(found[name], **changed)
    return tuple(found[joint.name] for joint in joints)
