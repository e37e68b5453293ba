"""What kinematics and learning ask of a robot model. The engines provide one; tests bring their own."""

from __future__ import annotations

from typing import Protocol

from asrsim.samples import Array

Point = tuple[float, float, float]


class KinematicModel(Protocol):
    """Rigid-body model of a robot on its base, n joints that move; world frame, SI units."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the n joints, in the order of all arrays."""

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links that :meth:`pose` knows."""

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
        """(n,) torques in N m that hold the robot still against gravity: G(q) of the paper's equation 1."""


class DynamicModel(Protocol):
    """What inverse dynamics and linearisation ask of a robot model; n joints that move, SI units."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the n joints, in the order of all arrays."""

    def inverse_dynamics(self, positions: Array, velocities: Array, accelerations: Array) -> Array:
        """(k, n) N m that move the rigid robot so, undamped; all arguments (k, n), one posture a row."""
