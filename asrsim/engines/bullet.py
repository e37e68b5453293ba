"""PyBullet behind the engine interface.

Without contacts, asrsim computes the step from Bullet's mass matrix and bias (`BulletEngine`). With contacts, Bullet computes
the step (`BulletContacts`). The MuJoCo engine and the PyBullet engine share only `asrsim.engines.rigid` and
`asrsim.engines.exact_friction`, which contain no data of the robot.

Bullet's step has friction and stops of joints among its constraints. It has no implicit damping, evaluates torques that depend
on velocity half a step late, and supports full kicks only. Additional joint torques, computed from mass matrix and bias, supply
the implicit damping and correct the late torques. If the first kick is shorter than a full kick, the velocities before it are
chosen so that a full kick ends with the right velocities. The damping torque is computed from the change of velocity that the
joints would have without contacts. If an input jumps, its mean over the kick acts.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from asrsim.engines.base import (
    DAMPING,
    FRICTION,
    GROUND,
    POSITION,
    ROBOT,
    TORQUE,
    VELOCITY,
    Scene,
    contact_forces,
    whole_kick,
)
from asrsim.engines.bullet_model import BulletDynamics, Client, make_body, make_shape
from asrsim.engines.exact_friction import STICKING
from asrsim.engines.rigid import (
    BEFORE,
    IMPLICITNESS,
    NOW,
    STEP,
    Calculation,
    RigidEngine,
    find_change,
    make_room,
)
from asrsim.errors import Problem, RobotError
from asrsim.robot.inertia import principal_axes
from asrsim.robot.merge import merge_for_engine
from asrsim.robot.meshes import usable_shapes
from asrsim.robot.model import Robot
from asrsim.robot.poses import quaternion, roll_pitch_yaw, rotation_matrix, rotation_of
from asrsim.samples import Array, HeldWrench
from asrsim.scenario.data import Scenario, WorldObject
from asrsim.versions import version

SOLVER_ITERATIONS, SOLVER_RESIDUAL = 500, 1e-18
"""SOLVER_ITERATIONS: largest number of iterations of the contact solver; SOLVER_RESIDUAL: residual at which the solver ends.
With Bullet's defaults (50 iterations, 1e-7), bodies and joints that should stick creep by 1e-4 m/s and 1e-3 rad/s; with these
limits they creep by 1e-9 m/s and 1e-5 rad/s. The limits cost little time, since most steps converge sooner."""
NO_LIMIT = 1e9
"""Position in rad or m of a stop that a joint lacks, and speed in rad/s at which Bullet clips the velocities of joints (by
default 100). It is so large that neither the stop nor the clipping ever acts."""
BEYOND = 1e-9
"""Distance in rad or m by which a joint that rests at a stop is beyond the stop."""
ARREST = 1e9
"""Largest torque in N m of the motor that stops a joint at its stop. No impact needs a larger torque."""
PARTS = (9, 7), (10, 11), (12, 13)
"""Indices into Bullet's contact points: (force in N, direction) of the normal force and of the two friction forces."""
UNDAMPED = {"linearDamping": 0, "angularDamping": 0}
"""Arguments that switch off Bullet's damping of a body."""


def find_torques(room: Any, push: Any, exchange: Any, forces: Any, lengths: Any) -> None:
    """Set `push` (v,) to the torques in N m of wrenches and joints, including damping, in a kick of one piece. Set
    `room.change` to the change of velocity that this kick would cause without contacts.

    This function runs as Python or compiled.
    """
    for i in range(room.freedoms):
        room.regime[i] = STICKING
        room.force[i] = push[i] = forces[0, i, 0]
    find_change(room, exchange, 0, lengths[0], True)
    for j in range(room.joints):
        i = room.joint_v[j]
        mean = room.velocity[i] + room.scheme[IMPLICITNESS] * room.change[i]
        push[i] += exchange[0, j, TORQUE] - exchange[0, j, DAMPING] * mean


class _Saved:
    """A saved state in Bullet's memory. Deleting this object removes the state. If the physics client has ended, the state is
    not removed, since another client may have the same number."""

    def __init__(self, client: Client) -> None:
        self.number, self._client = client.saveState(), client

    def __del__(self) -> None:
        if self._client.close.alive:
            self._client.removeState(self.number)


