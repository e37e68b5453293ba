"""Checks of the robot as a whole: one tree of links."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from asrsim.robot.findings import Findings
from asrsim.robot.model import Joint, Link


def without_floating_root(
    findings: Findings, links: tuple[Link, ...], joints: tuple[Joint, ...], driven: Collection[str]
) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Links and joints without a massless root and its floating joint, with which a file states that the robot may float.

    The scenario decides whether the robot floats. Other floating joints are errors. driven: joints that plugins name.
    """
    children = {joint.child for joint in joints}
    bodies = {link.name: link for link in links if link.name not in children}
    for joint in joints:
        above = bodies.get(joint.parent)
        empty = above is not None and not (above.mass or above.collisions or above.visuals)
        alone = sum(other.parent == joint.parent for other in joints) == 1
        if joint.kind == "floating" and above is not None and empty and alone and joint.name not in driven:
            message = f"the robot floats on this joint: the joint and link '{above.name}' are left out"
            hint = "`base: {fixed: false}` in the scenario lets the robot float"
            findings.warn(message, joint.line, joint.name, code="floating-root", hint=hint)
            links, joints = tuple(link for link in links if link is not above), tuple(one for one in joints if one is not joint)
        elif joint.kind == "floating":
            hint = "If the robot floats as a whole, leave this joint out and set `base: {fixed: false}` in the scenario"
            findings.error("floating joints cannot be simulated", joint.line, joint.name, code="joint-type", hint=hint)
    return links, joints


def check_tree(findings: Findings, links: Sequence[Link], joints: Sequence[Joint]) -> None:
    """Report errors unless the joints connect all links to one tree: one root, one parent for each link, no loops."""
    parents: dict[str, Joint] = {}
    for joint in joints:
        if joint.child in parents:
            message = (
                f"link '{joint.child}' is already the child of joint '{parents[joint.child].name}': a link can have only one "
                "parent"
            )
            findings.error(message, joint.line, joint.name, code="two-parents")
        else:
            parents[joint.child] = joint
    roots = [link.name for link in links if link.name not in parents]
    if len(roots) > 1:
        message = f"the robot has {len(roots)} root links; a URDF is one tree"
        hint = "Join them by fixed joints"
        findings.error(message, None, "robot", code="several-roots", value=", ".join(roots[:10]), hint=hint)
    for link in links:
        seen: set[str] = set()
        name = link.name
        while name in parents and name not in seen:
            seen.add(name)
            name = parents[name].parent
        if name in seen and name == link.name:
            joint, value = parents[name], " -> ".join(sorted(seen)[:10])
            findings.error("joints form a loop; a URDF is a tree", joint.line, joint.name, code="loop", value=value)
            return
