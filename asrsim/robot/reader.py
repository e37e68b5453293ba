"""Reads a URDF or xacro file as a `Robot`, or raises one RobotError with all problems."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from asrsim.errors import RobotError
from asrsim.robot.blocks import read_blocks
from asrsim.robot.closures import with_loops
from asrsim.robot.doubts import warnings_of
from asrsim.robot.findings import Findings
from asrsim.robot.freedoms import divide_joints
from asrsim.robot.massless import without_massless_joints
from asrsim.robot.mechanics import read_mechanics
from asrsim.robot.model import Robot
from asrsim.robot.mounting import with_rotors
from asrsim.robot.packages import packages_of
from asrsim.robot.structure import declare_world, read_joints, read_links
from asrsim.robot.tree import check_tree, without_floating_root
from asrsim.robot.unread import check_words
from asrsim.robot.xmlfile import elements, parse_xml, read_bytes

MAX_LINKS = 2000
"""Largest number of links, and of joints, of a robot."""
MAX_MOVING = 121
"""Largest number of moving joints: PyBullet's state has 128 entries, 7 of them for the base. With more
joints, PyBullet silently confuses positions and velocities.
"""
OTHER_FORMATS = {
    "sdf": (" (an SDF file is not a URDF)", "Convert it: `sdf2urdf` of the ROS package pysdf makes a URDF of SDF"),
    "mujoco": (
        " (an MJCF file is not a URDF)",
        "Convert it: `mjcf_urdf_simple_converter` (pip install mjcf-urdf-simple-converter) makes a URDF of MJCF",
    ),
}
"""Root element of other formats of robots -> remark and hint."""


def load_robot(
    path: Path | str,
    *,
    xacro_arguments: Mapping[str, str] | None = None,
    package_paths: Mapping[str, Path | str] | None = None,
    locked: Sequence[str] = (),
) -> Robot:
    """Robot from a `.urdf` or `.xacro` file, which may be hostile.

    `xacro_arguments` are values for `<xacro:arg>`; `package_paths` (name -> folder) resolve `$(find name)` and
    `package://name`. `locked` names joints that are fixed at 0, even if they move in the file; `*` stands for any
    text. Problems state the line in the file, except for expanded xacro files. Raises RobotError with all problems of the file.
    Whether the parameters and mode of an actuator fit together is checked later, with the scenario's values.
    """
    robot = read_robot(path, xacro_arguments=xacro_arguments, package_paths=package_paths, locked=locked)
    if robot.faults:
        raise RobotError(robot.faults, warnings=warnings_of(robot))
    return robot


def read_robot(
    path: Path | str,
    *,
    xacro_arguments: Mapping[str, str] | None = None,
    package_paths: Mapping[str, Path | str] | None = None,
    locked: Sequence[str] = (),
) -> Robot:
    """Robot as from `load_robot`, but with the problems of the file in its `faults`.

    Raises RobotError if the file contains no robot, or a robot that is too large.
    """
    path = Path(path)
    data = read_bytes(path)
    findings = Findings(path)
    root = parse_xml(data, path, notes=findings.warnings)
    if path.suffix == ".xacro" or _uses_xacro(root):
        from asrsim.robot.expansion import expand_xacro

        try:
            data, warnings = expand_xacro(path, xacro_arguments or {}, packages_of(path, package_paths))
        except RobotError as error:
            if path.suffix == ".xacro" or xacro_arguments:
                raise
            reason = error.problems[0]
            message = f"{reason.message}; elements of xacro have no effect, as in ROS, which does not expand a URDF"
            findings.warn(message, reason.line, "robot", code="xacro-left")
        else:
            findings.warnings += warnings
            findings.expanded = True
            root = parse_xml(data, path, notes=findings.warnings)
    return _read(root, data, findings, locked)


def _read(root: Any, data: bytes, findings: Findings, locked: Sequence[str]) -> Robot:
    path, mended = findings.file, bool(findings.warnings)
    if root.tag != "robot":
        what, hint = OTHER_FORMATS.get(root.tag, ("", None))
        message = f"the root element is <{root.tag}>, not <robot>{what}"
        raise RobotError(message, file=path, line=findings.line(root), hint=hint, code="not-a-urdf")
    count = len(elements(root, "link"))
    if count > MAX_LINKS or len(elements(root, "joint")) > MAX_LINKS:
        raise RobotError(f"the robot has more than {MAX_LINKS} links or joints", file=path, value=count, code="too-many-links")
    contact_words = check_words(findings, root)
    mended |= divide_joints(findings, root, locked) | declare_world(findings, root)
    links = read_links(findings, root)
    links, joints = read_mechanics(findings, root, links, read_joints(findings, root, links, locked))
    moving = sum(joint.moves for joint in joints)
    if moving > MAX_MOVING:
        message = f"the robot has {moving} moving joints; PyBullet simulates at most {MAX_MOVING}"
        findings.error(message, None, "robot", code="too-many-joints", hint="Remove joints that do not matter to the motion")
    driven = {(element.text or "").strip() for element in root.iter("joint")}
    links, joints = without_floating_root(findings, links, joints, driven)
    # Check the tree only if the file had no errors so far. If a joint could not be read, its child link would appear to be a
    # root.
    if not findings.errors:
        check_tree(findings, links, joints)
    whole = not findings.errors
    blocks, unread = read_blocks(root, joints, findings, locked)
    robot = Robot(
        name=root.get("name") or path.stem,
        path=path,
        text=_text(data, root, mended=mended),
        links=links,
        joints=joints,
        actuators=blocks,
        unread=unread,
        contact_words=contact_words,
        locked=tuple(locked),
    )
    robot = with_rotors(robot, {})
    if whole:
        robot = with_loops(findings, root, without_massless_joints(findings, robot))
    faults = tuple(sorted(findings.errors, key=lambda problem: problem.line or 0))
    return with_rotors(replace(robot, findings=tuple(findings.warnings), faults=faults), {})


def _text(data: bytes, root: Any, *, mended: bool) -> str:
    """Document as text. A declaration of another encoding is removed, since a text has no encoding."""
    from lxml import etree

    encoding = (root.getroottree().docinfo.encoding or "utf-8").lower()
    if encoding in ("utf-8", "us-ascii", "ascii") and not mended:
        return data.decode("utf-8-sig", errors="replace")
    text: str = etree.tostring(root.getroottree(), encoding="unicode")
    return text


def _uses_xacro(root: Any) -> bool:
    # Let lxml search elements, texts and attributes for xacro's words, since it is far faster than Python.
    return bool(
        root.xpath(
            "boolean(//*[starts-with(name(), 'xacro:')] | //*[contains(text(), '${') or contains(text(), '$(')]"
            " | //@*[contains(., '${') or contains(., '$(')])"
        )
    )