class BulletEngine(RigidEngine):
    """A robot in a world without contacts; PyBullet gives mass matrix and bias."""

    takes_weightless = True

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self.version = f"pybullet {version('pybullet')}"
        self.robot, self._scenario = robot, scenario
        self.joints = tuple(joint.name for joint in robot.moving_joints)
        merged, self.origin = merge_for_engine(robot, fixed_base=scenario.fixed_base)
        self._merged, self.root = merged.robot, merged.robot.root.name
        self._dynamics = BulletDynamics(scenario, merged.robot)
        count, base = len(self.joints), self._dynamics.free
        self._start = base + 1 if base else 0
        home = np.zeros(self._start + count)
        room = make_room(
            robot,
            qpos=np.zeros(len(home)),
            qvel=np.zeros(base + count),
            joint_q=range(self._start, len(home)),
            joint_v=range(base, base + count),
            free=bool(base),
            reduce=scenario.world.empty,
        )
        if base:
            x, y, z, w = quaternion(scenario.base_rpy)
            home[:3] = scenario.base_position + rotation_matrix(scenario.base_rpy) @ self.origin
            home[3:7] = w, x, y, z
        super().__init__(room, home, scenario=scenario)

    def look(self, wrenches: Array, forces: Array) -> None:
        """Compute mass matrix and bias of the room at its `qpos` and `qvel`."""
        room, dynamics, rotation = self._room, self._dynamics, self.rotation
        positions = dynamics.ordered(room.qpos[self._start :])
        room.full_matrix[:] = dynamics.matrix(positions, rotation)
        room.full_bias[:] = dynamics.bias(positions, room.qvel, rotation)

    def close(self) -> None:
        """Disconnect the physics client."""
        self._dynamics.close()


