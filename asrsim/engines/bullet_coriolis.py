"""Bullet takes Coriolis and centrifugal torques at velocities half a step late; these make up for it, to second order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from asrsim.engines.base import Model
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

MOST = 8
"""Steps, at most, for which a correction is held; in between it is what it will be half-way there."""
TURN = 0.01
"""rad that the fastest joint turns, at most, in that time: measured on five fast joints (62 rad/s), where evaluating every
step brings the error at 1 ms from 2.1e-2 to 6e-3 rad."""


class Coriolis(Protocol):
    """What an engine asks for, once a step."""

    def reset(self) -> None:
        """A new start."""

    def corrected(self, positions: list[float], lagging: list[float], forces: Sequence[float]) -> list[float]:
        """Joint torques with the correction; what acts on a free base is applied."""

    def first(self, positions: list[float], velocities: list[float], forces: Sequence[float], fraction: float) -> list[float]:
        """The same for a first kick that is a part of one: the engine gives velocity torques their whole impulse."""

    def after_first(self, velocities: list[float]) -> None:
        """Velocities after the first kick."""

    def snapshot(self) -> Any:
        """State."""

    def restore(self, state: Any) -> None:
        """Continue from a snapshot."""


class FixedBase:
    """On a base that is held: differences of Bullet's own inverse dynamics, held for as long as motion allows."""

    def __init__(self, model: Model, step: float, coherent: int) -> None:
        self._model, self._step = model, step
        self._most = max(1, min(MOST, coherent))
        self.reset()

    def reset(self) -> None:
        """A new start."""
        self._previous: list[float] | None = None
        self._correction: list[float] = []
        self._last: tuple[list[float], int] | None = None
        self._left = 0

    def corrected(self, positions: list[float], lagging: list[float], forces: Sequence[float]) -> list[float]:
        """Joint torques with the correction."""
        previous = self._previous
        self._previous = lagging
        if not self._left:
            self._evaluate(positions, lagging, lagging if previous is None else previous)
        self._left -= 1
        return [force - part for force, part in zip(forces, self._correction, strict=True)]

    def _evaluate(self, positions: list[float], lagging: list[float], previous: list[float]) -> None:
        fastest = max(map(abs, lagging))
        every = self._most if fastest * self._step * self._most <= TURN else max(1, int(TURN / (fastest * self._step)))
        centred = [1.5 * v - 0.5 * u for v, u in zip(lagging, previous, strict=True)]
        difference = self._model.bias_difference(positions, centred, lagging)  # type: ignore[attr-defined]
        if self._last is None or every == 1:
            self._correction = difference
        else:
            # Held for `every` steps: its value in the middle of that time, by the change since the last evaluation.
            earlier, passed = self._last
            ahead = 0.5 * (every - 1) / passed
            self._correction = [new + ahead * (new - old) for new, old in zip(difference, earlier, strict=True)]
        self._last = difference, every
        self._left = every

    def first(self, positions: list[float], velocities: list[float], forces: Sequence[float], fraction: float) -> list[float]:
        """A first kick that is a part of one."""
        self._start = velocities
        whole = self._model.bias_difference(positions, velocities, [0.0] * len(velocities))  # type: ignore[attr-defined]
        return [force + (1.0 - fraction) * part for force, part in zip(forces, whole, strict=True)]

    def after_first(self, velocities: list[float]) -> None:
        """The velocity half a step before the start is as if the first kick had been a whole one."""
        self._previous = [2.0 * u - v for u, v in zip(self._start, velocities, strict=True)]

    def snapshot(self) -> Any:
        """State."""
        return self._previous, self._correction, self._last, self._left

    def restore(self, state: Any) -> None:
        """Continue from a snapshot."""
        self._previous, self._correction, self._last, self._left = state


class FloatingBase:
    """With a base that is free: differences of MuJoCo's bias, since Bullet's inverse dynamics does without such a base.

    Bullet keeps the velocity of the base's centre of mass, MuJoCo that of its frame; M d(J)/dt v is the difference.
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
        self._centre = np.array(self._m.body_ipos[1])
        self.reset()

    def reset(self) -> None:
        """A new start."""
        self._previous: Array | None = None

    def _state(self, positions: list[float], joint_velocities: list[float]) -> Array:
        """Velocities (v,) of base (centre of mass and angular, world frame) and joints; the data is put into the pose."""
        p, d = self._p, self._d
        centre, turn = p.getBasePositionAndOrientation(self._body, self._client)
        inertial = p.getDynamicsInfo(self._body, -1, self._client)[4]
        rotation = _matrix(p, turn) @ _matrix(p, inertial).T
        d.qpos[self._model.at_q] = positions
        d.qpos[:3] = np.array(centre) - rotation @ self._centre
        self._mujoco.mju_mat2Quat(d.qpos[3:7], rotation.ravel())
        self._rotation, self._arm = rotation, -rotation @ self._centre
        for routine in (self._mujoco.mj_kinematics, self._mujoco.mj_comPos, self._mujoco.mj_makeM):
            routine(self._m, d)
        linear, angular = p.getBaseVelocity(self._body, self._client)
        velocity = np.zeros(self._m.nv)
        velocity[:3], velocity[3:6] = linear, angular
        velocity[self._model.at_v] = joint_velocities
        return velocity

    def _bias(self, velocity: Array) -> Array:
        """(v,) generalised forces, of the base at its frame in world axes, that velocities ask for."""
        d, m = self._d, self._m
        omega = velocity[3:6]
        d.qvel[:] = velocity
        d.qvel[:3] += np.cross(omega, self._arm)
        d.qvel[3:6] = self._rotation.T @ omega
        self._mujoco.mj_comVel(m, d)
        bias, turned = np.zeros(m.nv), np.zeros(m.nv)
        self._mujoco.mj_rne(m, d, 0, bias)
        swing = np.zeros(m.nv)
        swing[:3] = np.cross(omega, np.cross(omega, self._arm))
        self._mujoco.mj_mulM(m, d, turned, swing)
        bias += turned
        bias[3:6] = self._rotation @ bias[3:6]
        return bias

    def _push(self, change: Array, forces: Sequence[float]) -> list[float]:
        """`change` (v,) taken from what acts: on the base at once, on the joints in their torques."""
        p, client = self._p, self._client
        place = self._d.qpos[:3].tolist()
        p.applyExternalForce(self._body, -1, (-change[:3]).tolist(), place, p.WORLD_FRAME, physicsClientId=client)
        p.applyExternalTorque(self._body, -1, (-change[3:6]).tolist(), p.WORLD_FRAME, physicsClientId=client)
        return [force - part for force, part in zip(forces, change[self._model.at_v].tolist(), strict=True)]

    def corrected(self, positions: list[float], lagging: list[float], forces: Sequence[float]) -> list[float]:
        """Joint torques with the correction; the base's is applied."""
        velocity = self._state(positions, lagging)
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
        linear, angular = self._p.getBaseVelocity(self._body, self._client)
        now = self._start.copy()
        now[:3], now[3:6] = linear, angular
        now[self._model.at_v] = velocities
        self._previous = 2.0 * self._start - now

    def snapshot(self) -> Any:
        """State."""
        return self._previous

    def restore(self, state: Any) -> None:
        """Continue from a snapshot."""
        self._previous = state


def _matrix(p: Any, quaternion: Sequence[float]) -> Array:
    return np.array(p.getMatrixFromQuaternion(quaternion), dtype=float).reshape(3, 3)
