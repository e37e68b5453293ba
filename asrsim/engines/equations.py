"""An engine from equations of motion: a user's class gives mass matrix and bias, and asrsim does the rest of a step."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from asrsim.engines.consistency import inconsistency
from asrsim.engines.rigid import RigidEngine, make_room
from asrsim.errors import Problem, RobotError, SimulationError
from asrsim.registry.engines import ENGINES
from asrsim.robot.dynamics import RobotModel
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.scenario.starts import start_positions

ROUNDING = 1e-8
"""Largest asymmetry of a mass matrix, relative to its largest entry, that counts as a rounding error."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)
NODES, WEIGHTS = 0.5 + 0.5 * NODES, 0.5 * WEIGHTS
"""NODES: points of Gauss's quadrature from 0 to 1; WEIGHTS: weights of these points."""
CONTRACT = "docs/architecture.md, 'An engine of your own', states what mass matrix and bias contain"
"""Hint for equations that contradict each other."""
NUDGE = 1e-6
"""Displacement of the joints for finite differences of the equations, rad (m)."""
REACH = {"prismatic": 1.0}
"""Distance in m from the initial position up to which the equations are tested, unless a stop is nearer. For other joints, this
distance is half a turn."""


class EquationEngine(RigidEngine):
    """Engine for robots on a fixed base in a world without ground and objects: M(q) dv/dt + b(q, v) = torques.

    A derived class defines `version`, `mass_matrix` and `bias`. The step has friction, stops, damping and wrenches as in all
    engines. Joints are in the order of `joints`: revolute joints in rad, prismatic joints in m. Write `mass_matrix` and `bias`
    as if no joint followed another joint (mimic) and no joint had a rotor; asrsim adds couplings and rotors.
    """

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        """Make the engine. Raises RobotError for a floating base, and for a world with ground or objects."""
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
        """Torques (n,), N m, that balance gravity, Coriolis and centrifugal forces at joint positions and velocities (n,).

        They may also balance springs and drag. At rest they are the gradient of an energy, and in motion they create no energy
        (`asrsim.engines.consistency`).
        """

    def test(self, scenario: Scenario) -> None:
        """Test the equations at the initial positions and at random positions between the stops. Raises RobotError with the
        fault."""
        start = np.array([*start_positions(scenario, self.robot).values()])
        self.checked(start, np.zeros_like(start))
        reach = np.array([REACH.get(joint.kind, math.pi) for joint in self.robot.moving_joints])
        room = self._room
        lower, upper = (np.clip(start + side * reach, room.lower, room.upper) for side in (-1.0, 1.0))
        fault = inconsistency(self.checked, self.joints, lower, upper)
        if fault is not None:
            raise RobotError([replace(fault, key=f"engine '{scenario.engine}' ({type(self).__name__})", hint=CONTRACT)])

    def checked(self, positions: Array, velocities: Array) -> tuple[Array, Array]:
        """Mass matrix (n, n) in kg m^2 and bias (n,) in N m at positions and velocities (n,). Raises RobotError if mass matrix
        or bias has another shape or is not valid.
        """
        matrix, bias, fault = self._equations(positions, velocities)
        if fault:
            at = f"at the positions {positions.tolist()}"
            at += f" and the velocities {velocities.tolist()}" if velocities.any() else ""
            raise RobotError([replace(fault, message=f"{fault.message}, {at}")])
        return matrix, bias

    def look(self, wrenches: Array, forces: Array) -> None:
        """Compute `full_matrix` and `full_bias` of the room."""
        room = self._room
        matrix, bias, fault = self._equations(room.qpos, room.qvel)
        if fault:
            at = f"at the positions {room.qpos.tolist()} and the velocities {room.qvel.tolist()}"
            raise SimulationError(f"{fault.key}: {fault.message}, {at}")
        room.full_matrix[:], room.full_bias[:] = matrix, bias

    def _equations(self, positions: Array, velocities: Array) -> tuple[Array, Array, Problem | None]:
        """Mass matrix, bias, and the fault that was found in the mass matrix or in the bias (None if the two are valid)."""
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
            message = (
                f"the engine's mass matrix must have the shape ({count}, {count}), and its bias must have the shape ({count},)"
            )
            fault = Problem(message, key=key, value=(matrix.shape, bias.shape), code="engine")
        elif not np.isfinite(bias).all():
            fault = Problem("the engine's bias is not finite", key=key, value=bias.tolist(), code="engine")
        elif not _is_positive(matrix):
            message = "the engine's mass matrix is not symmetric and positive definite"
            fault = Problem(message, key=key, value=matrix.tolist(), code="engine")
        return matrix, bias, fault


