"""Stepping with contacts: Bullet's own step, with velocity motors as the joints' friction.

What Bullet's step lacks is made up for from its own mass matrix and bias: in a staggered run it takes Coriolis and centrifugal
torques at velocities half a step late; it knows no implicit damping; and it gives velocity torques their whole impulse in a
kick that is a part of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from asrsim.engines.base import DAMPING, FRICTION, POSITION, TORQUE, VELOCITY, Native, Scene
from asrsim.engines.bullet_loading import (
    SOLVER_ITERATIONS,
    SOLVER_RESIDUAL,
    SavedState,
    connect,
    free_of_losses,
    load_body,
    set_inertias,
)
from asrsim.engines.bullet_model import BulletModel, inertial_frame, places_of
from asrsim.engines.bullet_world import BulletWorld
from asrsim.robot import engine_urdf
from asrsim.robot.merge import merge_fixed
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.versions import version

BEYOND = 1e-9
"""rad or m beyond a stop at which a joint rests on it."""
ARREST = 1e9
"""N m: more than any impact takes."""


class BulletContacts:
    """One robot and its world in a physics client."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self.model = BulletModel(scenario, robot)
        self._p, self._client, self._release = connect(self)
        self.version = f"pybullet {version('pybullet')}"
        self.robot, self._scenario = robot, scenario
        merged = merge_fixed(robot)
        text, _ = engine_urdf(merged.robot, package_paths=scenario.package_paths)
        try:
            p, client = self._p, self._client
            self._body = body = load_body(p, client, text, scenario, robot)
            links = places_of(p, client, body)
            set_inertias(p, client, body, links, merged.robot)
            free_of_losses(p, client, body)
            self._world = BulletWorld(p, client, body, scenario.world, fixed=scenario.fixed_base)
        except BaseException:
            self.close()
            raise
        self.joints = self.model.joints
        self.base = "" if scenario.fixed_base else merged.robot.root.name
        self._indices = [links[joint.child] for joint in merged.robot.moving_joints]
        self._places = {name: (links[place.body], place.pose) for name, place in merged.places.items()}
        self._stops = [joint.stops for joint in robot.moving_joints]
        self._stopped = bool(np.isfinite(self._stops).any())
        self._home = p.getBasePositionAndOrientation(body, client), self._world.states()
        # erp 0: a stop takes a joint's velocity and does not push it back; see _reach_stops.
        p.setPhysicsEngineParameter(
            numSolverIterations=SOLVER_ITERATIONS, solverResidualThreshold=SOLVER_RESIDUAL, erp=0.0, physicsClientId=client
        )

    # -- state ------------------------------------------------------------------------------------------------------

    def start(
        self, positions: Sequence[float], velocities: Sequence[float], *, step: float, staggered: bool, implicitness: float
    ) -> tuple[Sequence[float], Sequence[float]]:
        """A run begins."""
        p, client, body = self._p, self._client, self._body
        self._step, self._staggered, self._implicitness = step, staggered, implicitness
        p.setTimeStep(step, physicsClientId=client)
        base, objects = self._home
        p.resetBasePositionAndOrientation(body, *base, physicsClientId=client)
        p.resetBaseVelocity(body, [0, 0, 0], [0, 0, 0], physicsClientId=client)
        for index, position, velocity in zip(self._indices, positions, velocities, strict=True):
            p.resetJointState(body, index, position, velocity, physicsClientId=client)
        self._world.set_states(objects)
        size = self.model.base + len(self.joints)
        self._previous = np.zeros(size)
        """(v,) velocities before the last kick."""
        self._change, self._net = np.zeros(size), np.full(len(self.joints), np.nan)
        """(v,) change of velocity in the last kick, and (n,) torque in it; NaN: there was none."""
        # Bullet keeps the impulses of its motors from step to step; new ones have none.
        self._friction = [-1.0] * len(self.joints)
        return positions, velocities

    @property
    def state(self) -> Any:
        """Bullet's, in its memory, and what stands here."""
        saved = SavedState(self._p, self._client, self._release)
        return saved, self._previous.copy(), self._change.copy(), self._net.copy(), list(self._friction)

    @state.setter
    def state(self, values: Any) -> None:
        saved, previous, change, net, friction = values
        self._p.restoreState(saved.number, physicsClientId=self._client)
        self._previous, self._change, self._net = previous.copy(), change.copy(), net.copy()
        for index, bound in zip(self._indices, friction, strict=True):
            self._set_motor(index, bound)
        self._friction = list(friction)

    # -- stepping ---------------------------------------------------------------------------------------------------

    def step(self, exchange: Array, wrenches: Array, fraction: float = 1.0) -> None:
        """One step."""
        p, client, body, joints = self._p, self._client, self._body, self.model.base
        positions, velocity, rotation = self._look()
        whole = 1.5 * velocity - 0.5 * self._previous if self._staggered and fraction == 1.0 else velocity
        bias = self.model.bias_at(positions, rotation, velocity)
        push = bias - self.model.bias_at(positions, rotation, whole)
        if fraction != 1.0:
            still = self.model.bias_at(positions, rotation, np.zeros_like(velocity))
            push = fraction * push + (1.0 - fraction) * (bias - still)
        torque = fraction * (exchange[:, TORQUE] + self._damping(exchange, positions, rotation, bias, velocity, fraction))
        if joints:
            self._push_base(push[:3], rotation @ push[3:6])
        for index, values in enumerate(wrenches):
            self._push_link(index, values)
        friction = (fraction * exchange[:, FRICTION]).tolist()
        for place, bound in enumerate(friction):
            if bound != self._friction[place]:
                self._set_motor(self._indices[place], bound)
        arrived = self._reach_stops(positions, velocity[joints:]) if self._stopped else []
        self._friction = [-1.0 if place in arrived else bound for place, bound in enumerate(friction)]
        if fraction != 1.0:
            p.setGravity(*(fraction * component for component in self._scenario.gravity), physicsClientId=client)
        forces = (torque + push[joints:]).tolist()
        p.setJointMotorControlArray(body, self._indices, p.TORQUE_CONTROL, forces=forces, physicsClientId=client)
        p.stepSimulation(client)
        if fraction != 1.0:
            p.setGravity(*self._scenario.gravity, physicsClientId=client)
        after, new, _ = self._look()
        self._change = new - velocity
        # Before a first kick, as if it had been a whole one.
        self._previous = velocity if fraction == 1.0 else velocity - self._change
        exchange[:, POSITION], exchange[:, VELOCITY] = after, new[joints:]

    def _look(self) -> tuple[Array, Array, Any]:
        """Positions (n,), velocities (v,), rotation (3, 3) of a floating base."""
        p, client, body = self._p, self._client, self._body
        states = p.getJointStates(body, self._indices, client)
        positions, speeds = [state[0] for state in states], [state[1] for state in states]
        if not self.base:
            return np.array(positions), np.array(speeds), None
        _, rotation, _ = inertial_frame(p, client, body, -1)
        linear, angular = p.getBaseVelocity(body, client)
        return np.array(positions), np.array([*linear, *(rotation.T @ np.array(angular)), *speeds]), rotation

    def _damping(
        self, exchange: Array, positions: Array, rotation: Any, bias: Array, velocity: Array, fraction: float
    ) -> Array:
        """(n,) N m of damping at the mean velocity over the kick that it helps to make.

        The change of velocity differs from the last kick's by what the torques have changed by; contacts push as they did.
        """
        drag, own = exchange[:, DAMPING], velocity[self.model.base :]
        net = exchange[:, TORQUE] - drag * own
        if not drag.any():
            self._net = net
            return np.zeros(len(own))
        kick, rows = fraction * self._step, slice(self.model.base, None)
        implicit = self.model.matrix_at(positions, rotation)
        implicit[rows, rows] += np.diag(self._implicitness * kick * drag)
        force = np.zeros(len(velocity))
        if np.isnan(self._net).any():
            force[rows] = net
            change = np.linalg.solve(implicit, kick * (force - bias))
        else:
            force[rows] = net - self._net
            change = self._change + np.linalg.solve(implicit, kick * force)
        self._net = net
        return np.asarray(-drag * (own + self._implicitness * change[rows]))

    def _set_motor(self, index: int, force: float, velocity: float = 0.0) -> None:
        """A velocity motor at target 0: without force it frees the joint, with one it is its Coulomb friction."""
        p = self._p
        p.setJointMotorControl2(
            self._body, index, p.VELOCITY_CONTROL, targetVelocity=velocity, force=max(force, 0.0), physicsClientId=self._client
        )

    def _reach_stops(self, positions: Array, velocities: Array) -> list[int]:
        """Let joints that would pass their stops in this step just reach them: Bullet's own stops act on joints beyond only.
        Returns their numbers; their motors serve for it."""
        arrived = []
        for place, ((lower, upper), position, velocity) in enumerate(
            zip(self._stops, positions.tolist(), velocities.tolist(), strict=True)
        ):
            reach = ((upper if velocity > 0.0 else lower) - position) / self._step
            if reach * velocity > 0.0 and abs(velocity) > abs(reach):
                # A hair beyond, where Bullet's stop holds it from the next step on.
                target = reach + (BEYOND if velocity > 0.0 else -BEYOND) / self._step
                self._set_motor(self._indices[place], ARREST, target)
                arrived.append(place)
        return arrived

    def _push_base(self, force: Array, torque: Array) -> None:
        """Force (3,) N and torque (3,) N m, world axes, on the base's centre of mass in the next step."""
        p, client, body = self._p, self._client, self._body
        centre = p.getBasePositionAndOrientation(body, client)[0]
        p.applyExternalForce(body, -1, force.tolist(), centre, p.WORLD_FRAME, physicsClientId=client)
        p.applyExternalTorque(body, -1, torque.tolist(), p.WORLD_FRAME, physicsClientId=client)

    def _push_link(self, number: int, values: Array) -> None:
        """The scenario's wrench of this number, a mean over the next step."""
        p, client, body = self._p, self._client, self._body
        wrench = self._scenario.wrenches[number]
        index, pose = self._places[wrench.link]
        centre, rotation, local = inertial_frame(p, client, body, index)
        turned = rotation @ pose.rotation
        force, torque = values[:3], values[3:]
        if wrench.frame != "world":
            force, torque = turned @ force, turned @ torque
        arm = rotation @ (pose.position - np.array(local)) + turned @ np.array(wrench.point)
        p.applyExternalForce(body, index, force.tolist(), centre, p.WORLD_FRAME, physicsClientId=client)
        p.applyExternalTorque(body, index, (torque + np.cross(arm, force)).tolist(), p.WORLD_FRAME, physicsClientId=client)

    @property
    def native(self) -> Native | None:
        """Steps go through Python."""
        return None

    def vary(self, robot: Robot) -> bool:
        """True where links are the same: Bullet takes over no changed bodies exactly."""
        if robot.links != self.robot.links:
            return False
        self.robot = robot
        return True

    def scene(self) -> Scene:
        """Poses of the world's objects, and of the base if it floats; contact forces on objects, and on the robot by the
        ground."""
        poses = self._world.poses()
        if self.base:
            centre, rotation, local = inertial_frame(self._p, self._client, self._body, -1)
            inertial = self._p.getBasePositionAndOrientation(self._body, self._client)[1]
            turn = self._p.getDynamicsInfo(self._body, -1, self._client)[4]
            place = np.array(centre) - rotation @ np.array(local)
            poses = {self.base: (*place.tolist(), *_times(inertial, _inverse(turn)))} | poses
        return Scene(poses, self._world.contacts())

    def close(self) -> None:
        """Disconnect the clients."""
        self._release()
        self.model.close()


def _times(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float, float]:
    """Product of two quaternions x y z w."""
    (x, y, z, w), (i, j, k, r) = a, b
    return (
        w * i + x * r + y * k - z * j,
        w * j - x * k + y * r + z * i,
        w * k + x * j - y * i + z * r,
        w * r - x * i - y * j - z * k,
    )  # fmt: skip


def _inverse(a: Sequence[float]) -> tuple[float, float, float, float]:
    x, y, z, w = a
    return -x, -y, -z, w
