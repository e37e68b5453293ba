"""Forward kinematics and gravity of a robot as data: many postures at once, by NumPy alone, without an engine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from asrsim.robot.model import Joint, Robot, Vector
from asrsim.robot.poses import rotation_matrix

Array = NDArray[np.float64]
Pose = tuple[Array, Array]
"""Rotation (n, 3, 3) and position (n, 3) m, in the world."""


@dataclass(frozen=True, kw_only=True)
class Chain:
    """A robot on its base."""

    robot: Robot
    base_position: Vector = (0.0, 0.0, 0.0)
    base_rpy: Vector = (0.0, 0.0, 0.0)

    @property
    def root(self) -> str:
        """Name of the root link."""
        children = {joint.child for joint in self.robot.joints}
        return next((joint.parent for joint in self.robot.joints if joint.parent not in children), self.robot.links[0].name)

    def poses(self, positions: Mapping[str, Array], base: Pose | None = None) -> dict[str, Pose]:
        """Pose of every link, link's frame, where joints stand at `positions` (joint -> (n,), rad or m; absent: 0).

        base: pose of the root over the postures, for a floating base.
        """
        count = max((len(values) for values in positions.values()), default=1)
        by_parent: dict[str, list[Joint]] = {}
        for joint in self.robot.joints:
            by_parent.setdefault(joint.parent, []).append(joint)
        root = self.root
        fixed = np.tile(rotation_matrix(self.base_rpy), (count, 1, 1)), np.tile(self.base_position, (count, 1))
        found: dict[str, Pose] = {root: base if base is not None else fixed}
        waiting = [root]
        while waiting:
            parent = waiting.pop()
            rotation, place = found[parent]
            for joint in by_parent.get(parent, ()):
                turned = rotation @ rotation_matrix(joint.rpy)
                moved = place + rotation @ np.array(joint.origin)
                value = positions.get(joint.name)
                if joint.moves and value is not None:
                    if joint.kind == "prismatic":
                        moved = moved + (turned @ np.array(joint.axis)) * value[:, None]
                    else:
                        turned = turned @ _about(joint.axis, value)
                found[joint.child] = turned, moved
                waiting.append(joint.child)
        return found

    def gravity_load(self, positions: Mapping[str, Array], gravity: Vector) -> dict[str, Array]:
        """Moving joint -> (n,) torque in N m (force in N) by which gravity (m/s^2) drives it along its axis."""
        frames = self.poses(positions)
        pull = np.array(gravity)
        parents = {joint.child: joint for joint in self.robot.joints}
        loads = {joint.name: np.zeros(len(next(iter(frames.values()))[1])) for joint in self.robot.moving_joints}
        for link in self.robot.links:
            if not link.mass:
                continue
            rotation, place = frames[link.name]
            centre = place + rotation @ np.array(link.centre_of_mass)
            name = link.name
            while name in parents:
                joint = parents[name]
                if joint.moves:
                    turned, origin = frames[name]
                    axis = turned @ np.array(joint.axis)
                    lever = axis if joint.kind == "prismatic" else np.cross(axis, centre - origin)
                    loads[joint.name] += link.mass * lever @ pull
                name = joint.parent
        return loads


def _about(axis: Vector, angles: Array) -> Array:
    """(n, 3, 3) rotations about a unit axis by angles (n,) in rad (Rodrigues)."""
    x, y, z = axis
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    sine, cosine = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    turned: Array = np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)
    return turned
