"""The interface of a robot model, as kinematics and learning use it. Engines provide models; tests bring their own."""

from __future__ import annotations

from typing import Protocol

from asrsim.samples import Array

Point = tuple[float, float, float]


class KinematicModel(Protocol):
    """Rigid-body model of a robot on its base with n movable joints; world frame, SI units."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the n joints, in the order of all arrays."""

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links that :meth:`pose` accepts."""

    @property
    def lower(self) -> Array:
        """(n,) lower stops in rad or m, -inf where there is none."""

    @property
    def upper(self) -> Array:
        """(n,) upper stops in rad or m, inf where there is none."""

    def pose(self, positions: Array, link: str, point: Point) -> tuple[Array, Array]:
        """Position (3,) in m of `point` (m, in the frame of `link`) and rotation (3, 3) of the link, in the world."""

    def jacobian(self, positions: Array, link: str, point: Point) -> Array:
        """(6, n): velocity of the point (rows 0 to 2) and angular velocity of the link (3 to 5) per joint velocity."""

    def gravity_torques(self, positions: Array) -> Array:
        """(n,) torques in N m that hold the robot at rest against gravity: G(q) of the paper's equation 1."""


class DynamicModel(Protocol):
    """The interface of a robot model for inverse dynamics and linearisation; n movable joints, SI units."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the n joints, in the order of all arrays."""

    def inverse_dynamics(self, positions: Array, velocities: Array, accelerations: Array) -> Array:
        """(k, n) N m, joint torques of the rigid, undamped robot in this motion; all arguments (k, n), one posture per row."""
