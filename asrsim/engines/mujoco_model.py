"""Kinematics and dynamics of the robot alone, by MuJoCo's routines on data of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from asrsim.engines.base import Point
from asrsim.samples import Array


class MujocoModel:
    """See :class:`asrsim.engines.base.Model`. home: qpos of the start, for what is no joint of the robot.

    places: link -> body of the model, position (3,) and rotation (3, 3) of the link in it (fixed links are merged).
    """

    def __init__(
        self, mujoco: Any, model: Any, *, joints: tuple[str, ...], home: Array, places: Mapping[str, tuple[int, Array, Array]]
    ) -> None:
        self._mujoco, self._model = mujoco, model
        self._data = mujoco.MjData(model)
        self._home = home.copy()
        self.places = places
        self.joints = joints
        self.links = tuple(places)
        numbers = [model.joint(name).id for name in joints]
        self.at_q = np.array([model.jnt_qposadr[i] for i in numbers], dtype=np.int64)
        self.at_v = np.array([model.jnt_dofadr[i] for i in numbers], dtype=np.int64)
        self._block = np.ix_(self.at_v, self.at_v)
        self._floating = (
            6 if len(model.jnt_type) and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE and model.jnt_bodyid[0] == 1 else 0
        )
        self._known: bytes | None = None

    def _place(self, positions: Sequence[float] | Array) -> Any:
        """The data with the joints at `positions`, positions' consequences worked out."""
        data, mj = self._data, self._mujoco
        values = np.asarray(positions, dtype=float)
        key = values.tobytes()
        if key != self._known:
            data.qpos[:] = self._home
            data.qpos[self.at_q] = values
            mj.mj_kinematics(self._model, data)
            mj.mj_comPos(self._model, data)
            mj.mj_makeM(self._model, data)
            self._known = key
        return data

    def forget(self) -> None:
        """The model's numbers have changed."""
        self._known = None

    def mass_matrix(self, positions: Sequence[float] | Array) -> Array:
        """(n, n) mass matrix of the moving joints; that which torques meet while the base is free, if it floats."""
        data = self._place(positions)
        full = np.zeros((self._model.nv, self._model.nv))
        self._mujoco.mj_fullM(self._model, data, full)
        matrix = full[self._block]
        if self._floating:
            base, cross = full[:6, :6], full[:6][:, self.at_v]
            matrix = matrix - cross.T @ np.linalg.solve(base, cross)
        return matrix

    def bias(self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array) -> Array:
        """(n,) N m that give no acceleration, on a base that is held."""
        return self.inverse_dynamics(positions, velocities, np.zeros(len(self.joints)))

    def inverse_dynamics(
        self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array, accelerations: Sequence[float] | Array
    ) -> Array:
        """(n,) N m that give `accelerations`, on a base that is held."""
        data = self._place(positions)
        data.qvel[:] = 0.0
        data.qacc[:] = 0.0
        data.qvel[self.at_v] = velocities
        data.qacc[self.at_v] = accelerations
        self._mujoco.mj_comVel(self._model, data)
        torques = np.zeros(self._model.nv)
        self._mujoco.mj_rne(self._model, data, 1, torques)
        return torques[self.at_v]

    def energy(self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array) -> float:
        """J of all links, kinetic and of gravity, on a base that is held."""
        data, speeds = self._place(positions), np.asarray(velocities, dtype=float)
        gravity = -float(self._model.body_mass @ (data.xipos @ self._model.opt.gravity))
        return 0.5 * float(speeds @ self.mass_matrix(positions) @ speeds) + gravity

    def link_point(self, link: str, point: Point, positions: Sequence[float] | Array) -> tuple[Array, Array, Array]:
        """Position (3,) m, rotation (3, 3), Jacobian (6, n) of a point of a link, world frame."""
        data = self._place(positions)
        body, offset, turn = self.places[link]
        rotation = data.xmat[body].reshape(3, 3)
        position = data.xpos[body] + rotation @ (offset + turn @ np.asarray(point, dtype=float))
        linear, angular = np.zeros((3, self._model.nv)), np.zeros((3, self._model.nv))
        if body:
            self._mujoco.mj_jac(self._model, data, linear, angular, position, body)
        return position, rotation @ turn, np.vstack([linear, angular])[:, self.at_v]