class BulletContacts(BulletEngine):
    """A robot in a world with contacts. Bullet computes the step, on a second physics client."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        _refuse_in_contacts(robot)
        super().__init__(scenario, robot)
        self._p = p = Client()
        world = scenario.world
        robot, self.warnings = usable_shapes(self._merged, package_paths=scenario.package_paths)
        joints, rotation = robot.outward_joints, rotation_matrix(scenario.base_rpy)
        self._body = make_body(
            p,
            robot,
            mass=0.0 if scenario.fixed_base else robot.root.mass or 0.0,
            shapes={one.name: make_shape(p, f"link '{one.name}'", one.collisions) for one in robot.links if one.collisions},
            basePosition=scenario.base_position + rotation @ self.origin,
            baseOrientation=quaternion(scenario.base_rpy),
        )
        self._axes = rotation_matrix(principal_axes(robot.root)[1])
        """Principal axes (3, 3) of the base's inertia in the frame of the base."""
        for index in range(-1, len(joints)):
            p.changeDynamics(self._body, index, **UNDAMPED, jointDamping=0, maxJointVelocity=NO_LIMIT, lateralFriction=1.0)
        for index, joint in enumerate(joints):
            if np.isfinite(joint.stops).any():
                lower, upper = np.clip(joint.stops, -NO_LIMIT, NO_LIMIT).tolist()
                p.changeDynamics(self._body, index, jointLowerLimit=lower, jointUpperLimit=upper)
        p.setGravity(*scenario.gravity)
        # If erp is 0, a stop removes a joint's velocity but does not push the joint back; see `_motors`.
        p.setPhysicsEngineParameter(numSolverIterations=SOLVER_ITERATIONS, solverResidualThreshold=SOLVER_RESIDUAL, erp=0.0)
        self._indices = [joints.index(joint) for joint in robot.moving_joints]
        self._bodies = {item.name: self._add_object(item) for item in world.solids}
        """Bullet's body number of the ground and of each object, by name."""
        if world.ground and scenario.fixed_base:
            # A fixed base often touches the ground on which it stands. Exclude the contact forces of this pair.
            p.setCollisionFilterPair(self._bodies[GROUND], self._body, -1, -1, 0)
        movable = [self._body, *(self._bodies[item.name] for item in world.objects)]
        self._poses = {number: p.getBasePositionAndOrientation(number) for number in movable}
        """Initial pose of the robot and of each object, by Bullet's body number."""
        self._before = np.zeros(len(self._room.qvel))
        """Velocities before the last kick."""
        self._pushed: tuple[HeldWrench, ...] = ()
        """Wrenches that are held on objects."""
        self._calculation = Calculation(find_torques, self._room)
        self._arrays = np.zeros(len(self._before)), np.zeros((1, len(self._indices), 6)), self._forces, np.ones(1)
        """Arguments of `find_torques`."""

    def _add_object(self, item: WorldObject) -> int:
        p = self._p
        shape = make_shape(p, f"object '{item.name}'", [item.solid])
        body = int(p.createMultiBody(item.mass, shape, -1, item.position, quaternion(item.rpy)))
        inertia = {} if item.inertia is None else {"localInertiaDiagonal": item.inertia}
        p.changeDynamics(body, -1, lateralFriction=item.friction, restitution=0.0, **UNDAMPED, **inertia)
        return body

    # -- stepping ---------------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Set Bullet's bodies to their initial states."""
        first, size = len(self._room.qpos), len(self._before)
        self._p.setTimeStep(self._room.scheme[STEP])
        for body, pose in self._poses.items():
            self._p.resetBasePositionAndOrientation(body, *pose)
        self._move_objects(np.zeros(3))
        self._room.qpos[:] = self._state[:first]
        self._place(self._state[first : first + size])
        self._read()
        self._before[:] = self._room.velocity

    def _move_objects(self, velocity: Array) -> None:
        """Give all movable objects the same linear velocity in m/s and no angular velocity."""
        for item in self._scenario.world.objects:
            if item.mass:
                self._p.resetBaseVelocity(self._bodies[item.name], velocity.tolist(), [0, 0, 0])

    def _place(self, velocities: Array) -> None:
        """Set the joints to the positions in the room, and all degrees of freedom to the velocities (v,)."""
        positions, rotation = self._room.qpos[self._start :].tolist(), self.rotation
        for index, position, velocity in zip(self._indices, positions, velocities[self._dynamics.free :].tolist(), strict=True):
            self._p.resetJointState(self._body, index, position, velocity)
        if rotation is not None:
            self._p.resetBaseVelocity(self._body, velocities[:3].tolist(), (rotation @ velocities[3:6]).tolist())

    def _read(self) -> None:
        """Read positions and velocities of the robot from Bullet into the room."""
        p, body, room, base = self._p, self._body, self._room, self._dynamics.free
        if self._indices:
            states = zip(*p.getJointStates(body, self._indices), strict=True)
            room.qpos[self._start :], room.velocity[base:], *_ = states
        if base:
            centre, principal = p.getBasePositionAndOrientation(body)
            # Multiply rotations as matrices, since Bullet multiplies quaternions in single precision.
            rotation = rotation_of(principal) @ self._axes.T
            x, y, z, w = quaternion(roll_pitch_yaw(rotation))
            room.qpos[: self._start] = *centre, w, x, y, z
            linear, angular = p.getBaseVelocity(body)
            room.velocity[:base] = *linear, *(angular @ rotation)
        self._state[: len(room.qpos)] = room.qpos

    def step(self, exchange: Array, wrenches: Array, lengths: Array) -> None:
        """Advance robot and world by one step; see `asrsim.engines.base.Engine`."""
        p, room, dynamics = self._p, self._room, self._dynamics
        loads, forces, fraction = whole_kick(exchange, wrenches, lengths)
        now, positions = room.velocity.copy(), room.qpos[self._start :]
        push, load, _, length = self._arrays
        load[0], length[0] = loads, fraction
        rotation = self.rotation
        room.qvel[:] = room.scheme[NOW] * now + room.scheme[BEFORE] * self._before if fraction == 1.0 else now
        if forces.size or self._held:
            self.map_wrenches(forces, self._forces)
        self.look(forces, self._forces)
        self._calculation(*self._arrays)
        targets, bounds = self._motors(loads[:, FRICTION], (now + room.change)[dynamics.free :])
        self._before[:] = now
        if fraction != 1.0:
            # Bullet supports only full kicks. Therefore choose initial velocities with which a full kick ends like this shorter
            # kick.
            self._before -= room.change
            self._place(now - (1.0 / fraction - 1.0) * room.change)
            self._move_objects((fraction - 1.0) * room.scheme[STEP] * np.array(self._scenario.gravity))
            self._read()
        push += dynamics.lift(dynamics.ordered(positions), rotation)
        # Bullet evaluates the bias at the velocities that it stores, not at the velocities at whole steps. Correct the
        # difference.
        push += dynamics.bias(dynamics.ordered(positions), room.velocity, rotation) - room.full_bias
        if self._indices:
            set_motors = partial(p.setJointMotorControlArray, self._body, self._indices)
            set_motors(p.VELOCITY_CONTROL, targetVelocities=targets.tolist(), forces=bounds.tolist())
            set_motors(p.TORQUE_CONTROL, forces=push[dynamics.free :].tolist())
        if rotation is not None:
            p.applyExternalForce(self._body, -1, push[:3].tolist(), room.qpos[:3].tolist(), p.WORLD_FRAME)
            p.applyExternalTorque(self._body, -1, (rotation @ push[3:6]).tolist(), p.WORLD_FRAME)
        for item in self._pushed:
            # Bullet's kick is a full kick, so reduce the force in proportion to the length of this shorter kick.
            self._push_object(item, fraction)
        p.stepSimulation()
        self._read()
        exchange[-1, :, POSITION] = positions
        exchange[-1, :, VELOCITY] = room.velocity[dynamics.free :]

    @property
    def holdable(self) -> tuple[str, ...]:
        """The robot's links and the movable objects."""
        return *super().holdable, *(item.name for item in self._scenario.world.objects if item.mass)

    def hold(self, wrenches: Sequence[HeldWrench]) -> None:
        """Hold wrenches on links and objects; see `asrsim.engines.base.Engine`."""
        super().hold(wrenches)
        self._pushed = tuple(one for one in wrenches if one not in self._held)

    def _push_object(self, wrench: HeldWrench, share: float) -> None:
        """Apply a fraction of a wrench to an object in the next step of Bullet."""
        p, body = self._p, self._bodies[wrench.body]
        centre, orientation = p.getBasePositionAndOrientation(body)
        force, arm = share * np.array(wrench.force), rotation_of(orientation) @ np.array(wrench.point)
        torque = share * np.array(wrench.torque) + np.cross(arm, force)
        p.applyExternalForce(body, -1, force.tolist(), centre, p.WORLD_FRAME)
        p.applyExternalTorque(body, -1, torque.tolist(), p.WORLD_FRAME)

    def _motors(self, friction: Array, ends: Array) -> tuple[Array, Array]:
        """Target velocities (n,) and largest torques (n,) of Bullet's velocity motors. With the target 0, a motor acts as
        Coulomb friction. If a joint would pass its stop in this step, its motor stops it at the stop, since Bullet's own stops
        act only on joints that are already beyond a stop.

        ends: velocities that the joints would have at the end of the step without contacts. With these velocities, no joint
        passes its stop.
        """
        room, step = self._room, float(self._room.scheme[STEP])
        speeds = np.array([ends, room.velocity[self._dynamics.free :]])
        reaches = (np.where(speeds > 0.0, room.upper, room.lower) - room.qpos[self._start :]) / step
        hits = (np.sign(reaches) * np.sign(speeds) > 0.0) & (np.abs(speeds) + BEYOND > np.abs(reaches))
        reach, stops = np.where(hits[0], *reaches), hits.any(axis=0)
        # With this target velocity the joint ends slightly beyond its stop, so that Bullet's stop acts in the next step and
        # later.
        targets = np.where(stops, reach + np.sign(reach) * BEYOND / step, 0.0)
        return targets, np.where(stops, ARREST, friction)

    @property
    def state(self) -> Any:
        """Bullet's saved state, and the velocities before the last kick."""
        return _Saved(self._p), self._before.copy()

    @state.setter
    def state(self, values: Any) -> None:
        saved, before = values
        self._p.restoreState(saved.number)
        self._before[:] = before
        self._read()

    # -- surroundings -----------------------------------------------------------------------------------------------

    def scene(self) -> Scene:
        """Poses of the world's objects, and of the base link if the base floats; and contact forces."""
        p, world, poses = self._p, self._scenario.world, dict(super().scene().bodies)
        for item in world.objects:
            position, orientation = p.getBasePositionAndOrientation(self._bodies[item.name])
            poses[item.name] = (*position, *orientation)
        names = {number: name for name, number in self._bodies.items()} | {self._body: ROBOT}
        # Read all points in one call. If one pair of bodies were requested, Bullet would reverse the normal forces but not the
        # friction.
        points = (
            (names[point[1]], names[point[2]], sum((point[i] * np.array(point[at]) for i, at in PARTS), np.zeros(3)))
            for point in p.getContactPoints() or ()
        )
        return Scene(poses, contact_forces(world, points))

    def close(self) -> None:
        """Disconnect the two physics clients: the client of the step, and the client of mass matrix and bias."""
        self._p.close()
        super().close()


def _refuse_in_contacts(robot: Robot) -> None:
    """Raise RobotError for coupled joints and rotors, which Bullet's own step cannot simulate."""
    hint = "engine: mujoco simulates it; a world without ground and objects also works in PyBullet"
    problems = [
        Problem(
            f"PyBullet cannot simulate {what} in a world with contacts",
            file=robot.path,
            line=joint.line,
            key=joint.name,
            hint=hint,
            code="engine-coupling",
        )
        for joint in robot.moving_joints
        for what, there in (
            ("a closed chain", robot.loops),
            ("a coupled joint", joint.mimic),
            ("the inertia of a rotor", joint.armature),
        )
        if there
    ]
    if problems:
        raise RobotError(problems)


def make(scenario: Scenario, robot: Robot) -> tuple[BulletEngine, tuple[Problem, ...]]:
    """The scenario's world in PyBullet, and warnings about ignored parts of the robot. Raises RobotError, SimulationError."""
    engine = (BulletEngine if scenario.world.empty else BulletContacts)(scenario, robot)
    return engine, engine.warnings
