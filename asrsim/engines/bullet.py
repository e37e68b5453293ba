"""PyBullet behind the engine interface, set up so that its traps do not bite. The only module that imports pybullet.

Undamped unless asked, URDF inertia as in the file, true Coulomb friction of joints, no velocity clamp, no hidden motors.
Link damping is the loop's: Bullet's own is explicit and lags by half a step.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from operator import sub
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.engines.base import Array
from asrsim.engines.foreign import crashes, quiet
from asrsim.errors import Problem, RobotError, SimulationError
from asrsim.robot.model import Robot
from asrsim.scenario.data import Vector, World, WorldObject

NO_CLAMP = 1e9
"""rad/s: Bullet's clamp on joint velocities (100 by default) out of the way."""
SOLVER_ITERATIONS = 500
SOLVER_RESIDUAL = 1e-18
"""Bullet stops at 50 iterations or 1e-7: bodies and joints that should stick then creep, by 1e-4 m/s and 1e-3 rad/s. These
leave 1e-9 m/s and 1e-5 rad/s, and cost little, since most steps converge sooner."""
GROUND_SIZE = 100.0
"""m: edge of the box that is the ground; a plane's contact forces jump."""


def _product(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float, float]:
    """Product of quaternions (x, y, z, w); Bullet's own works in single precision."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


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
            self._objects: dict[str, int] = {}
            self._ground: int | None = None
            self._build_world(world or World())
        except BaseException:
            self.close()
            raise
        p, client, body = self._p, self._client, self._body
        self.read: Callable[[], Sequence[Any]] = partial(p.getJointStates, body, self._indices, client)
        self.apply: Callable[..., None] = partial(
            p.setJointMotorControlArray, body, self._indices, p.TORQUE_CONTROL, physicsClientId=client
        )
        self.advance: Callable[[], None] = partial(p.stepSimulation, client)
        # The client by name: the fifth argument is one for flags.
        self._inverse = partial(p.calculateInverseDynamics, body, physicsClientId=client)

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
        # Bullet's dynamics routines count degrees of freedom in the order of its links, which need not be the file's.
        self._to_bullet = sorted(range(len(moving)), key=self._indices.__getitem__)
        self._from_bullet = [self._to_bullet.index(j) for j in range(len(moving))]
        self._same_order = self._to_bullet == list(range(len(moving)))
        self._frictions = [joint.friction for joint in moving]
        self._moving = moving
        self._set_friction(1.0)
        for joint, index in zip(moving, self._indices, strict=True):
            position = float(initial_positions.get(joint.name, initial_positions.get("*", 0.0)))
            p.resetJointState(body, index, position, 0.0, physicsClientId=client)

    def _set_friction(self, fraction: float) -> None:
        """Velocity motors at target 0: with force 0 they free the joint, with a force they are its Coulomb friction."""
        p = self._p
        for index, friction in zip(self._indices, self._frictions, strict=True):
            p.setJointMotorControl2(
                self._body, index, p.VELOCITY_CONTROL, targetVelocity=0, force=friction * fraction, physicsClientId=self._client
            )

    def _build_world(self, world: World) -> None:
        p, client = self._p, self._client
        if world.ground:
            half = GROUND_SIZE / 2
            shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[half, half, half], physicsClientId=client)
            self._ground = p.createMultiBody(0, shape, basePosition=[0, 0, world.ground_height - half], physicsClientId=client)
            p.changeDynamics(self._ground, -1, lateralFriction=world.ground_friction, restitution=0.0, physicsClientId=client)
            if self._fixed:
                # A base that stands on the ground must not push against it.
                p.setCollisionFilterPair(self._ground, self._body, -1, -1, 0, physicsClientId=client)
        for item in world.objects:
            self._objects[item.name] = self._add_object(item)

    def _add_object(self, item: WorldObject) -> int:
        p, client = self._p, self._client
        if item.shape == "box":
            arguments: dict[str, Any] = {"shapeType": p.GEOM_BOX, "halfExtents": [edge / 2 for edge in item.size]}
        elif item.shape == "sphere":
            arguments = {"shapeType": p.GEOM_SPHERE, "radius": item.size[0]}
        elif item.shape == "cylinder":
            arguments = {"shapeType": p.GEOM_CYLINDER, "radius": item.size[0], "height": item.size[1]}
        else:
            arguments = {"shapeType": p.GEOM_MESH, "fileName": str(item.mesh), "meshScale": list(item.size or (1, 1, 1))}
        try:
            shape = p.createCollisionShape(**arguments, physicsClientId=client)
        except p.error as error:
            raise SimulationError(f"object '{item.name}': PyBullet cannot make its shape ({error})") from error
        body = int(
            p.createMultiBody(
                item.mass, shape, basePosition=item.position, baseOrientation=p.getQuaternionFromEuler(item.rpy),
                physicsClientId=client,
            )
        )  # fmt: skip
        p.changeDynamics(
            body, -1, lateralFriction=item.friction, restitution=item.restitution, linearDamping=0, angularDamping=0,
            physicsClientId=client,
        )  # fmt: skip
        if item.inertia is not None:
            p.changeDynamics(body, -1, localInertiaDiagonal=item.inertia, physicsClientId=client)
        return body

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
        position, rotation, local = self._inertial_frame(index)
        push, turn = np.asarray(force, dtype=float), np.asarray(torque, dtype=float)
        if frame != "world":
            push, turn = rotation @ push, rotation @ turn
        # Bullet's link frame sits in the centre of mass; ours in the joint.
        turn = turn + np.cross(rotation @ (np.asarray(point, dtype=float) - np.asarray(local)), push)
        p.applyExternalForce(body, index, push.tolist(), position, p.WORLD_FRAME, physicsClientId=client)
        p.applyExternalTorque(body, index, turn.tolist(), p.WORLD_FRAME, physicsClientId=client)

    def _inertial_frame(self, index: int) -> tuple[Any, Array, Any]:
        """World position of a link's centre of mass, rotation (3, 3) of its URDF frame, centre of mass in that frame.

        With matrices: Bullet's own transforms of vectors and quaternions work in single precision.
        """
        p, client, body = self._p, self._client, self._body
        dynamics = p.getDynamicsInfo(body, index, client)
        if index == -1:
            position, inertial = p.getBasePositionAndOrientation(body, client)
            return position, self._matrix(inertial) @ self._matrix(dynamics[4]).T, dynamics[3]
        state = p.getLinkState(body, index, 0, 1, client)
        return state[0], self._matrix(state[5]), state[2]

    # -- the model --------------------------------------------------------------------------------------------------

    def _positions(self) -> list[float]:
        return [state[0] for state in self.read()]

    def _ordered(self, values: Sequence[float]) -> list[float]:
        """`values` of the moving joints in Bullet's order."""
        return list(values) if self._same_order else [values[j] for j in self._to_bullet]

    def mass_matrix(self, positions: Sequence[float] | None = None) -> Array:
        """(n, n) mass matrix of the moving joints; that which torques meet while the base is free, if it floats."""
        values = self._ordered(self._positions() if positions is None else positions)
        matrix = np.array(self._p.calculateMassMatrix(self._body, values, physicsClientId=self._client), dtype=float)
        n = len(self.joints)
        if not self._fixed:
            # The base takes part in every motion: its six rows are eliminated.
            base, cross = matrix[:6, :6], matrix[:6, 6:]
            matrix = matrix[6:, 6:] - cross.T @ np.linalg.solve(base, cross)
        return matrix[-n:, -n:][np.ix_(self._from_bullet, self._from_bullet)]

    def bias_difference(
        self, positions: Sequence[float], velocities: Sequence[float], others: Sequence[float]
    ) -> list[float] | None:
        """Velocity torques at `velocities` less those at `others`; None for one joint or a floating base."""
        n = len(self.joints)
        if n < 2 or not self._fixed:
            return None
        zero = [0.0] * n
        if self._same_order:
            return list(map(sub, self._inverse(positions, velocities, zero), self._inverse(positions, others, zero)))
        here = self._inverse(self._ordered(positions), self._ordered(velocities), zero)
        there = self._inverse(self._ordered(positions), self._ordered(others), zero)
        return [here[k] - there[k] for k in self._from_bullet]

    def gravity_torques(self, positions: Sequence[float] | None = None) -> Array:
        """(n,) torques that hold the robot still, on a base that is held; Bullet's routine ignores the base's orientation, so
        gravity is turned."""
        p, client = self._p, self._client
        values = self._ordered(self._positions() if positions is None else positions)
        turned = self._inertial_frame(-1)[1].T @ np.array(self.gravity)
        if self._fixed:
            zero = [0.0] * len(values)
        else:
            zero = [0.0] * (len(values) + 6)
            values = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, *values]
        p.setGravity(*turned.tolist(), physicsClientId=client)
        try:
            torques = np.array(p.calculateInverseDynamics(self._body, values, zero, zero, physicsClientId=client), dtype=float)
            return torques[-len(self.joints) :][self._from_bullet]
        finally:
            p.setGravity(*self.gravity, physicsClientId=client)

    def mechanical_energy(self) -> float:
        """Kinetic and gravitational energy of the robot's links in J."""
        p, client, body = self._p, self._client, self._body
        states = self.read()
        velocities = np.array([state[1] for state in states])
        energy = 0.5 * float(velocities @ self.mass_matrix([state[0] for state in states]) @ velocities)
        for index in range(p.getNumJoints(body, client)):
            mass = p.getDynamicsInfo(body, index, client)[0]
            if mass:
                position = p.getLinkState(body, index, 0, 1, client)[0]
                energy -= mass * sum(g * x for g, x in zip(self.gravity, position, strict=True))
        return energy

    def link_point(self, link: str, point: Sequence[float], positions: Sequence[float]) -> tuple[Array, Array, Array]:
        """Forward kinematics of a point of a link: position (3,) m, rotation (3, 3), Jacobian (6, n), world frame.

        Moves the robot to `positions`: for models that are not being simulated.
        """
        p, client, body = self._p, self._client, self._body
        for index, value in zip(self._indices, positions, strict=True):
            p.resetJointState(body, index, value, 0.0, physicsClientId=client)
        index = self._link_index[link]
        at = np.asarray(point, dtype=float)
        if index == -1:
            centre, rotation, local = self._inertial_frame(index)
            return np.asarray(centre) + rotation @ (at - np.asarray(local)), rotation, np.zeros((6, len(self.joints)))
        state = p.getLinkState(body, index, 0, 1, client)
        rotation = self._matrix(state[5])
        # Bullet takes the point along the inertia's axes, but from the link's own origin, and answers in the frame of the
        # base's inertia; its manual says otherwise. The tests hold this against differences of poses.
        turned = self._matrix(p.getDynamicsInfo(body, index, client)[4]).T @ at
        zero = [0.0] * len(self.joints)
        linear, angular = p.calculateJacobian(
            body, index, turned.tolist(), self._ordered(positions), zero, zero, physicsClientId=client
        )
        base = self._matrix(p.getBasePositionAndOrientation(body, client)[1])
        jacobian = np.vstack([base @ np.array(linear, dtype=float), base @ np.array(angular, dtype=float)])
        jacobian = jacobian[:, -len(self.joints) :][:, self._from_bullet]
        return np.array(state[4]) + rotation @ at, rotation, jacobian

    def _matrix(self, quaternion: Sequence[float]) -> Array:
        return np.array(self._p.getMatrixFromQuaternion(quaternion), dtype=float).reshape(3, 3)

    # -- the world --------------------------------------------------------------------------------------------------

    def bodies(self) -> Mapping[str, tuple[float, ...]]:
        """Poses of the world's objects, and of the base link if it floats."""
        p, client = self._p, self._client
        poses = {}
        if not self._fixed:
            centre, rotation, local = self._inertial_frame(-1)
            x, y, z, w = p.getDynamicsInfo(self._body, -1, client)[4]
            turned = p.getBasePositionAndOrientation(self._body, client)[1]
            poses[self.base] = (*(centre - rotation @ np.asarray(local)).tolist(), *_product(turned, (-x, -y, -z, w)))
        for name, body in self._objects.items():
            position, orientation = p.getBasePositionAndOrientation(body, client)
            poses[name] = (*position, *orientation)
        return poses

    def contacts(self) -> Mapping[str, tuple[float, float, float]]:
        """Contact forces on the world's objects and on the robot by the ground."""
        p, client = self._p, self._client
        names = {body: name for name, body in self._objects.items()}
        if self._ground is not None:
            names[self._ground] = "ground"
        forces: dict[str, tuple[float, float, float]] = {}
        for body, name in names.items():
            if name != "ground":
                for other, other_name in [*names.items(), (self._body, "robot")]:
                    if other != body:
                        forces[f"{name}/{other_name}"] = self._force(p.getContactPoints(body, other, physicsClientId=client))
        if self._ground is not None:
            forces["robot/ground"] = self._force(p.getContactPoints(self._body, self._ground, physicsClientId=client))
        return forces

    @staticmethod
    def _force(points: Any) -> tuple[float, float, float]:
        total = np.zeros(3)
        for point in points or ():
            total += point[9] * np.array(point[7])
            total += point[10] * np.array(point[11])
            total += point[12] * np.array(point[13])
        return float(total[0]), float(total[1]), float(total[2])

    def close(self) -> None:
        """Disconnect the physics client."""
        with suppress(self._p.error), quiet():
            self._p.disconnect(self._client)
