"""An engine from equations of motion: a user's class gives mass matrix and bias, and asrsim does the rest of a step."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from asrsim.engines.rigid import RigidEngine, make_room
from asrsim.errors import Problem, RobotError, SimulationError
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

ROUNDING = 1e-8
"""Largest asymmetry of a mass matrix, relative to its largest entry, that counts as a rounding error."""


class EquationEngine(RigidEngine):
    """Engine for robots on a fixed base in a world without ground and objects: M(q) dv/dt + b(q, v) = torques.

    A derived class defines `version`, `mass_matrix` and `bias`. The step has friction, stops, damping and wrenches as in all
    engines. Joints are in the order of `joints`: revolute joints in rad, prismatic joints in m. Joints that follow others, and
    rotors, are added to the equations, which treat each joint as free and without a rotor.
    """

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        """Raises RobotError for a floating base, and for a world with ground or objects."""
        if not scenario.fixed_base or not scenario.world.empty:
            message = f"the engine '{scenario.engine}' needs a fixed base and a world without ground and objects"
            raise RobotError(message, file=robot.path, code="engine")
        self.robot, self.joints = robot, tuple(joint.name for joint in robot.moving_joints)
        count = len(self.joints)
        room = make_room(
            robot, qpos=np.zeros(count), qvel=np.zeros(count), joint_q=range(count), joint_v=range(count), free=False
        )
        super().__init__(room, np.zeros(count), scenario=scenario)

    @abstractmethod
    def mass_matrix(self, positions: Array) -> ArrayLike:
        """Symmetric mass matrix (n, n), kg m^2, at the joint positions (n,)."""

    @abstractmethod
    def bias(self, positions: Array, velocities: Array) -> ArrayLike:
        """Torques (n,), N m, that balance gravity, Coriolis and centrifugal forces at joint positions and velocities (n,)."""

    def begin(self) -> None:
        """Check what the equations give at the start. Raises RobotError."""
        count = len(self.joints)
        _, _, fault = self._equations(self._state[:count], np.zeros(count))
        if fault:
            raise RobotError([fault])

    def look(self, wrenches: Array, forces: Array) -> None:
        """Compute `full_matrix` and `full_bias` of the room."""
        room = self._room
        matrix, bias, fault = self._equations(room.qpos, room.qvel)
        if fault:
            at = f"at the positions {room.qpos.tolist()} and the velocities {room.qvel.tolist()}"
            raise SimulationError(f"{fault.key}: {fault.message}, {at}")
        room.full_matrix[:], room.full_bias[:] = matrix, bias

    def _equations(self, positions: Array, velocities: Array) -> tuple[Array, Array, Problem | None]:
        """Mass matrix, bias, and the fault that was found in them (None if they are valid)."""
        count, key = len(self.joints), type(self).__name__
        positions, velocities = positions.copy(), velocities.copy()
        positions.flags.writeable = velocities.flags.writeable = False
        found = self.mass_matrix(positions), self.bias(positions, velocities)
        try:
            matrix, bias = (np.asarray(one, dtype=float) for one in found)
        except (TypeError, ValueError):
            message = "the engine's mass matrix and its bias must be arrays of numbers"
            return np.empty(0), np.empty(0), Problem(message, key=key, value=found, code="engine")
        fault = None
        if matrix.shape != (count, count) or bias.shape != (count,):
            message = f"the engine's mass matrix must have the shape ({count}, {count}), its bias ({count},)"
            fault = Problem(message, key=key, value=(matrix.shape, bias.shape), code="engine")
        elif not np.isfinite(bias).all():
            fault = Problem("the engine's bias is not finite", key=key, value=bias.tolist(), code="engine")
        elif not _is_positive(matrix):
            message = "the engine's mass matrix is not symmetric and positive definite"
            fault = Problem(message, key=key, value=matrix.tolist(), code="engine")
        return matrix, bias, fault


def _is_positive(matrix: Array) -> bool:
    """Whether a matrix is symmetric, but for rounding errors, and positive definite."""
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return bool(np.abs(matrix - matrix.T).max(initial=0.0) <= ROUNDING * np.abs(matrix).max(initial=0.0))
