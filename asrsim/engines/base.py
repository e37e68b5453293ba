"""What an engine is: joints with positions and velocities that take torques and step. It never hears of springs.

The hot loop calls `read`, `apply` and `advance` once a substep: an engine may bind the fastest callables it has to them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from asrsim.registry import Registry
from asrsim.samples import Array


class Engine(Protocol):
    """A world with one robot, stepped at a fixed step by semi-implicit Euler (or prescribed)."""

    joints: tuple[str, ...]
    """Moving joints; arrays and sequences below are in this order."""

    def read(self) -> Sequence[Any]:
        """One entry a joint, whose first two are position (rad) and velocity (rad/s)."""

    def apply(self, *, forces: Sequence[float]) -> None:
        """Torques (N m) for the next step, one a joint."""

    def advance(self) -> None:
        """One step."""

    def set_step(self, step: float) -> None:
        """Change the step, in s; before the first one."""

    def half_advance(self) -> None:
        """One step whose forces (gravity and friction; torques are the caller's) act with half their impulse."""

    def mass_matrix(self, positions: Sequence[float] | None = None) -> Array:
        """(n, n) kg m^2 at `positions`, the present ones if None."""

    def bias_difference(
        self, positions: Sequence[float], velocities: Sequence[float], others: Sequence[float]
    ) -> list[float] | None:
        """Coriolis and centrifugal torques at `velocities` less those at `others`, N m; None where they are always 0."""

    def gravity_torques(self, positions: Sequence[float] | None = None) -> Array:
        """(n,) N m that hold the robot still at `positions`."""

    def mechanical_energy(self) -> float:
        """Kinetic and gravitational energy of the robot's links in J (velocities as the engine has them)."""

    def apply_wrench(
        self, link: str, force: Sequence[float], torque: Sequence[float], point: Sequence[float], frame: str
    ) -> None:
        """A force (N) at `point` (m, link frame) and a torque (N m) on a link, for the next step."""

    def bodies(self) -> Mapping[str, tuple[float, ...]]:
        """Objects of the world, and the robot's root link if it floats: name -> (x, y, z, qx, qy, qz, qw)."""

    def contacts(self) -> Mapping[str, tuple[float, float, float]]:
        """ "object/other" -> contact force on the object in N, world frame, summed over points."""

    def close(self) -> None:
        """Release everything."""


ENGINES: Registry[Callable[..., Any]] = Registry("engine", entry_point_group="asrsim.engines")
"""Functions (scenario, robot) -> (engine, warnings); robot: with the scenario's modes and parameters in it."""
