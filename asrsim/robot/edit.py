"""Replaces numbers in the text of a URDF. Comments and the lines between tags stay as they are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lxml import etree

from asrsim.actuators import ACTUATORS
from asrsim.errors import Problem, RobotError
from asrsim.robot.model import INERTIAS, Robot
from asrsim.robot.mounting import sprung_joints
from asrsim.robot.tags import JOINT_TAGS, parameter_tags
from asrsim.robot.vary import CENTRES, JOINT_NAMES
from asrsim.robot.xmlfile import elements, name_of, parse_xml, text_of

_ATTRIBUTES = (
    {"damping": ("dynamics", "damping"), "friction": ("dynamics", "friction")}
    | {name: ("inertia", name) for name in INERTIAS}
    | {"mass": ("mass", "value"), "armature": ("dynamics", "armature")}
)
"""Tag and attribute of each number in a joint or in the `<inertial>` of a link, by name of the number."""


def edited_urdf(data: bytes, robot: Robot, changes: Mapping[str, Mapping[str, float]]) -> bytes:
    """UTF-8 text of the file with new numbers.

    changes: joint or link -> name -> value, as for `asrsim.robot.vary.varied_robot`. For a number that the file omits, a tag is
    added. Raises RobotError if the text has no element for a number.
    """
    root = parse_xml(data, robot.path)
    lacking = [
        Problem("the robot file has no element for this number", file=robot.path, key=f"{owner}.{name}", code="no-place")
        for owner, values in changes.items()
        for name, value in values.items()
        if not _put(root, robot, owner, name, f"{value:.9g}")
    ]
    if lacking:
        raise RobotError(lacking)
    # Write the comments before and after the root element, too.
    parts = [*reversed([*root.itersiblings(preceding=True)]), root, *root.itersiblings()]
    texts = [etree.tostring(part, encoding="unicode", with_tail=False) for part in parts]
    return "\n".join(['<?xml version="1.0"?>', *texts, ""]).encode()


def _put(root: Any, robot: Robot, owner: str, name: str, value: str) -> bool:
    """Write one number into the document, and return whether the document has a place for it."""
    joint, link = _named(root, "joint", owner), _named(root, "link", owner)
    block = next((block for block in robot.actuators if block.joint == owner), None)
    if block is not None and name in block.parameters:
        plugins = [plugin for gazebo in elements(root, "gazebo") for plugin in elements(gazebo, "plugin")]
        parents = [one for one in plugins if owner in map(text_of, elements(one, "joint")) and elements(one, "operation_mode")]
        if parents:
            tag = block.parameters[name].tag or parameter_tags(ACTUATORS.get(block.actuator))[name]
            _set_text(_child(parents[0], tag), value)
        return bool(parents)
    if joint is not None and JOINT_NAMES.get(name) in JOINT_TAGS:
        tag = JOINT_TAGS[JOINT_NAMES[name]]
        gazebos = [gazebo for gazebo in elements(root, "gazebo") if name_of(gazebo, "reference") == owner]
        tags = [child for gazebo in gazebos for child in elements(gazebo, tag)]
        if not tags:
            gazebo = _added(root, "gazebo")
            gazebo.set("reference", owner)
            tags = [_added(gazebo, tag)]
        _set_text(tags[-1], value)  # if a tag is repeated, the last one counts
        return True
    if name == "armature" and joint is not None:
        # A joint's rotor inertia is the sum of its armature in the file and of the rotors of its transmissions, so write only
        # the rest as the armature. Behind a spring, the armature in the file has no effect.
        dynamics = next(iter(elements(joint, "dynamics")), None)
        own = float(dynamics.get("armature") or 0.0) if dynamics is not None else 0.0
        rest = float(value) - (robot.joint(owner).rotor_inertia - own)
        if owner in sprung_joints(robot) or rest < 0.0:
            return False
        value = f"{rest:.9g}"
    parent = joint
    if name not in JOINT_NAMES:
        parent = next(iter(elements(link, "inertial")), None) if link is not None else None
    if parent is None or name not in (*_ATTRIBUTES, *CENTRES):
        return False
    tag, attribute = _ATTRIBUTES.get(name, ("origin", "xyz"))
    child = _child(parent, tag)
    if name in CENTRES:
        numbers = child.get("xyz", "").split() or ["0", "0", "0"]
        numbers[CENTRES.index(name)] = value
        value = " ".join(numbers)
    child.set(attribute, value)
    return True


def _named(root: Any, tag: str, name: str) -> Any:
    """Joint or link with this name; None if the robot has no such joint or link."""
    return next((element for element in elements(root, tag) if name_of(element) == name), None)


def _set_text(element: Any, value: str) -> None:
    del element[:]  # remove comments, which may precede the number
    element.text = value


def _child(parent: Any, tag: str) -> Any:
    """First child with this tag, which is added if it is missing."""
    children = elements(parent, tag)
    return children[0] if children else _added(parent, tag)


def _added(parent: Any, tag: str) -> Any:
    """New last child of an element, on a separate line if the first child is on a separate line."""
    child = etree.SubElement(parent, tag)
    previous = child.getprevious()
    if previous is not None and not (parent.text or "").strip():
        child.tail, previous.tail = previous.tail, parent.text
    return child
