"""Checks of the robot as a whole: one tree of links, and mass behind every moving joint."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from asrsim.robot.findings import Findings
from asrsim.robot.mechanics import fixed_at
from asrsim.robot.model import Joint, Link, Robot

FREEDOMS = {
    "floating": "A robot that floats as a whole: leave this joint out and set `base: {fixed: false}` in the scenario",
    "planar": "Two prismatic joints and a revolute one do the same",
}
"""Hints for joint types with several degrees of freedom. PyBullet fixes planar joints and lacks dynamics of floating joints."""


def without_floating_root(
    findings: Findings, links: tuple[Link, ...], joints: tuple[Joint, ...], driven: Collection[str]
) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Links and joints without a massless root and its floating joint, by which files state that the robot may float.

    The scenario decides whether the robot floats. Other joints with several degrees of freedom are errors. driven: joints that
    plugins name.
    """
    children = {joint.child for joint in joints}
    bodies = {link.name: link for link in links if link.name not in children}
    for joint in joints:
        above = bodies.get(joint.parent)
        empty = above is not None and not (above.mass or above.collisions or above.visuals)
        alone = sum(other.parent == joint.parent for other in joints) == 1
        if joint.kind == "floating" and above is not None and empty and alone and joint.name not in driven:
            message = f"the robot floats on this joint: it is left out, with link '{above.name}'"
            hint = "`base: {fixed: false}` in the scenario lets the robot float"
            findings.warn(message, joint.line, joint.name, code="floating-root", hint=hint)
            links, joints = tuple(link for link in links if link is not above), tuple(one for one in joints if one is not joint)
        elif joint.kind in FREEDOMS:
            message = f"{joint.kind} joints cannot be simulated"
            findings.error(message, joint.line, joint.name, code="joint-type", hint=FREEDOMS[joint.kind])
    return links, joints


def check_tree(findings: Findings, links: Sequence[Link], joints: Sequence[Joint]) -> None:
    """Report errors unless the joints connect all links to one tree: one root, one parent for each link, no loops."""
    parents: dict[str, Joint] = {}
    for joint in joints:
        if joint.child in parents:
            message = f"link '{joint.child}' is the child of joint '{parents[joint.child].name}' already: a link has one parent"
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


def carries_mass(robot: Robot, joint: Joint) -> bool:
    """Whether a link behind the joint has mass or inertia."""
    bodies, behind = {link.name: link for link in robot.links}, [joint.child]
    while behind:
        link = bodies[behind.pop()]
        if link.mass or any(link.inertia or ()):
            return True
        behind += [carried.child for carried in robot.carried.get(link.name, ())]
    return False


def without_massless_joints(findings: Findings, robot: Robot) -> Robot:
    """Robot in which joints with neither mass nor inertia behind them are fixed, since their motion is undefined.

    Such a joint is an error if it has an actuator, and where no other joint moves. A rotor gives a joint inertia, and so do the
    joints that follow it; a joint that follows another one moves with it.
    """
    driven = {block.joint for block in robot.actuators}
    light = [joint for joint in robot.moving_joints if not (joint.rotor_inertia > 0.0 or carries_mass(robot, joint))]
    moved = {joint.mimic for joint in robot.moving_joints if joint not in light}
    massless = [joint for joint in light if not joint.mimic and joint.name not in moved]
    held = [joint for joint in massless if joint.name not in driven]
    held = held if len(massless) < len(robot.moving_joints) else []
    for joint in massless:
        message = "nothing behind this joint has mass or inertia, so its motion is not defined"
        hint = f"Give link '{joint.child}' an <inertial>, or fix the joint in the scenario: `locked: [{joint.name}]`"
        if joint in held:
            findings.warn(f"{message}: it is fixed", joint.line, joint.name, code="massless-joint", hint=hint)
        else:
            findings.error(message, joint.line, joint.name, code="massless-joint", hint=hint)
    fixed = {joint.name: replace(joint, kind="fixed") for joint in held}
    fixed |= {joint.name: fixed_at(joint, joint.offset) for joint in robot.moving_joints if joint.mimic in fixed}
    return replace(robot, joints=tuple(fixed.get(joint.name, joint) for joint in robot.joints)) if fixed else robot
