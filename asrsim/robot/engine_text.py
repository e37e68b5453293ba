"""URDF text for a physics engine: the robot's own text without simulator blocks and with meshes that exist."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lxml import etree

from asrsim.errors import Problem, RobotError
from asrsim.robot.meshes import MESH_FORMATS, mesh_fault
from asrsim.robot.model import Robot
from asrsim.robot.packages import Packages, packages_of
from asrsim.robot.shapes import shape_fault
from asrsim.robot.xmlfile import elements, parse_xml

LONGEST_LINE = 1000
"""Bytes."""
STRIPPED = ("gazebo", "transmission", "sensor")


def engine_urdf(
    robot: Robot, *, visuals: bool = False, package_paths: Mapping[str, Path | str] | None = None
) -> tuple[str, tuple[Problem, ...]]:
    """The robot as a physics engine may load it, and warnings.

    Gazebo, transmission and sensor blocks are taken out, mesh names become absolute paths of existing files inside the
    robot's folder, its package or a known package; a collision or visual whose mesh is not there is taken out (a warning
    names the link of each collision; all visuals share one). `visuals=False` takes all visuals out. Links without
    `<inertial>`, other than the root, get a massless one, since an engine makes up a mass where none is given
    (PyBullet: 1 kg). Joints lose `<dynamics>`: damping and friction are applied from the robot's data, and an engine that
    applied the damping too would do so twice. Comments and text are left out, and each element has a line of its own.
    Raises RobotError for an element too long for an engine.
    """
    root = parse_xml(robot.text.encode(), robot.path)
    packages = packages_of(robot.path, package_paths)
    expanded = robot.path.suffix == ".xacro"
    warnings: list[Problem] = []
    missing_visuals: list[tuple[str, str]] = []
    for child in elements(root):
        if child.tag in STRIPPED:
            _remove(child)
    for joint in elements(root, "joint"):
        for dynamics in elements(joint, "dynamics"):
            _remove(dynamics)
    for link in elements(root, "link"):
        name = link.get("name") or ""
        for collision in elements(link, "collision"):
            reason = _resolve(collision, packages)
            if reason is not None:
                line = None if expanded else collision.sourceline
                warnings.append(
                    Problem(
                        message=f"collision mesh {reason[1]}; the link does not collide with it",
                        file=robot.path,
                        line=line,
                        key=name,
                        value=reason[0],
                        code="missing-collision-mesh",
                    )
                )
                _remove(collision)
        for visual in elements(link, "visual"):
            if not visuals or shape_fault(visual) is not None:
                _remove(visual)
            elif (reason := _resolve(visual, packages)) is not None:
                missing_visuals.append(reason)
                _remove(visual)
    _drop_other_files(root)
    _name(root, robot)
    _fill_inertials(root, {joint.child for joint in robot.joints})
    if missing_visuals:
        first_name, first_reason = missing_visuals[0]
        warnings.append(
            Problem(
                message=f"{len(missing_visuals)} visual meshes are not drawn; the first {first_reason}",
                file=robot.path,
                value=first_name,
                code="missing-visual-mesh",
            )
        )
    return _in_short_lines(root, robot), tuple(warnings)


def _in_short_lines(root: Any, robot: Robot) -> str:
    """The document without comments and free text, an element a line: PyBullet reads lines in pieces of 8 kB, and a seam
    inside a tag breaks the document.
    """
    for element in list(root.iter()):
        element.tail = None
        if isinstance(element.tag, str):
            element.text = None
        elif element is not root:
            element.getparent().remove(element)
    etree.indent(root, "")
    text: str = etree.tostring(root, encoding="unicode")
    for line in text.splitlines():
        if len(line.encode()) > LONGEST_LINE:
            message = f"an element is longer than {LONGEST_LINE} bytes, which PyBullet cannot read"
            raise RobotError(Problem(message=message, file=robot.path, value=line, code="long-element"))
    return text


def _resolve(shape: Any, packages: Packages) -> tuple[str, str] | None:
    """Make the file names inside a collision or visual absolute; (name, reason) of the first that cannot be used."""
    for element in shape.iter():
        if not isinstance(element.tag, str) or element.get("filename") is None:
            continue
        if element.tag == "texture":
            continue
        filename = element.get("filename").strip()
        if element.tag != "mesh":
            return filename, f"is given by <{element.tag}>, which is not supported"
        if Path(filename).suffix.lower() not in MESH_FORMATS:
            return filename, f"is none of {', '.join(MESH_FORMATS)}"
        found = packages.resolve(filename)
        if isinstance(found, str):
            return filename, found
        if (fault := mesh_fault(found)) is not None:
            return filename, fault
        element.set("filename", str(found))
    return None


def _name(root: Any, robot: Robot) -> None:
    """Names as the robot has them: with no blanks around them, and one for the robot."""
    root.set("name", robot.name)
    for element in (*elements(root, "link"), *elements(root, "joint")):
        element.set("name", (element.get("name") or "").strip())
        for end in (*elements(element, "parent"), *elements(element, "child")):
            end.set("link", (end.get("link") or "").strip())


def _fill_inertials(root: Any, children: set[str]) -> None:
    """Give links without `<inertial>` a massless one; measured: mass matrices then are exact."""
    for link in elements(root, "link"):
        if (link.get("name") or "").strip() in children and not elements(link, "inertial"):
            inertial = etree.SubElement(link, "inertial")
            etree.SubElement(inertial, "mass", value="0")
            etree.SubElement(inertial, "inertia", ixx="0", ixy="0", ixz="0", iyy="0", iyz="0", izz="0")


def _drop_other_files(root: Any) -> None:
    """Take out what else names a file (textures, engine extensions): no physics, and no reading of strangers' paths."""
    for element in list(root.iter()):
        if isinstance(element.tag, str) and element.tag != "mesh" and element.get("filename") is not None:
            _remove(element)
    for element in elements(root):
        if element.tag not in ("link", "joint", "material"):
            _remove(element)


def _remove(element: Any) -> None:
    """Take an element out of its parent, but keep the text behind it."""
    parent = element.getparent()
    if parent is None:
        return
    if element.tail:
        before = element.getprevious()
        if before is not None:
            before.tail = (before.tail or "") + element.tail
        else:
            parent.text = (parent.text or "") + element.tail
    parent.remove(element)
