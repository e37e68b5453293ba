"""Elements and attributes of the URDF format. Unknown and repeated elements or attributes get a warning."""

from __future__ import annotations

from typing import Any

from asrsim.errors import nearest
from asrsim.robot.findings import Findings
from asrsim.robot.model import INERTIAS
from asrsim.robot.xmlfile import elements, name_of

Words = dict[str, tuple[tuple[str, ...], tuple[str, ...]]]

_SHAPES = ("box", "sphere", "cylinder", "capsule", "mesh")

VOCABULARY: Words = {
    "robot": (("name", "version"), ("link", "joint", "material", "gazebo", "transmission", "sensor")),
    "link": (("name", "type"), ("inertial", "visual", "collision", "sensor")),
    "inertial": ((), ("origin", "mass", "inertia")),
    "mass": (("value",), ()),
    "inertia": (INERTIAS, ()),
    "visual": (("name",), ("origin", "geometry", "material")),
    "collision": (("name",), ("origin", "geometry")),
    "geometry": ((), _SHAPES),
    "box": (("size",), ()),
    "sphere": (("radius",), ()),
    "cylinder": (("radius", "length"), ()),
    "capsule": (("radius", "length"), ()),
    "mesh": (("filename", "scale"), ()),
    "material": (("name",), ("color", "texture")),
    "color": (("rgba",), ()),
    "texture": (("filename",), ()),
    "joint": (
        ("name", "type"),
        ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "calibration", "safety_controller"),
    ),
    "origin": (("xyz", "rpy"), ()),
    "parent": (("link",), ()),
    "child": (("link",), ()),
    "axis": (("xyz",), ()),
    "limit": (("lower", "upper", "effort", "velocity"), ()),
    "dynamics": (("damping", "friction"), ()),
    "mimic": (("joint", "multiplier", "offset"), ()),
    "calibration": (("rising", "falling", "reference_position"), ()),
    "safety_controller": (("soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"), ()),
}
"""Attributes and child elements of each element in the URDF format."""
SEVERAL = {"link", "joint", "material", "visual", "collision", "inertial", "gazebo", "transmission", "sensor"}
"""Elements that may be repeated, or whose repetition is reported elsewhere."""
OPAQUE = ("gazebo", "transmission", "sensor")
"""Elements whose content other programs define."""
FOREIGN = {
    "robot": ("ros2_control", "mujoco", "loop_joint", "self_collision_checking", "group", "gripper", "verbose"),
    "link": ("contact", "inertia_scaling", "self_collision_checking", "collision_checking", "verbose", "gravity"),
    "collision": ("verbose", "contact_coefficients", "material", "max_contacts"),
    "joint": ("hardwareInterface", "motor", "limits_soft"),
    "limit": ("acceleration", "jerk", "deceleration", "has_velocity_limits"),
    "dynamics": ("armature", "spring_stiffness", "spring_reference"),
}
"""Children and attributes of each element that other programs add, without effect in asrsim and without a warning."""


def check_words(findings: Findings, root: Any) -> None:
    """Warn about unknown attributes and elements of the URDF format. Names in other name spaces are ignored."""
    _check(findings, root, "robot", "")


def _check(findings: Findings, element: Any, kind: str, place: str) -> None:
    attributes, children = VOCABULARY[kind]
    foreign = FOREIGN.get(kind, ())
    for name in map(str, element.attrib):
        if name not in attributes and name not in foreign and not _namespaced(name):
            _warn(findings, element, "attribute", name, attributes, f"{place}.{name}" if place else name, "'{}'")
    seen = set()
    for child in elements(element):
        name = child.tag
        inner = name_of(child) or name if kind == "robot" else f"{place}.{name}"
        if name in seen:
            message = f"a second <{name}> of one <{kind}>; only the first has an effect"
            findings.warn(message, child, place, code="repeated-element")
        if name in children:
            seen |= {name} - SEVERAL
            if name not in OPAQUE:
                _check(findings, child, name, inner)
        elif name not in foreign and not _namespaced(name) and kind != "geometry":
            _warn(findings, child, "element", name, children, f"{place}.{name}" if place else name, "<{}>")


def _warn(findings: Findings, element: Any, what: str, name: str, known: tuple[str, ...], place: str, form: str) -> None:
    close = nearest(name.lower(), known)
    findings.warn(
        f"unknown {what} {form.format(name)}; it has no effect", element, place, code=f"unknown-{what}",
        hint=f"Did you mean {form.format(close)}?" if close else None, choices=() if close else known,
    )  # fmt: skip


def _namespaced(name: str) -> bool:
    return name.startswith("{") or ":" in name
