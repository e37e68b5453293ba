"""Merges links that are connected by fixed joints into one body, since engines are slow with many links, and merge links
inexactly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from asrsim.robot.inertia import inertia_tensor, numbers_of
from asrsim.robot.loops import Loop
from asrsim.robot.model import ZERO, Joint, Link, Robot, Shape, Vector
from asrsim.robot.poses import HERE, Pose, roll_pitch_yaw


@dataclass(frozen=True, kw_only=True)
class LinkPlacement:
    """Body of the merged robot that contains a link of the file, and the link's pose in this body."""

    body: str
    """Merged link that contains the link. It is named after the root, or after the link that a moving joint carries."""
    pose: Pose
    """Pose of the link's frame in the body's frame."""


@dataclass(frozen=True, kw_only=True)
class MergedRobot:
    """Robot without fixed joints, and the placement of the file's links in this robot."""

    robot: Robot
    """Robot whose links are the bodies and whose joints are the moving joints, in file order."""
    places: Mapping[str, LinkPlacement]
    """Placement of the file's links in the merged robot, by name of the link."""


def merge_for_engine(robot: Robot, *, fixed_base: bool) -> tuple[MergedRobot, Vector]:
    """Merged robot for a physics engine, and the origin of the base's frame in the frame of the root link, m.

    The frame of a floating base lies at its centre of mass, so that in all engines the linear velocity of the base is the
    velocity of this centre.
    """
    origin = ZERO if fixed_base else merge_fixed(robot).robot.root.centre_of_mass
    return merge_fixed(robot, origin), origin


def merge_fixed(robot: Robot, origin: Vector = ZERO) -> MergedRobot:
    """Robot with merged links: masses, centres, inertias (by the parallel-axis theorem), shapes and joints are combined.

    A body of one link keeps its numbers unchanged. A body has no `<inertial>` if no link in it has an
    `<inertial>`. The inertia of a body of massless links is the sum of the links' inertias.

    origin: origin of the base's frame in the frame of the root link, m.
    """
    if origin == ZERO and robot.moving_joints == robot.joints:
        names = robot.root.name, *(joint.child for joint in robot.joints)
        return MergedRobot(robot=robot, places={name: LinkPlacement(body=name, pose=HERE) for name in names})
    merged = _merged(robot.links, robot.joints, robot.loops, origin)
    return replace(merged, robot=replace(robot, links=merged.robot.links, joints=merged.robot.joints, loops=merged.robot.loops))


# Cache the result, since a run needs the merged robot three times: when the robot is read, for the dynamics, and for the
# engine.
@lru_cache(maxsize=2)
def _merged(all_links: tuple[Link, ...], all_joints: tuple[Joint, ...], loops: tuple[Loop, ...], origin: Vector) -> MergedRobot:
    robot = Robot(name="", path=Path(), text="", actuators=(), links=all_links, joints=all_joints, loops=loops)
    base = Pose(position=-np.array(origin), rotation=np.eye(3))
    links = {link.name: link for link in robot.links}
    moving = robot.moving_joints
    places: dict[str, LinkPlacement] = {}
    bodies: dict[str, Link] = {}
    for name in (robot.root.name, *(joint.child for joint in moving)):
        members = [(links[name], base if name == robot.root.name else HERE)]
        for link, pose in members:  # the loop appends children to `members`
            places[link.name] = LinkPlacement(body=name, pose=pose)
            fixed = [joint for joint in robot.carried.get(link.name, ()) if not joint.moves]
            members += [(links[joint.child], pose.then(joint.origin, joint.rpy)) for joint in fixed]
        bodies[name] = _body(links[name], members)
    joints = tuple(_moved(joint, places[joint.parent]) for joint in moving)
    ordered = tuple(bodies[link.name] for link in robot.links if link.name in bodies)
    carried = tuple(_carried(loop, places) for loop in loops)
    return MergedRobot(robot=replace(robot, links=ordered, joints=joints, loops=carried), places=places)


def _carried(loop: Loop, places: Mapping[str, LinkPlacement]) -> Loop:
    """The loop between the bodies that contain its links."""
    first, second = (places[link] for link in loop.links)
    a, b = (_vector(one.pose.position + one.pose.rotation @ at) for one, at in zip((first, second), loop.points, strict=True))
    return replace(loop, links=(first.body, second.body), points=(a, b))


def _body(first: Link, members: Sequence[tuple[Link, Pose]]) -> Link:
    if len(members) == 1 and members[0][1].is_identity:
        return first
    collisions = tuple(_placed(shape, pose) for link, pose in members for shape in link.collisions)
    visuals = tuple(_placed(shape, pose) for link, pose in members for shape in link.visuals)
    floating, point = _weightless(members)
    body = replace(
        first, collisions=collisions, visuals=visuals, gravity=True, weightless_mass=floating, weightless_centre=point
    )
    heavy = [(link, pose) for link, pose in members if link.mass is not None or link.inertia is not None]
    if not heavy:
        return body
    if len(heavy) == 1 and heavy[0][0] is first and heavy[0][1].is_identity:
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
    inertia = numbers_of(tensor)
    return replace(body, mass=mass, centre_of_mass=_vector(centre), inertia=inertia, inertial_rpy=ZERO)


def _weightless(members: Sequence[tuple[Link, Pose]]) -> tuple[float, Vector]:
    """Mass in kg on which gravity does not act, and its centre in m."""
    parts = [
        (mass, pose.position + pose.rotation @ centre) for link, pose in members for mass, centre in [link.weightless] if mass
    ]
    total = sum(mass for mass, _ in parts)
    centre = sum((mass * place for mass, place in parts), np.zeros(3)) / total if total else np.zeros(3)
    return total, _vector(centre)


def _placed(shape: Shape, pose: Pose) -> Shape:
    if pose.is_identity:
        return shape
    there = pose.then(shape.origin, shape.rpy)
    return replace(shape, origin=_vector(there.position), rpy=roll_pitch_yaw(there.rotation))


def _moved(joint: Joint, parent: LinkPlacement) -> Joint:
    if parent.pose.is_identity:
        return replace(joint, parent=parent.body)
    there = parent.pose.then(joint.origin, joint.rpy)
    return replace(joint, parent=parent.body, origin=_vector(there.position), rpy=roll_pitch_yaw(there.rotation))


def _vector(array: np.ndarray) -> Vector:
    x, y, z = array.tolist()
    return x, y, z
