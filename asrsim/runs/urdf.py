"""Writes the URDF of a robot that was changed after it was read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from asrsim.robot import Robot, load_robot
from asrsim.robot.model import INERTIAS, Joint, Link
from asrsim.robot.xmlfile import elements, parse_xml

_JOINT = {
    "origin": ("origin", "xyz"), "rpy": ("origin", "rpy"), "axis": ("axis", "xyz"), "lower": ("limit", "lower"),
    "upper": ("limit", "upper"), "effort": ("limit", "effort"), "velocity": ("limit", "velocity"),
    "damping": ("dynamics", "damping"), "friction": ("dynamics", "friction"),
}  # fmt: skip
"""Field of a joint -> (element, attribute) in URDF."""
_LINK = {
    "mass": ("mass", "value"), "centre_of_mass": ("origin", "xyz"), "inertial_rpy": ("origin", "rpy"),
}  # fmt: skip
"""Field of a link -> (element in `<inertial>`, attribute) in URDF."""

Blocks = Mapping[str, tuple[int, Mapping[str, float]]]


def urdf_as_run(robot: Robot) -> tuple[str, Blocks, list[str]]:
    """URDF of the robot, changed actuators, and changes that URDF cannot express.

    Returns:
        The URDF text; joint -> (mode, parameters) for each actuator that differs from the text; and the names of the links
        and joints with changes that the text cannot express.
    """
    read = _read(robot.text)
    joints = _changed(robot.joints, read.joints)
    links = _changed(robot.links, read.links)
    blocks = {
        block.joint: (block.mode, block.values())
        for block, before in zip(robot.actuators, read.actuators, strict=False)
        if (block.mode, block.values()) != (before.mode, before.values())
    }
    if not joints and not links:
        return robot.text, blocks, []
    from lxml import etree

    root = parse_xml(robot.text.encode(), robot.path)
    for tag, changed in (("joint", joints), ("link", links)):
        for element in elements(root, tag):
            one = changed.get(element.get("name") or "")
            if isinstance(one, Joint):
                _write(element, one, _JOINT)
            elif isinstance(one, Link):
                inertial = _child(element, "inertial")
                _write(inertial, one, _LINK)
                for key, value in zip(INERTIAS, one.inertia or (), strict=False):
                    _child(inertial, "inertia").set(key, repr(float(value)))
    text: str = etree.tostring(root, encoding="unicode")
    again = _read(text)
    left = {**_changed(robot.joints, again.joints), **_changed(robot.links, again.links)}
    return text, blocks, [f"the robot's {name}" for name in left]


def _read(text: str) -> Robot:
    with TemporaryDirectory(prefix="asrsim-") as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(text, encoding="utf-8")
        return load_robot(path)


def _changed(now: Any, before: Any) -> dict[str, Any]:
    known = {one.name: one for one in before}
    return {one.name: one for one in now if one.name not in known or _said(one) != _said(known[one.name])}


def _said(one: Joint | Link) -> list[Any]:
    """Values of a joint or link for comparison, without its line numbers."""
    shapes = {"collisions", "visuals"}
    items = [getattr(one, field.name) for field in fields(one) if field.name != "line" and field.name not in shapes]
    return [*items, *(replace(shape, line=None) for name in shapes for shape in getattr(one, name, ()))]


def _write(element: Any, one: Joint | Link, places: Mapping[str, tuple[str, str]]) -> None:
    for field in fields(one):
        value = getattr(one, field.name)
        if field.name in places and value is not None:
            tag, attribute = places[field.name]
            text = " ".join(repr(float(part)) for part in (value if isinstance(value, tuple) else (value,)))
            _child(element, tag).set(attribute, text)


def _child(element: Any, tag: str) -> Any:
    found = next(iter(elements(element, tag)), None)
    if found is None:
        from lxml import etree

        found = etree.SubElement(element, tag)
    return found
