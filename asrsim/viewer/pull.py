"""Pulling by hand: a virtual spring between the user's hand and a point of a link or an object. The spring acts through torques
on the joints, or through a wrench on the body.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from asrsim.robot.dynamics import RobotModel
from asrsim.samples import Array, HeldWrench
from asrsim.viewer.stage import Pull

SPRING, LIMIT = 50.0, 20.0
"""SPRING: stiffness of the spring, N/m; LIMIT: largest force of the spring, N. The user can change the two values."""


@dataclass(frozen=True)
class Grip:
    """Point of a body that the user holds, and the position of the user's hand."""

    body: str
    """Name of the body: a link of the robot, or an object of the world."""
    point: tuple[float, float, float]
    """Held point in the frame of the body, m."""
    target: Array
    """Position of the hand in the world (3,), m."""

    @classmethod
    def at(cls, body: str, frame: Array, place: Array, target: Array) -> Grip:
        """Grip of a body. frame: frame (4, 4) of the body in the world; place: held point in the world (3,), m; target:
        position of the hand in the world (3,), m.
        """
        x, y, z = (frame[:3, :3].T @ (place - frame[:3, 3])).tolist()
        return cls(body, (x, y, z), target)

    def pull(self, place: Array, stiffness: float, limit: float) -> Pull:
        """Pull of the spring on the held point.

        place: position of the held point in the world (3,), m; stiffness: stiffness of the spring, N/m; limit: largest force of
        the spring, N.
        """
        force = stiffness * (self.target - place)
        size = float(np.linalg.norm(force))
        return Pull(place, self.target, force * (min(1.0, limit / size) if size > 0.0 else 0.0))

    def torques(self, model: RobotModel, positions: Array, stiffness: float, limit: float) -> tuple[Array, Pull]:
        """Torques (n,) in N m (N) on the model's joints with the same effect as the spring's pull on the link, and the pull.

        positions: positions (n,) of the model's joints, rad (m); stiffness: stiffness of the spring, N/m; limit: largest force
        of the spring, N.
        """
        place, _ = model.pose(positions, self.body, self.point)
        pull = self.pull(place, stiffness, limit)
        return model.jacobian(positions, self.body, self.point)[:3].T @ pull.force, pull

    def wrench(self, frame: Array, stiffness: float, limit: float) -> tuple[HeldWrench, Pull]:
        """Wrench on the body that has the same effect as the spring's pull, and the pull.

        frame: frame (4, 4) of the body in the world; stiffness: stiffness of the spring, N/m; limit: largest force of the
        spring, N.
        """
        pull = self.pull(frame[:3, 3] + frame[:3, :3] @ np.array(self.point), stiffness, limit)
        x, y, z = pull.force.tolist()
        return HeldWrench(self.body, (x, y, z), point=self.point), pull


def torques_by_joint(model: RobotModel, torques: Array) -> Mapping[str, float]:
    """Torques by name of the joint. torques: torques (n,) in the order of the model's joints."""
    return dict(zip(model.joints, torques.tolist(), strict=True))
