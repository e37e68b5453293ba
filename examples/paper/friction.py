"""Robots with other joint friction and damping, and joints that friction holds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from asrsim import Result
    from asrsim.robot.model import Robot

MOVED = 1e-6
"""Smallest range of positions that counts as a motion, rad."""


def with_joint_losses(robot: Robot, *, damping: float, friction: float) -> Robot:
    """Copy of the robot with this viscous damping (N m s/rad) and Coulomb friction (N m) in every joint."""
    joints = tuple(replace(joint, damping=damping, friction=friction) if joint.moves else joint for joint in robot.joints)
    return replace(robot, joints=joints)


@dataclass(frozen=True, kw_only=True)
class Held:
    """A joint that never moves because its spring is weaker than its friction."""

    joint: str
    torque: float
    """Largest torque of the spring on the link, N m."""
    friction: float
    """Coulomb friction of the joint, N m."""

    def __str__(self) -> str:
        springs = f"its springs give at most {self.torque:.4f} N m, less than the friction of {self.friction:g} N m"
        return f"friction holds {self.joint} at rest: {springs}"


def held_by_friction(result: Result) -> tuple[Held, ...]:
    """Joints that never move although their reference moves, because the spring torque stays below the friction."""
    found = []
    for name in result.joints:
        series = result[name]
        friction = result.run.robot.joint(name).friction
        torque = float(np.max(np.abs(series.link_torque)))
        still = np.ptp(series.link_position) < MOVED < np.ptp(series.reference_1)
        if still and torque < friction:
            found.append(Held(joint=name, torque=torque, friction=friction))
    return tuple(found)
