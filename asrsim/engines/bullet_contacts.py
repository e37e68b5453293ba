"""PyBullet's own step, in a world with contacts: friction and stops of joints are among Bullet's constraints.

Bullet's step has no implicit damping, evaluates velocity torques half a step late, and supports full kicks only. Additional
joint torques correct this; they are computed from the mass matrix and the bias of `asrsim.engines.bullet_model.BulletModel`.
For a first kick that is shorter than a full kick, the velocities are set back beforehand. The damping torque is computed from
the change of velocity that the joints would have without contacts. If an input jumps, its mean over the kick acts.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any
from weakref import finalize

import numpy as np

from asrsim.engines.base import DAMPING, FRICTION, POSITION, TORQUE, VELOCITY, Scene, whole_kick
from asrsim.engines.bullet_loading import connect, free_of_losses, load_body, set_inertias
from asrsim.engines.bullet_model import BASE, BulletModel, inertial_frame, places_of
from asrsim.engines.bullet_world import BulletWorld
from asrsim.engines.rigid import IMPLICITNESS, Calculation, find_change, make_room
from asrsim.robot import engine_urdf
from asrsim.robot.merge import merge_fixed
from asrsim.robot.model import Robot
from asrsim.robot.poses import quaternion, roll_pitch_yaw
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.versions import version

SOLVER_ITERATIONS, SOLVER_RESIDUAL = 500, 1e-18
"""Limits of the contact solver. With Bullet's defaults (50 iterations, 1e-7), bodies and joints that should stick creep by 1e-4
m/s and 1e-3 rad/s; with these limits by 1e-9 m/s and 1e-5 rad/s. The cost is small, since most steps converge sooner."""
BEYOND = 1e-9
"""Distance by which a joint that rests on its stop is beyond the stop, rad or m."""
REACH = 2.0
"""A stop counts as near if the joint, moving 1 rad/s faster than now, could reach the stop within this number of steps."""
ARREST = 1e9
"""Largest torque in N m of the motor that stops a joint at its stop; larger than the torque of any impact."""


def find_torques(room: Any, push: Any, exchange: Any, forces: Any, lengths: Any) -> None:
    """Set `push` (v,) to the torques of wrenches and joints in N m, with damping, in a kick of one piece. The function sets
    `change` of the room to the change of velocity in a step without contacts.

    This function runs as Python or compiled.
    """
    for i in range(len(room.regime)):
        room.regime[i] = 0
        room.force[i] = push[i] = forces[0, i, 0]
    for j in range(len(room.joint_v)):
        room.inertia[j] = room.matrix[room.joint_v[j], room.joint_v[j]]
    find_change(room, exchange, 0, lengths[0])
    for j in range(len(room.joint_v)):
        i = room.joint_v[j]
        mean = room.velocity[i] + room.scheme[IMPLICITNESS] * room.change[i]
        push[i] += exchange[0, j, TORQUE] - exchange[0, j, DAMPING] * mean


class _Saved:
    """A saved state in Bullet's memory. Deleting this object removes the state, unless the physics client has ended: then the
    client's number may belong to another client."""

    def __init__(self, p: Any, client: int, close: finalize[..., Any]) -> None:
        self.number = p.saveState(physicsClientId=client)
        self._remove, self._close = partial(p.removeState, self.number, physicsClientId=client), close

    def __del__(self) -> None:
        if self._close.alive:
            self._remove()


