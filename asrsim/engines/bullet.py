"""PyBullet behind the engine interface, set up so that its traps do not bite. The only module that imports pybullet.

Undamped unless asked, URDF inertia as in the file, true Coulomb friction of joints, no velocity clamp, no hidden motors.
Link damping is the loop's: Bullet's own is explicit and lags by half a step.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.engines.bullet_model import BulletModel
from asrsim.engines.bullet_world import BulletWorld
from asrsim.engines.foreign import crashes, quiet
from asrsim.errors import Problem, RobotError
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Vector, World, for_joint

NO_CLAMP = 1e9
"""rad/s: Bullet's clamp on joint velocities (100 by default) out of the way."""
SOLVER_ITERATIONS = 500
SOLVER_RESIDUAL = 1e-18
"""Bullet stops at 50 iterations or 1e-7: bodies and joints that should stick then creep, by 1e-4 m/s and 1e-3 rad/s. These
leave 1e-9 m/s and 1e-5 rad/s, and cost little, since most steps converge sooner."""


class BulletEngine:
    """A fresh physics client with one robot and its world. `step` in s is Bullet's step."""

    def __init__(
        self,
        robot: Robot,
        urdf: str,
        *,
        step: float,
        gravity: Vector = (0.0, 0.0, -9.81),
        base_position: Vector = (0.0, 0.0, 0.0),
        base_rpy: Vector = (0.0, 0.0, 0.0),
        fixed_base: bool = True,
        initial_positions: Mapping[str, float] | None = None,
        world: World | None = None,
        visuals: bool = False,
    ) -> None:
        with quiet():
            import pybullet

            self._p = pybullet
            self._client = pybullet.connect(pybullet.DIRECT)
        self.robot = robot
        self.step = step
        self.gravity = gravity
        self._fixed = fixed_base
        try:
            self._body = self._load(urdf, base_position, base_rpy, visuals)
            self._set_up(initial_positions or {})
            self._model = BulletModel(pybullet, self._client, self._body, self._indices, gravity=gravity, fixed=fixed_base)
            self._world = BulletWorld(pybullet, self._client, self._body, world or World(), fixed=fixed_base)
        except BaseException:
            self.close()
            raise
        p, client, body = self._p, self._client, self._body
        self.read: Callable[[], Sequence[Any]] = partial(p.getJointStates, body, self._indices, client)
        self.apply: Callable[..., None] = partial(
            p.setJointMotorControlArray, body, self._indices, p.TORQUE_CONTROL, physicsClientId=client
        )
        self.advance: Callable[[], None] = partial(p.stepSimulation, client)
        self.bias_difference = self._model.bias_difference

    # -- setting up -------------------------------------------------------------------------------------------------

    def _load(self, urdf: str, position: Vector, rpy: Vector, visuals: bool) -> int:
        p = self._p
        flags = p.URDF_USE_INERTIA_FROM_FILE
        if not visuals:
            flags |= p.URDF_IGNORE_VISUAL_SHAPES
        with tempfile.TemporaryDirectory(prefix="asrsim-") as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(urdf, encoding="utf-8")
            load = partial(
                p.loadURDF,
                str(path),
                basePosition=position,
                baseOrientation=p.getQuaternionFromEuler(rpy),
                useFixedBase=self._fixed,
                flags=flags,
                physicsClientId=self._client,
            )
            try:
                with quiet():
                    if "<mesh" in urdf and crashes(load):
                        message = "PyBullet crashes when it loads this robot; most likely a mesh is at fault"
                        raise RobotError(Problem(message=message, file=self.robot.path, code="engine-crash"))
                    return int(load())
            except p.error as error:
                raise RobotError(
                    Problem(message=f"PyBullet cannot load this robot ({error})", file=self.robot.path, code="engine-load")
                ) from error

    def _set_up(self, initial_positions: Mapping[str, float]) -> None:
        p, client, body = self._p, self._client, self._body
        p.setTimeStep(self.step, physicsClientId=client)
        p.setGravity(*self.gravity, physicsClientId=client)
        p.setPhysicsEngineParameter(
            numSolverIterations=SOLVER_ITERATIONS, solverResidualThreshold=SOLVER_RESIDUAL, physicsClientId=client
        )
        self.base = p.getBodyInfo(body, client)[0].decode()
        """Name of the root link."""
        self._link_index = {self.base: -1}
        index_of = {}
        for index in range(p.getNumJoints(body, client)):
            info = p.getJointInfo(body, index, client)
            index_of[info[1].decode()] = index
            self._link_index[info[12].decode()] = index
            p.changeDynamics(
                body, index, linearDamping=0, angularDamping=0, jointDamping=0, maxJointVelocity=NO_CLAMP,
                lateralFriction=1.0, physicsClientId=client,
            )  # fmt: skip
        p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, lateralFriction=1.0, physicsClientId=client)
        moving = self.robot.moving_joints
        self.joints = tuple(joint.name for joint in moving)
        self._indices = [index_of[joint.name] for joint in moving]
        self._frictions = [joint.friction for joint in moving]
        self._set_friction(1.0)
        for joint, index in zip(moving, self._indices, strict=True):
            position = float(for_joint(initial_positions, joint.name, 0.0))
            p.resetJointState(body, index, position, 0.0, physicsClientId=client)

    def _set_friction(self, fraction: float) -> None:
        """Velocity motors at target 0: with force 0 they free the joint, with a force they are its Coulomb friction."""
        p = self._p
        for index, friction in zip(self._indices, self._frictions, strict=True):
            p.setJointMotorControl2(
                self._body, index, p.VELOCITY_CONTROL, targetVelocity=0, force=friction * fraction, physicsClientId=self._client
            )

    # -- stepping ---------------------------------------------------------------------------------------------------

    def set_step(self, step: float) -> None:
        """Change the step; friction is issued anew, since Bullet stores it as an impulse."""
        self.step = step
        self._p.setTimeStep(step, physicsClientId=self._client)
        self._set_friction(1.0)

    def half_advance(self) -> None:
        """One step in which gravity and friction act with half their impulse."""
        p = self._p
        p.setGravity(*(0.5 * component for component in self.gravity), physicsClientId=self._client)
        self._set_friction(0.5)
        self.advance()
        p.setGravity(*self.gravity, physicsClientId=self._client)
        self._set_friction(1.0)

    def apply_wrench(
        self, link: str, force: Sequence[float], torque: Sequence[float], point: Sequence[float], frame: str
    ) -> None:
        """A force and torque on a link for the next step."""
        p, client, body, index = self._p, self._client, self._body, self._link_index[link]
        position, rotation, local = self._model.inertial_frame(index)
        push, turn = np.asarray(force, dtype=float), np.asarray(torque, dtype=float)
        if frame != "world":
            push, turn = rotation @ push, rotation @ turn
        # Bullet's link frame sits in the centre of mass; ours in the joint.
        turn = turn + np.cross(rotation @ (np.asarray(point, dtype=float) - np.asarray(local)), push)
        p.applyExternalForce(body, index, push.tolist(), position, p.WORLD_FRAME, physicsClientId=client)
        p.applyExternalTorque(body, index, turn.tolist(), p.WORLD_FRAME, physicsClientId=client)

    # -- the model and the world -------------------------------------------------------------------------------------

    def mass_matrix(self, positions: Sequence[float] | None = None) -> Array:
        """(n, n) mass matrix of the moving joints; that which torques meet while the base is free, if it floats."""
        return self._model.mass_matrix(positions)

    def gravity_torques(self, positions: Sequence[float] | None = None) -> Array:
        """(n,) torques that hold the robot still, on a base that is held."""
        return self._model.gravity_torques(positions)

    def mechanical_energy(self) -> float:
        """Kinetic and gravitational energy of the robot's links in J, on a base that is held."""
        return self._model.mechanical_energy()

    def link_point(self, link: str, point: Sequence[float], positions: Sequence[float]) -> tuple[Array, Array, Array]:
        """Forward kinematics of a point of a link: position (3,) m, rotation (3, 3), Jacobian (6, n), world frame.

        Moves the robot to `positions`: for models that are not being simulated.
        """
        return self._model.link_point(self._link_index[link], point, positions)

    def bodies(self) -> Mapping[str, tuple[float, ...]]:
        """Poses of the world's objects, and of the base link if it floats."""
        base = {} if self._fixed else {self.base: self._model.base_pose()}
        return base | self._world.poses()

    def contacts(self) -> Mapping[str, tuple[float, float, float]]:
        """Contact forces on the world's objects and on the robot by the ground."""
        return self._world.contacts()

    def close(self) -> None:
        """Disconnect the physics client."""
        with suppress(self._p.error), quiet():
            self._p.disconnect(self._client)
