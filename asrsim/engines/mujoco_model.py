"""Kinematics and dynamics of the robot without its world, by MuJoCo's routines on a separate MjData."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from asrsim.engines.base import Point, Values
from asrsim.engines.rigid import RigidModel
from asrsim.samples import Array


class MujocoModel(RigidModel):
    """MuJoCo's `asrsim.engines.base.Model`.

    free: number of degrees of freedom of the base. home: qpos at the start, for degrees of freedom that are not joints of the
    robot. places: for each link, its MuJoCo body, and position (3,) and rotation (3, 3) of the link in the body, into which
    fixed links are merged.
    """

    def __init__(
        self,
        mujoco: Any,
        model: Any,
        *,
        joints: tuple[str, ...],
        free: int,
        home: Array,
        places: Mapping[str, tuple[int, Array, Array]],
    ) -> None:
        self._mujoco, self._model = mujoco, model
        self._data = mujoco.MjData(model)
        self._home = home.copy()
        self.places = places
        self.joints = joints
        self.links = tuple(places)
        self.at_q = np.array([model.joint(name).qposadr[0] for name in joints], dtype=np.int64)
        self.at_v = np.array([model.joint(name).dofadr[0] for name in joints], dtype=np.int64)
        self.free = free
        rows = [*range(free), *self.at_v]
        self._block = np.ix_(rows, rows)
        self._known: bytes | None = None

    def _place(self, positions: Values) -> Any:
        """MjData with the joints at `positions`, after forward kinematics."""
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
        """Discard the last posture, since the parameters of the model have changed."""
        self._known = None

    def full_matrix(self, positions: Values) -> Array:
        """Mass matrix (v, v) of a floating base and the moving joints."""
        data = self._place(positions)
        full = np.zeros((self._model.nv, self._model.nv))
        self._mujoco.mj_fullM(self._model, data, full)
        return full[self._block]

    def inverse_dynamics(self, positions: Values, velocities: Values, accelerations: Values) -> Array:
        """Joint torques (n,) in N m that give `accelerations`, on a fixed base."""
        data = self._place(positions)
        data.qvel[:] = 0.0
        data.qacc[:] = 0.0
        data.qvel[self.at_v] = velocities
        data.qacc[self.at_v] = accelerations
        self._mujoco.mj_comVel(self._model, data)
        torques = np.zeros(self._model.nv)
        self._mujoco.mj_rne(self._model, data, 1, torques)
        return torques[self.at_v]

    def potential(self, positions: Values) -> float:
        """Gravitational energy of the links in J."""
        return -float(self._model.body_mass @ (self._place(positions).xipos @ self._model.opt.gravity))

    def link_point(self, link: str, point: Point, positions: Values) -> tuple[Array, Array, Array]:
        """Position (3,) m, rotation (3, 3), Jacobian (6, n) of a point of a link, world frame."""
        data = self._place(positions)
        body, offset, turn = self.places[link]
        rotation = data.xmat[body].reshape(3, 3)
        position = data.xpos[body] + rotation @ (offset + turn @ np.asarray(point, dtype=float))
        linear, angular = np.zeros((3, self._model.nv)), np.zeros((3, self._model.nv))
        if body:
            self._mujoco.mj_jac(self._model, data, linear, angular, position, body)
        return position, rotation @ turn, np.vstack([linear, angular])[:, self.at_v]
