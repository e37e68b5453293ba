"""Reads a robot file: URDF or xacro in, :class:`Robot` out, or one RobotError with everything that is wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from asrsim.errors import RobotError
from asrsim.robot.blocks import read_blocks
from asrsim.robot.doubts import robot_doubts
from asrsim.robot.findings import Findings
from asrsim.robot.model import Robot
from asrsim.robot.packages import packages_of
from asrsim.robot.structure import read_joints, read_links
from asrsim.robot.tree import check_movable, check_tree, without_floating_root
from asrsim.robot.vocabulary import check_words
from asrsim.robot.xmlfile import elements, parse_xml, read_bytes

MAX_LINKS = 2000
"""Links or joints of a robot."""
MAX_MOVING = 121
"""PyBullet's state has 128 places, 7 of them the base's; beyond, it silently mixes up positions and velocities. Links that
fixed joints hold together are one body to it."""
XACRO = "{http://www.ros.org/wiki/xacro}"


def load_robot(
    path: Path | str,
    *,
    xacro_arguments: Mapping[str, str] | None = None,
    package_paths: Mapping[str, Path | str] | None = None,
) -> Robot:
    """Read a `.urdf` or `.xacro` file of which nothing is trusted.

    `xacro_arguments` are the file's `<xacro:arg>` values; `package_paths` (name -> folder) serve `$(find name)` and
    `package://name`. Lines in problems are the file's own; those of an expanded xacro file are not known.
    Raises RobotError with all problems of the file. Whether an actuator's parameters and mode go together is checked later,
    together with the scenario, which may change both.
    """
    robot = read_robot(path, xacro_arguments=xacro_arguments, package_paths=package_paths)
    if robot.faults:
        raise RobotError(robot.faults, warnings=robot.warnings)
    return robot


def read_robot(
    path: Path | str,
    *,
    xacro_arguments: Mapping[str, str] | None = None,
    package_paths: Mapping[str, Path | str] | None = None,
) -> Robot:
    """As :func:`load_robot`, but with the problems of the file in the robot's `faults`.

    Raises RobotError where the file has no robot at all, or one that is too large.
    """
    path = Path(path)
    data = read_bytes(path)
    root = parse_xml(data, path)
    findings = Findings(path)
    if path.suffix == ".xacro" or _uses_xacro(root):
        from asrsim.robot.expansion import expand_xacro

        data, warnings = expand_xacro(path, xacro_arguments or {}, packages_of(path, package_paths))
        findings.warnings += warnings
        findings.expanded = True
        root = parse_xml(data, path)
    return _read(root, data, findings)


def _read(root: Any, data: bytes, findings: Findings) -> Robot:
    path = findings.file
    if root.tag != "robot":
        what = " (an SDF file is not a URDF)" if root.tag == "sdf" else ""
        message = f"the root element is <{root.tag}>, not <robot>{what}"
        raise RobotError(message, file=path, line=findings.line(root), code="not-a-urdf")
    count = len(elements(root, "link"))
    if count > MAX_LINKS or len(elements(root, "joint")) > MAX_LINKS:
        raise RobotError(f"the robot has more than {MAX_LINKS} links or joints", file=path, value=count, code="too-many-links")
    check_words(findings, root)
    links = read_links(findings, root)
    joints = read_joints(findings, root, links)
    moving = sum(joint.moves for joint in joints)
    if moving > MAX_MOVING:
        message = f"the robot has {moving} moving joints; PyBullet simulates at most {MAX_MOVING}"
        findings.error(message, None, "robot", code="too-many-joints", hint="Remove joints that do not matter to the motion")
    driven = {(element.text or "").strip() for element in root.iter("joint")}
    links, joints = without_floating_root(findings, links, joints, driven)
    # A joint that could not be read would make its links look like roots.
    if not findings.errors:
        check_tree(findings, links, joints)
    whole = not findings.errors
    blocks, unread = read_blocks(root, joints, findings)
    robot = Robot(
        name=root.get("name") or path.stem, path=path, text=_text(data, root), links=links, joints=joints, actuators=blocks,
        unread=unread,
    )  # fmt: skip
    if whole:
        check_movable(findings, robot)
    if findings.errors:
        faults = tuple(sorted(findings.errors, key=lambda problem: problem.line or 0))
        return replace(robot, warnings=tuple(findings.warnings), faults=faults)
    return replace(robot, warnings=(*findings.warnings, *robot_doubts(robot)))


def _text(data: bytes, root: Any) -> str:
    """The document as text that states no encoding other than its own."""
    from lxml import etree

    encoding = (root.getroottree().docinfo.encoding or "utf-8").lower()
    if encoding in ("utf-8", "us-ascii", "ascii"):
        return data.decode("utf-8-sig", errors="replace")
    text: str = etree.tostring(root.getroottree(), encoding="unicode")
    return text


def _uses_xacro(root: Any) -> bool:
    return any(isinstance(element.tag, str) and element.tag.startswith(XACRO) for element in root.iter())
