"""Replaces numbers in the text of a URDF. Comments, layout and all other bytes stay the same."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from asrsim.actuators import ACTUATORS
from asrsim.errors import Problem, RobotError
from asrsim.robot.model import INERTIAS, Robot
from asrsim.robot.tags import JOINT_TAGS, parameter_tags
from asrsim.robot.vary import CENTRES, JOINT_NAMES

_START_TAG = re.compile(rb"<(?:[^>\"']|\"[^\"]*\"|'[^']*')*>")
_ATTRIBUTES = {"damping": ("dynamics", "damping"), "friction": ("dynamics", "friction")} | {
    name: ("inertia", name) for name in INERTIAS
} | {"mass": ("mass", "value")}  # fmt: skip
"""Tag and attribute of each number in a joint or in the `<inertial>` of a link, by name of the number."""


@dataclass(kw_only=True)
class _Element:
    """Element and its position in the bytes."""

    name: str
    attributes: Mapping[str, str]
    start: int
    opened: int
    """Position of the first byte after the start tag."""
    end: int = 0
    """Position of the first byte of the end tag; for an empty-element tag, position of the first byte after the tag."""
    children: list[_Element] = field(default_factory=list)

    def child(self, tag: str, /, **attributes: str) -> _Element | None:
        """First child with this tag and these attributes."""
        return next((one for one in self.children if one.name == tag and attributes.items() <= one.attributes.items()), None)


def edited_urdf(data: bytes, robot: Robot, changes: Mapping[str, Mapping[str, float]]) -> bytes:
    """Text of the file with new numbers, given as joint or link -> name -> value, as for `asrsim.robot.vary.varied_robot`.

    For a number that the file omits, a tag is added. Raises RobotError if the text has no place for a number.
    """
    lacking: list[Problem] = []
    for owner, values in changes.items():
        for name, value in values.items():
            edited = _edited(data, robot, owner, name, f"{value:.9g}")
            if edited is None:
                problem = "the file has no place for it"
                lacking.append(Problem(problem, file=robot.path, key=f"{owner}.{name}", code="no-place"))
            data = edited or data
    if lacking:
        raise RobotError(lacking)
    return data


def _parse(data: bytes) -> _Element:
    parser = expat.ParserCreate()
    path = [_Element(name="", attributes={}, start=0, opened=0)]

    def start(name: str, attributes: dict[str, str]) -> None:
        tag = _START_TAG.match(data, parser.CurrentByteIndex)
        opened = tag.end() if tag else len(data)
        one = _Element(name=name.rpartition(":")[2], attributes=attributes, start=parser.CurrentByteIndex, opened=opened)
        path[-1].children.append(one)
        path.append(one)

    def end(_name: str) -> None:
        path.pop().end = parser.CurrentByteIndex

    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise RobotError(f"is no XML: {error}", code="xml") from None
    return path[0].children[0]


def _edited(data: bytes, robot: Robot, owner: str, name: str, value: str) -> bytes | None:
    """Text with one number replaced; None if the text has no place for it."""
    root = _parse(data)
    joint, link = root.child("joint", name=owner), root.child("link", name=owner)
    inertial = link.child("inertial") if link is not None else None
    block = next((block for block in robot.actuators if block.joint == owner), None)
    if block is not None and name in block.parameters:
        tag = block.parameters[name].tag or parameter_tags(ACTUATORS.get(block.actuator))[name]
        plugin = _plugin(data, root, owner)
        return None if plugin is None else _put(data, plugin, tag, None, value)
    if joint is not None and JOINT_NAMES.get(name) in JOINT_TAGS:
        tag = JOINT_TAGS[JOINT_NAMES[name]]
        gazebos = [one for one in root.children if one.name == "gazebo" and one.attributes.get("reference") == owner]
        gazebo = next((one for one in gazebos if one.child(tag) is not None), None)
        if gazebo is None:
            return _inserted(data, root, f'<gazebo reference="{owner}"><{tag}>{value}</{tag}></gazebo>')
        return _put(data, gazebo, tag, None, value)
    parent = joint if name in JOINT_NAMES else inertial
    if parent is None:
        return None
    if name in CENTRES:
        origin = parent.child("origin")
        numbers = (origin.attributes.get("xyz", "") if origin is not None else "").split() or ["0", "0", "0"]
        numbers[CENTRES.index(name)] = value
        return _put(data, parent, "origin", "xyz", " ".join(numbers))
    return _put(data, parent, *_ATTRIBUTES[name], value) if name in _ATTRIBUTES else None


def _plugin(data: bytes, root: _Element, joint: str) -> _Element | None:
    for gazebo in root.children:
        for plugin in gazebo.children if gazebo.name == "gazebo" else ():
            named = plugin.child("joint")
            if named is not None and data[named.opened : named.end].strip().decode() == joint:
                return plugin
    return None


def _put(data: bytes, parent: _Element, tag: str, attribute: str | None, value: str) -> bytes:
    """Text with a new value of an attribute of a child, or of the child's text. Missing tags and attributes are added."""
    child = parent.child(tag)
    if child is None:
        return _inserted(data, parent, f'<{tag} {attribute}="{value}"/>' if attribute else f"<{tag}>{value}</{tag}>")
    if attribute is None:
        if data[child.opened - 2 : child.opened] == b"/>":
            return data[: child.opened - 2] + f">{value}</{tag}>".encode() + data[child.opened :]
        return data[: child.opened] + value.encode() + data[child.end :]
    place = re.compile(rb"\s" + attribute.encode() + rb"\s*=\s*[\"']([^\"']*)[\"']").search(data, child.start, child.opened)
    if place is not None:
        return data[: place.start(1)] + value.encode() + data[place.end(1) :]
    after = child.start + 1 + len(tag)
    return data[:after] + f' {attribute}="{value}"'.encode() + data[after:]


def _inserted(data: bytes, parent: _Element, text: str) -> bytes:
    """Text with a new last child, on its own line if the other children have their own lines."""
    if data[parent.opened - 2 : parent.opened] == b"/>":
        return data[: parent.opened - 2] + f">{text}</{parent.name}>".encode() + data[parent.opened :]
    place = parent.end
    if parent.children:
        last = parent.children[-1].start
        indent = data[data.rfind(b"\n", 0, last) + 1 : last]
        # Several tags may share a line: the new line takes the indent of that line.
        text = f"\n{indent[: len(indent) - len(indent.lstrip())].decode()}{text}"
        before = data.rfind(b"\n", 0, place)
        place = before if before > last else place
    return data[:place] + text.encode() + data[place:]
