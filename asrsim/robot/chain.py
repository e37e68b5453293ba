"""Forward kinematics and gravity of a robot as data: many postures at once, by NumPy alone, without an engine."""

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
"""Rotation (n, 3, 3) and position (n, 3) m, in the world."""


class _Step:
    """From a link to the next: what does not depend on the posture."""

    def __init__(self, joint: Joint) -> None:
        x, y, z = joint.axis
        self.joint = joint
        self.rotation, self.origin, self.axis = rotation_matrix(joint.rpy), np.array(joint.origin), np.array(joint.axis)
        self.cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
        """Of Rodrigues' formula, and its square."""
        self.square = self.cross @ self.cross


@dataclass(frozen=True, kw_only=True)
class Chain:
    """A robot on its base."""

    robot: Robot
    base_position: Vector = (0.0, 0.0, 0.0)
    base_rpy: Vector = (0.0, 0.0, 0.0)

    def poses(self, positions: Mapping[str, Array], base: Pose | None = None) -> dict[str, Pose]:
        """Pose of every link, link's frame, where joints stand at `positions` (joint -> (n,), rad or m; absent: 0).

        base: pose of the root over the postures, for a floating base.
        """
        count = max((len(values) for values in positions.values()), default=1)
        fixed = np.tile(rotation_matrix(self.base_rpy), (count, 1, 1)), np.tile(self.base_position, (count, 1))
        found: dict[str, Pose] = {self.robot.root.name: base if base is not None else fixed}
        for step in self._outwards:
            joint = step.joint
            rotation, place = found[joint.parent]
            turned, moved = rotation @ step.rotation, place + rotation @ step.origin
            value = positions.get(joint.name)
            if joint.moves and value is not None:
                if joint.kind == "prismatic":
                    moved = moved + (turned @ step.axis) * value[:, None]
                else:
                    turned = turned @ (
                        np.eye(3) + np.sin(value)[:, None, None] * step.cross
                        + (1.0 - np.cos(value))[:, None, None] * step.square
                    )  # fmt: skip
            found[joint.child] = turned, moved
        return found

    @cached_property
    def _outwards(self) -> tuple[_Step, ...]:
        """The joints from the root on, parents first."""
        steps, waiting = [], [self.robot.root.name]
        while waiting:
            for joint in self.robot.carried.get(waiting.pop(), ()):
                steps.append(_Step(joint))
                waiting.append(joint.child)
        return tuple(steps)

    def gravity_load(self, positions: Mapping[str, Array], gravity: Vector) -> dict[str, Array]:
        """Moving joint -> (n,) torque in N m (force in N) by which gravity (m/s^2) drives it along its axis."""
        frames = self.poses(positions)
        pull = np.array(gravity)
        masses = {link.name: link.mass or 0.0 for link in self.robot.links}
        moments = {
            link.name: masses[link.name] * (place + rotation @ np.array(link.centre_of_mass))
            for link in self.robot.links
            for rotation, place in (frames[link.name],)
        }
        above = {joint.child: joint for joint in self.robot.joints}
        loads: dict[str, Array] = {}
        # Poses were found from the root outwards: from the tips inwards, masses and their moments (kg m) gather.
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
                    x, y, z = (moments[name] - masses[name] * origin).T
                    turn = np.stack([y * pull[2] - z * pull[1], z * pull[0] - x * pull[2], x * pull[1] - y * pull[0]], axis=1)
                    loads[joint.name] = np.einsum("ni,ni->n", axis, turn)
            masses[joint.parent] += masses[name]
            moments[joint.parent] = moments[joint.parent] + moments[name]
        return loads
