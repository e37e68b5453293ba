"""An engine from equations of motion: a user's class gives mass matrix and bias, and asrsim does the rest of a step."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from asrsim.engines.rigid import RigidEngine, make_room
from asrsim.errors import RobotError, SimulationError
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario


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
        count, positions = len(self.joints), self._state[: len(self.joints)]
        matrix = np.asarray(self.mass_matrix(positions.copy()), dtype=float)
        bias = np.asarray(self.bias(positions.copy(), np.zeros(count)), dtype=float)
        if matrix.shape != (count, count) or bias.shape != (count,):
            message = f"the engine's mass matrix must have the shape ({count}, {count}), its bias ({count},)"
            raise RobotError(message, key=type(self).__name__, value=(matrix.shape, bias.shape), code="engine")
        if not np.isfinite(bias).all():
            message = "the engine's bias is not finite at the start"
            raise RobotError(message, key=type(self).__name__, value=bias.tolist(), code="engine")
        if not np.allclose(matrix, matrix.T) or not (np.linalg.eigvalsh(matrix) > 0.0).all():
            message = "the engine's mass matrix is not symmetric and positive definite at the start"
            raise RobotError(message, key=type(self).__name__, value=matrix.tolist(), code="engine")

    def look(self, wrenches: Array, forces: Array) -> None:
        """Compute `full_matrix` and `full_bias` of the room."""
        room = self._room
        room.full_matrix[:] = self.mass_matrix(room.qpos.copy())
        room.full_bias[:] = self.bias(room.qpos.copy(), room.qvel.copy())
        if not np.isfinite(room.full_matrix).all() or not np.isfinite(room.full_bias).all():
            at = f"at the positions {room.qpos.tolist()} and the velocities {room.qvel.tolist()}"
            raise SimulationError(f"{type(self).__name__}: mass matrix or bias of the engine is not finite {at}")
