"""Where a single joint must come to rest, and how it must swing there: from the law and the URDF alone, without an engine."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators import ACTUATORS

if TYPE_CHECKING:
    from asrsim.robot.model import Joint, Robot

GRAVITY = 9.81
"""m/s^2."""


@dataclass(frozen=True, kw_only=True)
class Rest:
    """A joint's equilibrium under gravity with its motors held."""

    position: float
    """rad."""
    spring: float
    """N m/rad, the spring's own slope there."""
    slope: float
    """N m/rad, with the slope of gravity."""
    inertia: float
    """kg m^2 about the axis."""
    damping: float
    """N m s/rad."""
    lowest: float
    """rad, least position at which the joint's friction still holds it."""
    highest: float
    """rad, largest such position."""

    def outside(self, position: float) -> float:
        """rad by which a position lies outside of what friction can hold; 0 inside."""
        return max(self.lowest - position, position - self.highest, 0.0)

    @property
    def natural(self) -> float:
        """rad/s, sqrt(slope / inertia)."""
        return math.sqrt(self.slope / self.inertia)

    @property
    def decay(self) -> float:
        """1/s, damping / (2 inertia)."""
        return self.damping / (2.0 * self.inertia)

    @property
    def frequency(self) -> float:
        """Hz, of the undamped small oscillation."""
        return self.natural / (2.0 * math.pi)


def rest(robot: Robot, equilibrium: float, preset: float) -> Rest:
    """Where the robot's one joint rests when its motors are held at an equilibrium (rad) and a preset (rad; adjuster: m).

    Roots of spring torque minus weight (and plus or minus the joint's friction), by Brent's method.
    """
    from scipy.optimize import brentq

    (joint,) = robot.moving_joints
    (block,) = robot.actuators
    actuator = ACTUATORS.get(block.actuator)
    values = block.values()
    spring = tuple(values[parameter.name] for parameter in actuator.parameters)
    motors = actuator.motor_references(equilibrium, preset)
    weight, inertia = _load(robot, joint)

    def excess(q: float) -> float:
        return sum(actuator.elastic_torques(q, *motors, spring)) - weight * math.sin(q)

    def root(surplus: float) -> float:
        return float(brentq(lambda q: excess(q) - surplus, -0.5 * math.pi, 0.5 * math.pi, xtol=1e-15, rtol=1e-14))

    position = root(0.0)
    stiffness = actuator.stiffness(position, *motors, spring)
    return Rest(
        position=position,
        spring=stiffness,
        slope=stiffness + weight * math.cos(position),
        inertia=inertia,
        damping=joint.damping,
        lowest=root(joint.friction),
        highest=root(-joint.friction),
    )


def _load(robot: Robot, joint: Joint) -> tuple[float, float]:
    """m g l (N m) and the inertia about the axis (kg m^2) of a link that hangs straight down at q = 0."""
    link = next(link for link in robot.links if link.name == joint.child)
    mass = link.mass or 0.0
    axis = np.array(joint.axis)
    arm = np.array(link.centre_of_mass)
    arm = arm - axis * (arm @ axis)
    ixx, ixy, ixz, iyy, iyz, izz = link.inertia or (0.0,) * 6
    tensor = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    return mass * GRAVITY * float(np.linalg.norm(arm)), mass * float(arm @ arm) + float(axis @ tensor @ axis)