class EquationModel(RobotModel):
    """Model of a robot whose masses and forces come from the equations of an engine. Only the kinematics come from the robot's
    file.
    """

    of_file = False

    def __init__(self, engine: EquationEngine, scenario: Scenario, robot: Robot) -> None:
        super().__init__(robot, base_position=scenario.base_position, base_rpy=scenario.base_rpy, gravity=scenario.gravity)
        self._engine, self._scenario = engine, scenario

    def varied(self, robot: Robot) -> EquationModel:
        """Model of a robot whose links have other inertias. The new model gets a separate engine."""
        engine, _ = ENGINES.get(self._scenario.engine).make(self._scenario, robot)
        return EquationModel(engine, self._scenario, robot)

    def chain(self) -> None:
        """None, since the equations are not derived from the chain of the links."""

    def mass_matrix(self, positions: ArrayLike) -> Array:
        """Mass matrix (..., n, n) in kg m^2 (kg)."""
        q = self.couplings.expand(positions)
        return self.couplings.fold_matrix(self._equations(q)[0], q)

    def gravity_torques(self, positions: ArrayLike) -> Array:
        """Joint torques (..., n) in N m that hold the robot at rest."""
        q = self.couplings.expand(positions)
        return self.couplings.fold(self._equations(q)[1], q)

    def inverse_dynamics(self, positions: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike) -> Array:
        """Joint torques (..., n) in N m that give these accelerations at these positions and velocities."""
        q = self.couplings.expand(positions)
        v = self.couplings.expand_rates(velocities, q)
        a = self.couplings.expand_accelerations(accelerations, v, q)
        matrices, biases = self._equations(q, np.broadcast_to(v, q.shape))
        return self.couplings.fold((matrices @ a[..., None])[..., 0] + biases, q)

    def gravity_stiffness(self, positions: Array) -> tuple[Array, Array]:
        """`gravity_torques` (..., n), and their change per displacement of each joint, (..., n, n), in N m/rad."""
        size = positions.shape[-1]
        torques = self.gravity_torques(positions[..., None, :] + NUDGE * np.vstack([np.zeros(size), np.eye(size)]))
        return torques[..., 0, :], (torques[..., 1:, :] - torques[..., :1, :]) / NUDGE

    def energies(self, positions: ArrayLike, velocities: ArrayLike) -> tuple[Array, Array]:
        """Kinetic energy and potential energy in J at positions (n,) and velocities (n,). The potential energy is the work
        against gravity on a straight path from position 0, integrated in parts of at most 1 rad (m).
        """
        q = self.couplings.expand(positions)
        v = self.couplings.expand_rates(velocities, q)
        matrix, _ = self._equations(q)
        parts = max(1, math.ceil(np.abs(q).max(initial=0.0)))
        shares = ((np.arange(parts)[:, None] + NODES) / parts).ravel()
        potential = np.tile(WEIGHTS / parts, parts) @ self._equations(shares[:, None] * q)[1] @ q
        return np.asarray(0.5 * v @ matrix @ v), np.asarray(potential)

    def _equations(self, q: Array, v: Array | None = None) -> tuple[Array, Array]:
        """Mass matrices (..., n, n) with rotors, and biases (..., n), without couplings. v: velocities (..., n); None: at
        rest."""
        n = q.shape[-1]
        rows = zip(q.reshape(-1, n), np.zeros_like(q).reshape(-1, n) if v is None else v.reshape(-1, n), strict=True)
        matrices, biases = (np.array(one) for one in zip(*(self._engine.checked(*row) for row in rows), strict=True))
        return matrices.reshape(*q.shape, n) + np.diag(self._armature[self._at]), biases.reshape(q.shape)


def _is_positive(matrix: Array) -> bool:
    """Whether a matrix is positive definite, and symmetric up to rounding errors."""
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return bool(np.abs(matrix - matrix.T).max(initial=0.0) <= ROUNDING * np.abs(matrix).max(initial=0.0))
