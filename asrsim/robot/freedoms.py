"""Writes each joint with two or three degrees of freedom as joints with one degree of freedom, with massless links between
them.

A planar joint of a URDF becomes two slides in the plane, and a hinge about the normal of the plane, which is the joint's axis.
A spherical joint, which URDF lacks but PyBullet and MuJoCo read, becomes three hinges about the axes x, y and z of the joint's
frame. At 90 degrees of the second hinge, the axes of the other two hinges would coincide; a limit stops the second hinge before
this angle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from lxml import etree

from asrsim.robot.findings import Findings
from asrsim.robot.model import is_locked
from asrsim.robot.vocabulary import number_of
from asrsim.robot.xmlfile import elements, name_of

FREEDOMS = ("planar", "spherical", "ball")
"""Types of joints with several degrees of freedom."""
STEEPEST = 1.5
"""Largest angle of the second hinge of a spherical joint, rad."""
REACH = {"prismatic": math.inf, "revolute": STEEPEST, "continuous": math.inf}
"""Limit in each direction of a joint that replaces a joint with several degrees of freedom, rad or m, by type of the new
joint."""


def divide_joints(findings: Findings, root: Any, locked: Sequence[str]) -> bool:
    """Replace joints with several degrees of freedom in the document. Returns whether the document has such joints. locked:
    joints that are fixed."""
    joints = [joint for joint in elements(root, "joint") if name_of(joint, "type") in FREEDOMS]
    joints = [joint for joint in joints if not is_locked(name_of(joint), locked)]
    for joint in joints:
        _divide(findings, joint)
        root.remove(joint)
    return bool(joints)


def _divide(findings: Findings, joint: Any) -> None:
    name, planar = name_of(joint), name_of(joint, "type") == "planar"
    names = [f"{name}_{number}" for number in (1, 2, 3)]
    if planar:
        (axis,) = elements(joint, "axis")[:1] or [joint]
        axes = _plane(np.array(findings.vector(axis, "xyz", f"{name}.axis", default=(1.0, 0.0, 0.0))))
        kinds, parts = ("prismatic", "prismatic", "continuous"), "two slides and a hinge"
    else:
        axes, kinds = np.eye(3), ("continuous", "revolute", "continuous")
        parts = f"hinges about x, y and z; the hinge about y stops at {STEEPEST:g} rad, before the other axes coincide"
    message = f"has several degrees of freedom: it is simulated as joints {names[0]}, {names[1]}, {names[2]}, which are {parts}"
    limits, dynamics, origin = (elements(joint, tag)[:1] for tag in ("limit", "dynamics", "origin"))
    if any(number_of(tag.get(key, "0")) for tag in limits for key in ("lower", "upper")):
        message += ". Its limits of position are left out"
    given = [key for key in ("damping", "friction") for tag in dynamics if number_of(tag.get(key, "0"))]
    if given and not planar:
        message += f". Each hinge has its {' and '.join(given)} about its own axis: together they are not isotropic"
        # The sum of the squared rates is |angular velocity|^2 - 2 rate_1 rate_3 sin(angle_2).
        message += ", except for damping while the second hinge is at 0 rad" if "damping" in given else ""
    findings.warn(message, joint, name, code="several-freedoms")
    links = [_end(joint, "parent"), f"{name}_link_1", f"{name}_link_2", _end(joint, "child")]
    for k, kind in enumerate(kinds):
        part = _added(joint, "joint", name=names[k], type=kind)
        for tag in (*dynamics, *(origin if k == 0 else ())):
            etree.SubElement(part, tag.tag, tag.attrib)
        etree.SubElement(part, "parent", link=links[k])
        etree.SubElement(part, "child", link=links[k + 1])
        etree.SubElement(part, "axis", xyz=" ".join(f"{value:.17g}" for value in axes[k]))
        efforts = {key: tag.get(key) for tag in limits for key in ("effort", "velocity") if key in tag.attrib}
        etree.SubElement(part, "limit", efforts, lower=f"-{REACH[kind]:g}", upper=f"{REACH[kind]:g}")
    for link in links[1:3]:
        _added(joint, "link", name=link)


def _added(joint: Any, tag: str, **attributes: str) -> Any:
    """New element before the joint, on its line."""
    element = etree.Element(tag, attributes)
    element.sourceline = joint.sourceline
    joint.addprevious(element)
    return element


def _end(joint: Any, tag: str) -> str:
    """Name of the link at one end of the joint; empty if the joint states no link."""
    return next((name_of(end, "link") for end in elements(joint, tag)), "")


def _plane(normal: np.ndarray) -> np.ndarray:
    """Two directions (3,) in the plane with the normal (3,), and the normal."""
    first = np.cross(np.eye(3)[int(np.argmin(np.abs(normal)))], normal)
    return np.array([first, np.cross(normal, first), normal])
