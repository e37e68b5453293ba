"""Links that fixed joints hold together made one body each, exactly: engines pay for every link, and merge badly themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.robot.inertia import inertia_tensor
from asrsim.robot.model import Joint, Link, Robot, Shape, Vector
from asrsim.robot.poses import HERE, Pose, roll_pitch_yaw


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a link of the file is in the merged robot."""

    body: str
    """The merged link that it belongs to: the one of its links that a moving joint carries, or the root."""
    pose: Pose
    """The link's frame in the body's."""


@dataclass(frozen=True, kw_only=True)
class MergedRobot:
    """A robot without fixed joints, and the way back to the links of its file."""

    robot: Robot
    """Links are bodies, joints the moving ones, in the order of the file."""
    places: Mapping[str, Place]
    """Link of the file -> its place; a body's own link is at home in it."""


def merge_fixed(robot: Robot) -> MergedRobot:
    """Merge what fixed joints hold together: masses, centres, inertias by parallel axes, shapes and joints put in place.

    A body of one link keeps its numbers as they are. A body without any `<inertial>` has none, and one whose links have
    no mass keeps the sum of their inertias.
    """
    links = {link.name: link for link in robot.links}
    moving = robot.moving_joints
    places: dict[str, Place] = {}
    bodies: dict[str, Link] = {}
    for name in (robot.root.name, *(joint.child for joint in moving)):
        members = [(links[name], HERE)]
        for link, pose in members:  # grows while it is walked: children come behind their parents
            places[link.name] = Place(body=name, pose=pose)
            fixed = [joint for joint in robot.carried.get(link.name, ()) if not joint.moves]
            members += [(links[joint.child], pose.then(joint.origin, joint.rpy)) for joint in fixed]
        bodies[name] = _body(links[name], members)
    joints = tuple(_moved(joint, places[joint.parent]) for joint in moving)
    ordered = tuple(bodies[link.name] for link in robot.links if link.name in bodies)
    return MergedRobot(robot=replace(robot, links=ordered, joints=joints), places=places)


def _body(first: Link, members: Sequence[tuple[Link, Pose]]) -> Link:
    if len(members) == 1:
        return first
    collisions = tuple(_placed(shape, pose) for link, pose in members for shape in link.collisions)
    visuals = tuple(_placed(shape, pose) for link, pose in members for shape in link.visuals)
    body = replace(first, collisions=collisions, visuals=visuals)
    heavy = [(link, pose) for link, pose in members if link.mass is not None or link.inertia is not None]
    if not heavy:
        return body
    if len(heavy) == 1 and heavy[0][0] is first:
        return body
    masses = np.array([link.mass or 0.0 for link, _ in heavy])
    centres = np.array([pose.position + pose.rotation @ link.centre_of_mass for link, pose in heavy])
    mass = float(masses.sum())
    centre = masses @ centres / mass if mass else np.zeros(3)
    tensor = np.zeros((3, 3))
    for (link, pose), own, place in zip(heavy, masses, centres, strict=True):
        away = place - centre
        tensor += pose.rotation @ inertia_tensor(link) @ pose.rotation.T
        tensor += own * (away @ away * np.eye(3) - np.outer(away, away))
    xx, xy, xz, yy, yz, zz = tensor[np.triu_indices(3)].tolist()
    return replace(
        body, mass=mass, centre_of_mass=_vector(centre), inertia=(xx, xy, xz, yy, yz, zz), inertial_rpy=(0.0, 0.0, 0.0)
    )


def _placed(shape: Shape, pose: Pose) -> Shape:
    if pose.is_identity:
        return shape
    there = pose.then(shape.origin, shape.rpy)
    return replace(shape, origin=_vector(there.position), rpy=roll_pitch_yaw(there.rotation))


def _moved(joint: Joint, parent: Place) -> Joint:
    if parent.pose.is_identity:
        return replace(joint, parent=parent.body)
    there = parent.pose.then(joint.origin, joint.rpy)
    return replace(joint, parent=parent.body, origin=_vector(there.position), rpy=roll_pitch_yaw(there.rotation))


def _vector(array: np.ndarray) -> Vector:
    x, y, z = array.tolist()
    return x, y, z
