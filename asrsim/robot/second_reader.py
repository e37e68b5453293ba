"""A robot read again by yourdfpy, a reader of others: what two readers of one file make of it must be the same."""

from __future__ import annotations

from io import BytesIO

import numpy as np

from asrsim.errors import Problem
from asrsim.robot.model import Robot
from asrsim.robot.poses import link_poses

SAME_POSE = 1e-9
"""m, and entries of a rotation matrix: beyond rounding."""
SAME_MASS = 1e-12
"""Relative."""


def second_reading(robot: Robot) -> tuple[Problem, ...]:
    """Differences between `robot` and what yourdfpy reads from the same text: links, moving joints, masses, poses at zero."""
    from yourdfpy import URDF

    try:
        other = URDF.load(BytesIO(robot.text.encode()), build_scene_graph=True, load_meshes=False, load_collision_meshes=False)
    except Exception as error:
        # A reader of strangers' files may fail in any way.
        return (_difference(robot, "", f"yourdfpy cannot read this robot: {type(error).__name__}: {error}"),)
    found = []
    links = {link.name.strip(): link for link in other.robot.links}
    for link in robot.links:
        if link.name not in links:
            found.append(_difference(robot, link.name, "yourdfpy has no such link"))
            continue
        inertial = links[link.name].inertial
        mass = 0.0 if inertial is None or inertial.mass is None else float(inertial.mass)
        if abs(mass - (link.mass or 0.0)) > SAME_MASS * max(mass, 1e-300):
            found.append(_difference(robot, link.name, f"yourdfpy reads a mass of {mass:g} kg, asrsim {link.mass or 0.0:g}"))
    moving = {joint.name for joint in robot.moving_joints}
    theirs = {joint.name.strip() for joint in other.robot.joints if joint.type in ("revolute", "continuous", "prismatic")}
    found += [_difference(robot, name, "only one of the readers moves this joint") for name in sorted(moving ^ theirs)]
    if found:
        return tuple(found)
    still = {joint.name: 0.0 for joint in other.robot.joints if joint.name in other.actuated_joint_names}
    other.update_cfg(still)
    for name, pose in link_poses(robot).items():
        seen = other.get_transform(name, robot.root.name)
        apart = max(np.abs(seen[:3, 3] - pose.position).max(), np.abs(seen[:3, :3] - pose.rotation).max())
        if not apart <= SAME_POSE:
            found.append(_difference(robot, name, f"yourdfpy puts this link elsewhere at the zero pose, by {apart:.2g}"))
    return tuple(found)


def _difference(robot: Robot, key: str, message: str) -> Problem:
    return Problem(message, file=robot.path, key=key or None, code="second-reader")