class BulletContacts:
    """A physics client with one robot and its world."""

    native = None

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self._p, self._client, self._end = connect(self)
        self.version = f"pybullet {version('pybullet')}"
        self.robot, self._scenario = robot, scenario
        self.model: BulletModel | None = None
        try:
            self._load()
        except BaseException:
            self.close()
            raise

    def _load(self) -> None:
        p, client, scenario = self._p, self._client, self._scenario
        merged = merge_fixed(self.robot).robot
        text, _ = engine_urdf(merged, package_paths=scenario.package_paths)
        self._body = body = load_body(p, client, text, scenario, self.robot)
        places = places_of(p, client, body)
        set_inertias(p, client, body, places, merged)
        free_of_losses(p, client, body)
        p.setGravity(*scenario.gravity, physicsClientId=client)
        # With erp 0, a stop removes a joint's velocity and does not push the joint back; see _reach_stops.
        p.setPhysicsEngineParameter(
            numSolverIterations=SOLVER_ITERATIONS, solverResidualThreshold=SOLVER_RESIDUAL, erp=0.0, physicsClientId=client
        )
        self._model = self.model = BulletModel(scenario, self.robot)
        self.joints = self.model.joints
        moving = merged.moving_joints
        self._indices = [places[joint.child] for joint in moving]
        self._stops = [(j, *joint.stops) for j, joint in enumerate(moving) if np.isfinite(joint.stops).any()]
        self._base = 0 if scenario.fixed_base else BASE
        self._world = BulletWorld(p, client, body, scenario.world, fixed=scenario.fixed_base)
        self._home = p.getBasePositionAndOrientation(body, client), self._world.states()
        count = len(self._indices)
        self._before = np.zeros(self._base + count)
        self._rotation: Array | None = None
        """Rotation matrix (3, 3) of the base link, if the base floats."""
        self._frictions: list[float | None] = [None] * count
        """Torque limits in N m of the motors that act as friction; None: unknown."""
        self._room = make_room(
            self.robot, np.zeros(4), qpos=np.zeros(count), qvel=self._before, joint_q=range(count),
            joint_v=range(self._base, self._base + count), free=bool(self._base),
        )  # fmt: skip
        self._torques = Calculation(find_torques, self._room)

    # -- stepping ---------------------------------------------------------------------------------------------------

    def start(
        self, positions: Sequence[float], velocities: Sequence[float], *, step: float, staggered: bool, implicitness: float
    ) -> tuple[Sequence[float], Sequence[float]]:
        """Begin a run; see `asrsim.engines.base.Engine`."""
        p, client = self._p, self._client
        self._step = step
        self._room.scheme[:] = step, 1.5, -0.5, implicitness
        # Bullet stores the impulses of motors, which depend on the step: set them anew.
        self._frictions = [None] * len(self._indices)
        self._lagging = staggered and len(self._before) > 1
        p.setTimeStep(step, physicsClientId=client)
        base, objects = self._home
        p.resetBasePositionAndOrientation(self._body, *base, physicsClientId=client)
        self._rotation = np.eye(3) if self._base else None
        self._place(positions, np.concatenate([np.zeros(self._base), velocities]))
        self._world.set_states(objects)
        self._read()
        self._before[:] = self._room.velocity
        return positions, velocities

    def _place(self, positions: Sequence[float], velocities: Array) -> None:
        """Set the positions of the joints and the velocities (v,) of all degrees of freedom."""
        for index, position, velocity in zip(self._indices, positions, velocities[self._base :], strict=True):
            self._p.resetJointState(self._body, index, float(position), float(velocity), physicsClientId=self._client)
        if self._rotation is not None:
            spin = (self._rotation @ velocities[3:6]).tolist()
            self._p.resetBaseVelocity(self._body, velocities[:3].tolist(), spin, physicsClientId=self._client)

    def _read(self) -> None:
        """Read positions and velocities of the robot."""
        p, client, body = self._p, self._client, self._body
        states = p.getJointStates(body, self._indices, client) if self._indices else ()
        self._positions = [state[0] for state in states]
        speeds = [state[1] for state in states]
        if self._base:
            self._rotation = rotation = inertial_frame(p, client, body, -1)[1]
            linear, angular = p.getBaseVelocity(body, client)
            speeds = [*linear, *(rotation.T @ angular), *speeds]
        self._velocities = speeds[self._base :]
        self._room.qpos[:] = self._positions
        self._room.velocity[:] = speeds

    def step(self, exchange: Array, wrenches: Array, lengths: Array) -> None:
        """Advance robot and world by one step; see `asrsim.engines.base.Engine`."""
        p, client, room, model, rotation = self._p, self._client, self._room, self._model, self._rotation
        loads, forces, fraction = whole_kick(exchange, wrenches, lengths)
        self._set_friction(loads[:, FRICTION].tolist())
        whole, now = fraction == 1.0, room.velocity.copy()
        push = np.zeros(len(now))
        if forces.size:
            push = model.push(self._scenario.wrenches, forces[0], room.qpos, rotation)
        lagging = self._lagging and whole
        settled = not whole or self._near_stops() or bool(loads[:, DAMPING].any())
        if lagging or settled:
            room.bias[:] = model.bias_at(room.qpos, rotation, 1.5 * now - 0.5 * self._before if lagging else now)
        if settled:
            room.matrix[:] = model.matrix_at(room.qpos, rotation)
            self._torques(push, loads[None], push[None, :, None].copy(), np.array([fraction]))
        else:
            room.change[:] = 0.0
            push[self._base :] += loads[:, TORQUE]
        arrived = self._reach_stops((now + room.change)[self._base :].tolist())
        self._before[:] = now
        if not whole:
            # Bullet supports full kicks only: start velocities are chosen so that a full kick ends like this shorter kick.
            self._before -= room.change
            self._place(self._positions, now - (1.0 / fraction - 1.0) * room.change)
            self._world.move((fraction - 1.0) * self._step * np.array(self._scenario.gravity))
            self._read()
        if lagging or not whole:
            # Bullet evaluates velocity torques at the velocities that Bullet stores: correct the difference.
            push += model.bias_at(room.qpos, rotation, room.velocity) - room.bias
        if self._indices:
            p.setJointMotorControlArray(
                self._body, self._indices, p.TORQUE_CONTROL, forces=push[self._base :].tolist(), physicsClientId=client
            )
        if rotation is not None:
            centre = p.getBasePositionAndOrientation(self._body, client)[0]
            torque = (rotation @ push[3:6]).tolist()
            p.applyExternalForce(self._body, -1, push[:3].tolist(), centre, p.WORLD_FRAME, physicsClientId=client)
            p.applyExternalTorque(self._body, -1, torque, p.WORLD_FRAME, physicsClientId=client)
        p.stepSimulation(client)
        for j in arrived:
            self._frictions[j] = None
        self._read()
        exchange[-1, :, POSITION] = self._positions
        exchange[-1, :, VELOCITY] = self._velocities

    def _set_friction(self, bounds: list[float]) -> None:
        for j, bound in enumerate(bounds):
            if bound != self._frictions[j]:
                self._set_motor(j, bound)
                self._frictions[j] = bound

    def _set_motor(self, j: int, force: float, velocity: float = 0.0) -> None:
        """Set a velocity motor: with target 0, the motor acts as Coulomb friction of level `force`."""
        p = self._p
        p.setJointMotorControl2(
            self._body, self._indices[j], p.VELOCITY_CONTROL, targetVelocity=velocity, force=force, physicsClientId=self._client
        )

    def _near_stops(self) -> bool:
        """Whether a joint may pass a stop in this step."""
        for j, lower, upper in self._stops:
            position, reach = self._positions[j], REACH * self._step * (1.0 + abs(self._velocities[j]))
            if position + reach > upper or position - reach < lower:
                return True
        return False

    def _reach_stops(self, ends: list[float]) -> list[int]:
        """Stop joints that would pass their stops in this step: Bullet's stops act only on joints that are already beyond a
        stop.

        ends: velocities of the joints at the end of the step if there were no contacts; with these velocities, a joint reaches
        its stop at most. Returns the indices of the joints that reach their stops; Bullet's motors of these joints stop them.
        """
        arrived = []
        for j, lower, upper in self._stops:
            position = self._positions[j]
            for speed in (ends[j], self._velocities[j]):
                reach = ((upper if speed > 0.0 else lower) - position) / self._step
                if reach * speed > 0.0 and abs(speed) + BEYOND > abs(reach):
                    # The target lies slightly beyond the stop, so that Bullet's stop acts from the next step on.
                    self._set_motor(j, ARREST, reach + (BEYOND if speed > 0.0 else -BEYOND) / self._step)
                    arrived.append(j)
                    break
        return arrived

    @property
    def state(self) -> Any:
        """Bullet's saved state, and the velocities before the last kick."""
        return _Saved(self._p, self._client, self._end), self._before.copy()

    @state.setter
    def state(self, values: Any) -> None:
        saved, before = values
        self._p.restoreState(saved.number, physicsClientId=self._client)
        self._before[:] = before
        self._read()
        self._frictions = [None] * len(self._indices)

    # -- surroundings -----------------------------------------------------------------------------------------------

    def vary(self, robot: Robot) -> bool:
        """Whether the inertials are unchanged: Bullet cannot change the inertials of a loaded robot."""
        return robot.links == self.robot.links

    def scene(self) -> Scene:
        """Poses of the world's objects, and of the base link if it floats; contact forces."""
        poses = self._world.poses()
        if self._base:
            centre, rotation, local = inertial_frame(self._p, self._client, self._body, -1)
            origin = np.array(centre) - rotation @ np.array(local)
            poses = {self._model.root: (*origin.tolist(), *quaternion(roll_pitch_yaw(rotation)))} | poses
        return Scene(poses, self._world.contacts())

    def close(self) -> None:
        """Disconnect the physics clients."""
        self._end()
        if self.model is not None:
            self.model.close()
