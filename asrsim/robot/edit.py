"""Numbers of a URDF exchanged in its text: comments, layout and everything else stay as they are, to the byte."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from asrsim.actuators import ACTUATORS
from asrsim.errors import Problem, RobotError
from asrsim.robot.model import INERTIAS, Robot
from asrsim.robot.tags import JOINT_TAGS, parameter_tags
from asrsim.robot.vary import CENTRES, JOINT_NAMES

_DYNAMICS = {"damping": "damping", "friction": "friction"}
_PASSIVE = {name: JOINT_TAGS[field] for name, field in JOINT_NAMES.items() if field in JOINT_TAGS}
"""Name of a joint -> tag of its `<gazebo reference>`."""


@dataclass
class _Element:
    """An element and where it stands in the bytes."""

    name: str
    attributes: Mapping[str, str]
    start: int
    parent: _Element | None
    children: list[_Element] = field(default_factory=list)
    inside: int = -1
    """Where its content begins; where a tag that is empty would have it: -1."""
    end: int = -1
    """Where its end tag begins."""

    def child(self, name: str) -> _Element | None:
        """The first child of that name."""
        return next((one for one in self.children if one.name == name), None)


def edited_urdf(data: bytes, robot: Robot, changes: Mapping[str, Mapping[str, float]]) -> bytes:
    """The file with joint or link -> name -> value, as :func:`asrsim.robot.vary.varied_robot` takes them, in the place of what
    it had; a number that it left to a default gets a tag. Raises RobotError where the text has no place for one.
    """
    lacking: list[Problem] = []
    for owner, values in changes.items():
        for name, value in values.items():
            # One after the other: what one of them puts in, the next finds there.
            edits = sorted(_edits(data, _parse(data), robot, owner, name, f"{value:.9g}"), reverse=True)
            for start, end, text in edits:
                data = data[:start] + text + data[end:]
            if not edits:
                lacking.append(Problem("the file has no place for it", file=robot.path, key=f"{owner}.{name}", code="no-place"))
    if lacking:
        raise RobotError(lacking)
    return data


def _parse(data: bytes) -> _Element:
    parser = expat.ParserCreate()
    top = _Element("", {}, 0, None)
    open_ones = [top]

    def start(name: str, attributes: dict[str, str]) -> None:
        one = _Element(name.rpartition(":")[2], attributes, parser.CurrentByteIndex, open_ones[-1])
        open_ones[-1].children.append(one)
        open_ones.append(one)

    def end(name: str) -> None:
        one = open_ones.pop()
        one.end = parser.CurrentByteIndex
        close = _tag_end(data, one.start)
        one.inside = -1 if data[close - 2 : close] == b"/>" else close

    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise RobotError(f"is no XML: {error}", code="xml") from None
    return top.children[0]


def _tag_end(data: bytes, start: int) -> int:
    """Just after the `>` of a start tag; a `>` may stand in an attribute."""
    quote = 0
    for i in range(start, len(data)):
        byte = data[i]
        if quote:
            quote = 0 if byte == quote else quote
        elif byte in b"\"'":
            quote = byte
        elif byte == ord(">"):
            return i + 1
    return len(data)


def _edits(data: bytes, root: _Element, robot: Robot, owner: str, name: str, value: str) -> Iterator[tuple[int, int, bytes]]:
    """(start, end, text) of what has to change."""
    joint = next((one for one in root.children if one.name == "joint" and one.attributes.get("name") == owner), None)
    link = next((one for one in root.children if one.name == "link" and one.attributes.get("name") == owner), None)
    block = next((one for one in robot.actuators if one.joint == owner), None)
    if joint is not None and name in _DYNAMICS:
        dynamics = joint.child("dynamics")
        if dynamics is None:
            yield _inserted(data, joint, f'<dynamics {name}="{value}"/>')
        else:
            yield _attribute(data, dynamics, name, value)
    elif name in _PASSIVE:
        yield from _passive(root, data, owner, name, value)
    elif block is not None and name in block.parameters:
        yield from _parameter(data, root, robot, owner, name, value)
    elif link is not None and (inertial := link.child("inertial")) is not None:
        if name == "mass" and (mass := inertial.child("mass")) is not None:
            yield _attribute(data, mass, "value", value)
        elif name in INERTIAS and (inertia := inertial.child("inertia")) is not None:
            yield _attribute(data, inertia, name, value)
        elif name in CENTRES:
            centre = next(one for one in robot.links if one.name == owner).centre_of_mass
            origin = inertial.child("origin")
            if origin is None:
                numbers = [value if axis == name else f"{part:.9g}" for axis, part in zip(CENTRES, centre, strict=True)]
                yield _inserted(data, inertial, f'<origin xyz="{" ".join(numbers)}"/>')
            else:
                yield from _part(data, origin, CENTRES.index(name), value)


def _passive(root: _Element, data: bytes, owner: str, name: str, value: str) -> Iterator[tuple[int, int, bytes]]:
    for one in root.children:
        tag = one.child(_PASSIVE[name]) if one.name == "gazebo" and one.attributes.get("reference") == owner else None
        if tag is not None and tag.inside >= 0:
            yield tag.inside, tag.end, value.encode()
            return
    text = f'<gazebo reference="{owner}"><{_PASSIVE[name]}>{value}</{_PASSIVE[name]}></gazebo>'
    yield _inserted(data, root, text)


def _parameter(
    data: bytes, root: _Element, robot: Robot, owner: str, name: str, value: str
) -> Iterator[tuple[int, int, bytes]]:
    block = next(one for one in robot.actuators if one.joint == owner)
    given = block.parameters[name]
    tag = given.tag or parameter_tags(ACTUATORS.get(block.actuator))[name]
    for gazebo in root.children:
        for plugin in gazebo.children if gazebo.name == "gazebo" else ():
            place = plugin.child("joint")
            if plugin.name != "plugin" or place is None or data[place.inside : place.end].strip().decode() != owner:
                continue
            there = plugin.child(tag)
            if there is None:
                yield _inserted(data, plugin, f"<{tag}>{value}</{tag}>")
            elif there.inside >= 0:
                yield there.inside, there.end, value.encode()


def _attribute(data: bytes, element: _Element, name: str, value: str) -> tuple[int, int, bytes]:
    """The attribute's value, or the attribute where it is missing."""
    close = _tag_end(data, element.start)
    match = re.search(rb"\s" + name.encode() + rb"\s*=\s*(?:\"([^\"]*)\"|'([^']*)')", data[element.start : close])
    if match is not None:
        group = 1 if match.group(1) is not None else 2
        return element.start + match.start(group), element.start + match.end(group), value.encode()
    place = element.start + 1 + len(element.name)
    return place, place, f' {name}="{value}"'.encode()


