"""Touch: a spring pulls a point of a link, by torques on the joints through the Jacobian."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from asrsim.robot.dynamics import RobotModel
from asrsim.samples import Array
from asrsim.viewer.stage import Pull

SPRING, LIMIT = 50.0, 20.0
"""Stiffness (N/m) and largest force (N) of the spring at first."""


@dataclass(frozen=True)
class Grip:
    """A held point of a link, and where the hand is."""

    link: str
    point: tuple[float, float, float]
    """Point in the frame of the link, m."""
    target: Array
    """Position of the hand in the world (3,), m."""

    @classmethod
    def at(cls, link: str, frame: Array, place: Array, target: Array) -> Grip:
        """Grip at a place in the world (3,) m, on a link with this frame (4, 4)."""
        x, y, z = (frame[:3, :3].T @ (place - frame[:3, 3])).tolist()
        return cls(link, (x, y, z), target)

    def pulled(self, model: RobotModel, positions: Array, stiffness: float, limit: float) -> tuple[Array, Pull]:
        """Torques (n,) in N m (N) on the joints of the model at positions (n,), and the pull that causes them.

        stiffness: stiffness of the spring, N/m; limit: largest force, N.
        """
        place, _ = model.pose(positions, self.link, self.point)
        force = stiffness * (self.target - place)
        size = float(np.linalg.norm(force))
        force *= min(1.0, limit / size) if size > 0.0 else 0.0
        torques = model.jacobian(positions, self.link, self.point)[:3].T @ force
        return torques, Pull(place, self.target, force)


def torques_by_joint(model: RobotModel, torques: Array) -> Mapping[str, float]:
    """Torques (n,) by joint."""
    return dict(zip(model.joints, torques.tolist(), strict=True))
