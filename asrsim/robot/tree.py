"""The robot as a whole: one tree of links, with mass where joints move."""

from __future__ import annotations

from collections.abc import Sequence

from asrsim.robot.findings import Findings
from asrsim.robot.model import Joint, Link, Robot


def check_tree(findings: Findings, links: Sequence[Link], joints: Sequence[Joint]) -> None:
    """Errors unless joints make one tree of all links: one root, one parent each, no loops."""
    parents: dict[str, Joint] = {}
    for joint in joints:
        if joint.child in parents:
            findings.error(
                f"link '{joint.child}' is the child of joint '{parents[joint.child].name}' already: a link has one parent",
                code="two-parents", line=joint.line, key=joint.name,
            )  # fmt: skip
        else:
            parents[joint.child] = joint
    roots = [link.name for link in links if link.name not in parents]
    if len(roots) > 1:
        findings.error(
            f"the robot has {len(roots)} root links; a URDF is one tree",
            code="several-roots", key="robot", value=", ".join(roots[:10]), hint="Join them by fixed joints",
        )  # fmt: skip
    for link in links:
        seen: set[str] = set()
        name = link.name
        while name in parents and name not in seen:
            seen.add(name)
            name = parents[name].parent
        if name in seen and name == link.name:
            findings.error(
                "joints form a loop; a URDF is a tree", code="loop", line=parents[name].line, key=parents[name].name,
                value=" -> ".join(sorted(seen)[:10]),
            )  # fmt: skip
            return


def check_masses(findings: Findings, links: Sequence[Link], joints: Sequence[Joint]) -> None:
    """Warn of links without `<inertial>` other than the root: an engine would make up 1 kg for them."""
    children = {joint.child for joint in joints}
    for link in links:
        if link.mass is None and link.name in children:
            findings.warn(
                "link has no <inertial>: taken as massless (PyBullet by itself would make it 1 kg)",
                code="no-inertial", line=link.line, key=link.name,
            )  # fmt: skip


def check_movable(findings: Findings, robot: Robot) -> None:
    """A moving joint with neither mass nor inertia behind it has no equation of motion: an error."""
    children: dict[str, list[str]] = {}
    for joint in robot.joints:
        children.setdefault(joint.parent, []).append(joint.child)
    bodies = {link.name: link for link in robot.links}
    for joint in robot.moving_joints:
        behind = [joint.child]
        heavy = False
        while behind and not heavy:
            link = bodies[behind.pop()]
            heavy = bool(link.mass) or any(link.inertia or ())
            behind += children.get(link.name, [])
        if not heavy:
            findings.error(
                "nothing behind this joint has mass or inertia, so its motion is not defined",
                code="massless-joint", line=joint.line, key=joint.name, hint=f"Give link '{joint.child}' an <inertial>",
            )  # fmt: skip