def _part(data: bytes, element: _Element, index: int, value: str) -> Iterator[tuple[int, int, bytes]]:
    """One number of `xyz`."""
    close = _tag_end(data, element.start)
    match = re.search(rb"\sxyz\s*=\s*[\"']([^\"']*)[\"']", data[element.start : close])
    if match is None:
        numbers = ["0", "0", "0"]
        numbers[index] = value
        yield _attribute(data, element, "xyz", " ".join(numbers))
        return
    first = element.start + match.start(1)
    parts = list(re.finditer(rb"\S+", match.group(1)))
    if len(parts) == 3:
        yield first + parts[index].start(), first + parts[index].end(), value.encode()


def _inserted(data: bytes, parent: _Element, text: str) -> tuple[int, int, bytes]:
    """A new last child, on a line of its own where the others have one."""
    if parent.inside < 0:
        close = _tag_end(data, parent.start)
        return close - 2, close, f">{text}</{parent.name}>".encode()
    last = parent.children[-1] if parent.children else None
    if last is None:
        return parent.end, parent.end, text.encode()
    line = data.rfind(b"\n", 0, last.start) + 1
    indent = data[line : last.start]
    if indent.strip():
        # Several tags share a line: take the indent of that line.
        indent = indent[: len(indent) - len(indent.lstrip())]
    end = data.rfind(b"\n", 0, parent.end)
    place = end if end > last.start else parent.end
    return place, place, b"\n" + indent + text.encode()
