"""Pulling by hand: a spring pulls a point of a link or an object, by torques on the joints or by a wrench."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from asrsim.robot.dynamics import RobotModel
from asrsim.samples import Array, HeldWrench
from asrsim.viewer.stage import Pull

SPRING, LIMIT = 50.0, 20.0
"""Stiffness (N/m) and largest force (N) of the spring at first."""


@dataclass(frozen=True)
class Grip:
    """A point of a body that the user holds, and the position of the hand."""

    body: str
    """Link of the robot or object of the world."""
    point: tuple[float, float, float]
    """Point in the frame of the body, m."""
    target: Array
    """Position of the hand in the world (3,), m."""

    @classmethod
    def at(cls, body: str, frame: Array, place: Array, target: Array) -> Grip:
        """Grip at a place in the world (3,) m, on a body with this frame (4, 4)."""
        x, y, z = (frame[:3, :3].T @ (place - frame[:3, 3])).tolist()
        return cls(body, (x, y, z), target)

    def pull(self, place: Array, stiffness: float, limit: float) -> Pull:
        """Force (3,) on the point in N; `place`: position of the point in the world (3,), m.

        stiffness: stiffness of the spring, N/m; limit: largest force, N.
        """
        force = stiffness * (self.target - place)
        size = float(np.linalg.norm(force))
        return Pull(place, self.target, force * (min(1.0, limit / size) if size > 0.0 else 0.0))

    def torques(self, model: RobotModel, positions: Array, stiffness: float, limit: float) -> tuple[Array, Pull]:
        """Torques (n,) in N m (N) on the joints of the model at positions (n,), and the pull on a link that causes them."""
        place, _ = model.pose(positions, self.body, self.point)
        pull = self.pull(place, stiffness, limit)
        return model.jacobian(positions, self.body, self.point)[:3].T @ pull.force, pull

    def wrench(self, frame: Array, stiffness: float, limit: float) -> tuple[HeldWrench, Pull]:
        """Wrench on a body with this frame (4, 4), and its pull."""
        pull = self.pull(frame[:3, 3] + frame[:3, :3] @ np.array(self.point), stiffness, limit)
        x, y, z = pull.force.tolist()
        return HeldWrench(self.body, (x, y, z), point=self.point), pull


def torques_by_joint(model: RobotModel, torques: Array) -> Mapping[str, float]:
    """Torques (n,) by joint."""
    return dict(zip(model.joints, torques.tolist(), strict=True))
