"""Forward kinematics and gravity torques of a robot for many postures at once, in NumPy, without an engine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from asrsim.robot.model import Joint, Robot, Vector
from asrsim.robot.poses import rotation_matrix

Array = NDArray[np.float64]
Pose = tuple[Array, Array]
"""Rotation (n, 3, 3) and position (n, 3) in m, in the world frame."""


class _Step:
    """Transform from a link to the next, except the part that depends on the posture."""

    def __init__(self, joint: Joint) -> None:
        x, y, z = joint.axis
        self.joint = joint
        self.rotation, self.origin, self.axis = rotation_matrix(joint.rpy), np.array(joint.origin), np.array(joint.axis)
        self.cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
        """Cross-product matrix of the axis, for Rodrigues' formula."""
        self.cross_squared = self.cross @ self.cross


@dataclass(frozen=True, kw_only=True)
class Chain:
    """Kinematic chain of a robot, for forward kinematics and gravity torques."""

    robot: Robot
    base_position: Vector
    base_rpy: Vector

    def poses(self, positions: Mapping[str, Array], base: Pose | None = None) -> dict[str, Pose]:
        """Poses of all link frames for joint positions (joint -> (n,), rad or m; 0 for missing joints). base: poses of a
        floating base.
        """
        count = max((len(values) for values in positions.values()), default=1)
        fixed = np.tile(rotation_matrix(self.base_rpy), (count, 1, 1)), np.tile(self.base_position, (count, 1))
        found: dict[str, Pose] = {self.robot.root.name: base if base is not None else fixed}
        for step in self._outwards:
            joint = step.joint
            rotation, position = found[joint.parent]
            turned, moved = rotation @ step.rotation, position + rotation @ step.origin
            value = positions.get(joint.name)
            if joint.moves and value is not None:
                if joint.kind == "prismatic":
                    moved = moved + (turned @ step.axis) * value[:, None]
                else:
                    turned = turned @ (
                        np.eye(3) + np.sin(value)[:, None, None] * step.cross
                        + (1.0 - np.cos(value))[:, None, None] * step.cross_squared
                    )  # fmt: skip
            found[joint.child] = turned, moved
        return found

    @cached_property
    def _outwards(self) -> tuple[_Step, ...]:
        return tuple(map(_Step, self.robot.outward_joints))

    def gravity_load(self, positions: Mapping[str, Array], gravity: Vector) -> dict[str, Array]:
        """Gravity torque (n,) about the axis of each moving joint, N m (or force along the axis, N). gravity in m/s^2."""
        frames = self.poses(positions)
        pull = np.array(gravity)
        masses = {link.name: link.mass or 0.0 for link in self.robot.links}
        moments = {
            link.name: masses[link.name] * (position + rotation @ np.array(link.centre_of_mass))
            for link in self.robot.links
            for rotation, position in (frames[link.name],)
        }
        above = {joint.child: joint for joint in self.robot.joints}
        loads: dict[str, Array] = {}
        # From the tips to the root: add the mass and mass moment (kg m) of each link to its parent.
        for name in reversed(frames):
            joint = above.get(name)
            if joint is None:
                continue
            if joint.moves:
                rotation, origin = frames[name]
                axis = rotation @ np.array(joint.axis)
                if joint.kind == "prismatic":
                    loads[joint.name] = masses[name] * (axis @ pull)
                else:
                    torque = np.cross(moments[name] - masses[name] * origin, pull)
                    loads[joint.name] = np.einsum("ni,ni->n", axis, torque)
            masses[joint.parent] += masses[name]
            moments[joint.parent] = moments[joint.parent] + moments[name]
        return loads
