"""Bullet takes Coriolis and centrifugal torques at velocities half a step late; these make up for it, to second order."""

from __future__ import annotations

from collections.abc import Sequence
from operator import sub
from typing import Any, Protocol

import numpy as np

from asrsim.engines.bullet_model import BulletModel
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario


class Coriolis(Protocol):
    """What an engine asks for, once a step."""

    def reset(self) -> None:
        """A new start."""

    def corrected(self, states: Sequence[Any], forces: Sequence[float]) -> list[float]:
        """Joint torques with the correction; what acts on a free base is applied. states: positions and velocities, joint by
        joint."""

    def first(self, positions: list[float], velocities: list[float], forces: Sequence[float], fraction: float) -> list[float]:
        """The same for a first kick that is a part of one: the engine gives velocity torques their whole impulse."""

    def after_first(self, velocities: list[float]) -> None:
        """Velocities after the first kick."""

    def snapshot(self) -> Any:
        """State."""

    def restore(self, state: Any) -> None:
        """Continue from a snapshot."""


class FixedBase:
    """On a base that is held: differences of Bullet's own inverse dynamics.

    Every step: held over some, as asrsim 0.1 did, they were 1e-4 rad off after a reference's jump, and of a lower order.
    """

    def __init__(self, model: BulletModel) -> None:
        self._model = model
        self.reset()

    def reset(self) -> None:
        """A new start."""
        self._previous: list[float] | None = None

    def corrected(self, states: Sequence[Any], forces: Sequence[float]) -> list[float]:
        """Joint torques with the correction."""
        lagging = [state[1] for state in states]
        previous, self._previous = self._previous or lagging, lagging
        centred = [1.5 * v - 0.5 * u for v, u in zip(lagging, previous, strict=True)]
        return list(map(sub, forces, self._model.bias_difference([state[0] for state in states], centred, lagging)))

    def first(self, positions: list[float], velocities: list[float], forces: Sequence[float], fraction: float) -> list[float]:
        """A first kick that is a part of one."""
        self._start = velocities
        whole = self._model.bias_difference(positions, velocities, [0.0] * len(velocities))
        return [force + (1.0 - fraction) * part for force, part in zip(forces, whole, strict=True)]

    def after_first(self, velocities: list[float]) -> None:
        """The velocity half a step before the start is as if the first kick had been a whole one."""
        self._previous = [2.0 * u - v for u, v in zip(self._start, velocities, strict=True)]

    def snapshot(self) -> Any:
        """State."""
        return self._previous

    def restore(self, state: Any) -> None:
        """Continue from a snapshot."""
        self._previous = state


class FloatingBase:
    """With a base that is free: differences of MuJoCo's bias, since Bullet's inverse dynamics does without such a base.

    Both engines keep the velocity of the base's centre of mass. Its angular velocity is taken in the base's axes, as MuJoCo has
    it: extrapolated so, both engines take the same steps.
    """

    def __init__(self, p: Any, client: int, body: int, scenario: Scenario, robot: Robot, step: float) -> None:
        from dataclasses import replace

        import mujoco

        from asrsim.engines.mujoco import MujocoEngine
        from asrsim.scenario.data import World

        self._p, self._client, self._body = p, client, body
        self._mujoco = mujoco
        engine = MujocoEngine(replace(scenario, world=World(), wrenches=()), robot)
        self._m, self._model = engine.raw_model, engine.model
        self._d = mujoco.MjData(self._m)
        self.reset()

    def reset(self) -> None:
        """A new start."""
        self._previous: Array | None = None

    def _state(self, positions: list[float], joint_velocities: list[float]) -> Array:
        """Velocities (v,) of base (centre of mass; angular, in its axes) and joints; the data is put into the pose."""
        p, d = self._p, self._d
        centre, turn = p.getBasePositionAndOrientation(self._body, self._client)
        inertial = p.getDynamicsInfo(self._body, -1, self._client)[4]
        self._rotation = _matrix(p, turn) @ _matrix(p, inertial).T
        d.qpos[self._model.at_q] = positions
        d.qpos[:3] = centre
        self._mujoco.mju_mat2Quat(d.qpos[3:7], self._rotation.ravel())
        for routine in (self._mujoco.mj_kinematics, self._mujoco.mj_comPos):
            routine(self._m, d)
        return self._velocity(joint_velocities)

    def _velocity(self, joint_velocities: list[float]) -> Array:
        linear, angular = self._p.getBaseVelocity(self._body, self._client)
        velocity = np.zeros(self._m.nv)
        velocity[:3], velocity[3:6] = linear, self._rotation.T @ np.array(angular)
        velocity[self._model.at_v] = joint_velocities
        return velocity

    def _bias(self, velocity: Array) -> Array:
        """(v,) generalised forces, of the base in world axes, that velocities ask for."""
        self._d.qvel[:] = velocity
        self._mujoco.mj_comVel(self._m, self._d)
        bias = np.zeros(self._m.nv)
        self._mujoco.mj_rne(self._m, self._d, 0, bias)
        bias[3:6] = self._rotation @ bias[3:6]
        return bias

    def _push(self, change: Array, forces: Sequence[float]) -> list[float]:
        """`change` (v,) taken from what acts: on the base at once, on the joints in their torques."""
        p, client = self._p, self._client
        place = self._d.qpos[:3].tolist()
        p.applyExternalForce(self._body, -1, (-change[:3]).tolist(), place, p.WORLD_FRAME, physicsClientId=client)
        p.applyExternalTorque(self._body, -1, (-change[3:6]).tolist(), p.WORLD_FRAME, physicsClientId=client)
        return [force - part for force, part in zip(forces, change[self._model.at_v].tolist(), strict=True)]

    def corrected(self, states: Sequence[Any], forces: Sequence[float]) -> list[float]:
        """Joint torques with the correction; the base's is applied."""
        velocity = self._state([state[0] for state in states], [state[1] for state in states])
        previous = velocity if self._previous is None else self._previous
        self._previous = velocity
        return self._push(self._bias(1.5 * velocity - 0.5 * previous) - self._bias(velocity), forces)

    def first(self, positions: list[float], velocities: list[float], forces: Sequence[float], fraction: float) -> list[float]:
        """A first kick that is a part of one."""
        self._start = self._state(positions, velocities)
        whole = self._bias(self._start) - self._bias(np.zeros_like(self._start))
        return self._push((fraction - 1.0) * whole, forces)

    def after_first(self, velocities: list[float]) -> None:
        """The velocity half a step before the start is as if the first kick had been a whole one."""
        self._previous = 2.0 * self._start - self._velocity(velocities)

    def snapshot(self) -> Any:
        """State."""
        return self._previous

    def restore(self, state: Any) -> None:
        """Continue from a snapshot."""
        self._previous = state


def _matrix(p: Any, quaternion: Sequence[float]) -> Array:
    return np.array(p.getMatrixFromQuaternion(quaternion), dtype=float).reshape(3, 3)
