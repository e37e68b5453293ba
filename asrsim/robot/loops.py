"""Closed chains of one freedom: a point of one link coincides with a point of another one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.errors import Problem, RobotError
from asrsim.robot.merge import merge_fixed
from asrsim.robot.model import Joint, Robot, Vector
from asrsim.robot.poses import rotation_matrix

FREE = 1e-9
"""Smallest singular value of a loop's Jacobian, as a fraction of the largest, that counts as an equation."""


@dataclass(frozen=True, kw_only=True)
class Loop:
    """A loop that is closed where a point of one link coincides with a point of another link."""

    links: tuple[str, str]
    points: tuple[Vector, Vector]
    """Points in the frames of the links, m."""
    master: str = ""
    """Joint that the other joints of the loop follow; empty: the first of the loop's joints that has an actuator, else the
    first joint."""


@dataclass(frozen=True, kw_only=True)
class LoopPath:
    """Joints between the links of a loop, from their common body: those of the first side, then those of the second side."""

    joints: tuple[int, ...]
    """Indices among the robot's moving joints."""
    split: int
    """Number of joints on the first side."""
    master: int
    """Index of the master in `joints`."""
    slides: tuple[bool, ...]
    origins: tuple[Vector, ...]
    turns: tuple[np.ndarray, ...]
    axes: tuple[Vector, ...]
    ends: np.ndarray
    """Points (6,) that coincide, in the frames of the last bodies of both sides, m."""


def paths_of(robot: Robot) -> tuple[LoopPath, ...]:
    """Paths of the robot's loops. Raises RobotError for loops without joints, with joints of other loops or couplings."""
    if not robot.loops:
        return ()
    merged = merge_fixed(robot)
    above = {joint.child: joint for joint in merged.robot.joints}
    order = {joint.name: j for j, joint in enumerate(robot.moving_joints)}
    driven = {block.joint for block in robot.actuators}
    coupled = {joint.name for joint in robot.moving_joints if joint.mimic} | {one.mimic for one in robot.moving_joints}
    used: set[str] = set()
    found, problems = [], []
    for number, loop in enumerate(robot.loops):
        places = [merged.places[name] for name in loop.links]
        sides = [_upwards(above, place.body) for place in places]
        while sides[0] and sides[1] and sides[0][0] == sides[1][0]:
            sides = [side[1:] for side in sides]
        path = [*sides[0], *sides[1]]
        names = [joint.name for joint in path]
        shared = [name for name in names if name in used or name in coupled]
        used.update(names)
        master = loop.master or next((name for name in names if name in driven), names[0] if names else "")
        message, choices = "", tuple[str, ...]()
        if len(path) < 2:
            message = "no joints lie between its links, so nothing can close it"
        elif shared:
            message = f"joint '{shared[0]}' belongs to another loop or follows a joint: such loops cannot be simulated"
        elif master not in names:
            message, choices = f"its master '{master}' is no joint of the loop", tuple(names)
        elif (many := [name for name in names if name in driven]) and len(many) > 1:
            message = f"has several driven joints ({', '.join(many)}): a loop has one master"
        if message:
            problems.append(Problem(message, key=f"loops.{number}", choices=choices, code="loop"))
            continue
        ends = [place.pose.position + place.pose.rotation @ point for place, point in zip(places, loop.points, strict=True)]
        found.append(LoopPath(
            joints=tuple(order[name] for name in names), split=len(sides[0]), master=names.index(master),
            slides=tuple(joint.kind == "prismatic" for joint in path), origins=tuple(joint.origin for joint in path),
            turns=tuple(rotation_matrix(joint.rpy) for joint in path), axes=tuple(joint.axis for joint in path),
            ends=np.concatenate(ends),
        ))  # fmt: skip
    if problems:
        raise RobotError(problems)
    return tuple(found)


def _upwards(above: dict[str, Joint], body: str) -> Sequence[Joint]:
    """Joints from the root to a body."""
    found: list[Joint] = []
    while body in above:
        found.insert(0, above[body])
        body = above[body].parent
    return found
