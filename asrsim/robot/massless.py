"""Fixes joints whose motion is undefined, since they move no mass."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from asrsim.errors import listed
from asrsim.robot.dynamics import RobotModel
from asrsim.robot.findings import Findings
from asrsim.robot.mechanics import fixed_at
from asrsim.robot.model import Joint, Robot
from asrsim.robot.mounting import with_rotors

SINGULAR = 1e-12
"""Smallest eigenvalue that double precision can distinguish from 0, of a mass matrix whose diagonal is scaled to 1."""
NEAR = 0.1
"""Smallest off-diagonal element of the scaled mass matrix at which a warning names its two joints together."""


def carries_mass(robot: Robot, joint: Joint) -> bool:
    """Whether a link behind the joint has mass or inertia."""
    bodies, behind = {link.name: link for link in robot.links}, [joint.child]
    while behind:
        link = bodies[behind.pop()]
        if link.mass or any(link.inertia or ()):
            return True
        behind += [carried.child for carried in robot.carried.get(link.name, ())]
    return False


def springable_joints(robot: Robot) -> tuple[str, ...]:
    """Joints that follow no other joint, and that move mass even without the inertia of their rotors, which a spring would
    separate from the link.
    """
    bare = replace(robot, joints=tuple(replace(joint, rotor_inertia=0.0) for joint in robot.joints))
    idle = {joint.name for joint in _idle_joints(bare, ())}
    return tuple(
        joint.name
        for joint in robot.moving_joints
        if joint.name not in robot.followers and joint.name not in idle and carries_mass(robot, joint)
    )


def without_massless_joints(findings: Findings, robot: Robot) -> Robot:
    """Robot in which joints that move no mass are fixed, since their motion is undefined. The motion of the other joints does
    not depend on these joints.

    Such a joint is an error if it has an actuator, or if no other joint moves. A rotor gives inertia to a joint, and so do the
    joints that follow this joint. A joint that follows another joint moves with it.
    """
    driven = {block.joint for block in robot.actuators}
    light = [joint for joint in robot.moving_joints if not (joint.rotor_inertia > 0.0 or carries_mass(robot, joint))]
    moved = {joint.mimic for joint in robot.moving_joints if joint not in light}
    massless = [joint for joint in light if not joint.mimic and joint.name not in moved]
    held = [joint for joint in massless if joint.name not in driven]
    # Fix no joint if no joint would then move. A joint that follows a fixed joint does not move, either.
    names = {joint.name for joint in massless}
    held = held if any(joint.name not in names and joint.mimic not in names for joint in robot.moving_joints) else []
    for joint in massless:
        message = "no link behind this joint has mass or inertia, so its motion is not defined"
        hint = f"Give link '{joint.child}' an <inertial>, or fix the joint in the scenario: `locked: [{joint.name}]`"
        if joint in held:
            findings.warn(f"{message}: it is fixed", joint.line, joint.name, code="massless-joint", hint=hint)
        else:
            findings.error(message, joint.line, joint.name, code="massless-joint", hint=hint)
    robot = _fixed(robot, held)
    idle = _idle_joints(robot, driven) if robot.moving_joints and not findings.errors else {}
    # If no other joint moves, do not warn here, since an error of the run states what is missing.
    if len(idle) == len(robot.moving_joints):
        return robot
    for joint, message in idle.items():
        hint = f"Give link '{joint.child}' an inertia, or fix another joint in the scenario: `locked: [NAME]`"
        text = f"{message}, so its motion is not defined: it is fixed"
        findings.warn(text, joint.line, joint.name, code="massless-motion", hint=hint)
    return _fixed(robot, idle)


def _fixed(robot: Robot, held: Collection[Joint]) -> Robot:
    fixed = {joint.name: replace(joint, kind="fixed") for joint in held}
    fixed |= {joint.name: fixed_at(joint, joint.offset) for joint in robot.moving_joints if joint.mimic in fixed}
    return replace(robot, joints=tuple(fixed.get(joint.name, joint) for joint in robot.joints)) if fixed else robot


def _idle_joints(robot: Robot, driven: Collection[str]) -> dict[Joint, str]:
    """Joints without an actuator that must be fixed so that the mass matrix is positive at the initial positions, each with the
    reason. These are joints with a point mass on their axis. If joints move against each other without mass between them, the
    joints with the smallest range are fixed.
    """
    joints, couplings = robot.moving_joints, robot.couplings
    mass = RobotModel(with_rotors(robot, {})).mass_matrix([joint.start or 0.0 for joint in joints])
    heavy = np.diag(mass) > 0.0
    scale = 1.0 / np.sqrt(np.where(heavy, np.diag(mass), 1.0))
    scaled = mass * np.outer(scale, scale)
    if heavy.all() and _regular(scaled, range(len(joints))):
        return {}
    coupled = {*np.flatnonzero(couplings.master != np.arange(len(joints))).tolist()}
    coupled |= {int(couplings.master[j]) for j in coupled}
    idle: dict[Joint, str] = {}
    stays = [j for j, joint in enumerate(joints) if j in coupled or joint.name in driven]
    if stays and not (heavy[stays].all() and _regular(scaled, stays)):
        return {}  # fixing other joints does not help, since the joints that must remain move no mass
    for j in sorted({*range(len(joints))} - {*stays}, key=lambda j: joints[j].stops[0] - joints[j].stops[1]):
        if heavy[j] and _regular(scaled, [*stays, j]):
            stays.append(j)
        elif heavy[j]:
            near = listed([f"'{joints[k].name}'" for k in stays if abs(scaled[j, k]) > NEAR], 3)
            idle[joints[j]] = f"this joint and {near} can move against each other without moving any mass"
        else:
            idle[joints[j]] = "the links behind this joint have no inertia about its axis"
    return idle


def _regular(scaled: np.ndarray, chosen: Sequence[int]) -> bool:
    """Whether the joints with these indices have a positive mass matrix. scaled: mass matrix with ones on its diagonal."""
    return bool(np.linalg.eigvalsh(scaled[np.ix_(chosen, chosen)])[0] >= SINGULAR)
