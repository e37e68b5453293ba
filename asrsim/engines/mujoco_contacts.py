"""Steps with contacts, by MuJoCo's solver; joint friction and stops are among its constraints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from asrsim.engines.base import DAMPING, FRICTION, POSITION, TORQUE, VELOCITY, whole_kick
from asrsim.engines.contact_forces import GROUND, ROBOT, contact_forces
from asrsim.engines.mujoco_build import HARD
from asrsim.engines.mujoco_library import bound
from asrsim.engines.mujoco_step import Record, push
from asrsim.engines.rigid import BEFORE, IMPLICITNESS, NOW, STEP, Room
from asrsim.samples import Array
from asrsim.scenario.data import World

NORMAL_STEPS, FRICTION_STEPS = 10.0, 20.0
"""Time constants of contacts, in steps, chosen by measurements on a sliding box (docs/validation.md)."""
LIGHTER = 1e-2
"""Factor on the inverse inertia that regularises friction. With this factor, measured errors of velocities were below 5e-8
rad/s."""
REACH = 2.0
"""A stop counts as near if the joint, moving 1 rad/s faster than now, could reach the stop within this number of steps."""
TOLERANCE = 1e-12
"""MuJoCo's solver ends when the scaled improvement of its cost falls below this value."""
SEARCH = 1000
"""Largest number of iterations of a line search in MuJoCo's solver. With the default, 50, 1 % of the steps of a sliding box
ended far from the solution."""


class MujocoContacts:
    """Contacts of the world, and steps that include them."""

    def __init__(self, mujoco: Any, model: Any, data: Any, world: World) -> None:
        self._mujoco, self._m, self._d = mujoco, model, data
        self._objects = [item.name for item in world.objects]
        names = {model.geom(f"object/{name}").id: name for name in self._objects}
        if world.ground:
            names[model.geom(GROUND).id] = GROUND
        self._owner = [names.get(index, ROBOT) for index in range(model.ngeom)]
        self._ground = world.ground
        model.dof_invweight0[:] *= LIGHTER
        model.opt.tolerance, model.opt.ls_iterations = TOLERANCE, SEARCH

    def start(self, room: Room) -> None:
        """Set up the constraints, whose time constants are multiples of the step."""
        m, step = self._m, float(room.scheme[STEP])
        self._mujoco.mj_resetData(m, self._d)
        m.opt.timestep = step
        joints = room.joint_v
        m.dof_solimp[joints] = HARD
        m.dof_solref[joints] = (-1.0, -HARD[0] / step)
        places = [int(np.flatnonzero(m.jnt_dofadr == dof)[0]) for dof in joints]
        limited = np.isfinite(room.lower) | np.isfinite(room.upper)
        m.jnt_limited[places] = limited
        m.jnt_range[places] = np.column_stack([np.maximum(room.lower, -1e9), np.minimum(room.upper, 1e9)])
        m.jnt_solimp[places] = HARD
        self._limited = [place for place, limit in zip(places, limited, strict=True) if limit]
        m.pair_solref[:] = (NORMAL_STEPS * step, 1.0)
        m.pair_solreffriction[:] = (FRICTION_STEPS * step, 1.0)

    def step(self, record: Record, state: Array, exchange: Array, wrenches: Array, lengths: Array) -> None:
        """Advance by one step as `asrsim.engines.mujoco_step.step` does, but MuJoCo computes friction, stops and contacts, with
        the means over the pieces of the kick. The state has the accelerations from which the solver starts, instead of
        `regime`."""
        mj, m, d, room = self._mujoco, self._m, self._d, record.room
        loads, forces, fraction = whole_kick(exchange, wrenches, lengths)
        step = float(room.scheme[STEP])
        kick, first, size = fraction * step, len(d.qpos), len(d.qvel)
        lagging = state[first : first + size].copy()
        damping = loads[:, DAMPING]
        m.dof_armature[room.joint_v] = room.scheme[IMPLICITNESS] * kick * damping
        # Friction may vary from step to step. MuJoCo makes a constraint of friction only where the friction is not 0.
        m.dof_frictionloss[room.joint_v] = loads[:, FRICTION]
        d.qpos[:] = state[:first]
        d.qvel[:] = lagging
        d.qacc_warmstart[:] = state[first + 2 * size :]
        # Only stops that may be reached in this step become constraints.
        m.jnt_margin[self._limited] = REACH * step * (1.0 + np.abs(d.qvel[m.jnt_dofadr[self._limited]]))
        mj.mj_fwdPosition(m, d)
        d.qvel[:] = room.scheme[NOW] * lagging + room.scheme[BEFORE] * state[first + size : first + 2 * size]
        mj.mj_fwdVelocity(m, d)
        d.qvel[:] = lagging
        mj.mj_referenceConstraint(m, d)
        self._aim_at_stops(kick, step)
        d.qfrc_applied[:] = 0.0
        d.qfrc_applied[room.joint_v] = loads[:, TORQUE] - damping * lagging[room.joint_v]
        if forces.size:
            bound(push)(record, forces, 0)
            d.qfrc_applied += room.force
        mj.mj_fwdActuation(m, d)
        mj.mj_fwdAcceleration(m, d)
        mj.mj_fwdConstraint(m, d)
        change = kick * d.qacc
        d.qvel[:] = lagging + change
        mj.mj_integratePos(m, d.qpos, d.qvel, step)
        state[:first] = d.qpos
        state[first:] = [*d.qvel, *(lagging + (1.0 - 1.0 / fraction) * change), *d.qacc]
        exchange[-1, :, POSITION] = d.qpos[room.joint_q]
        exchange[-1, :, VELOCITY] = d.qvel[room.joint_v]

    def _aim_at_stops(self, kick: float, step: float) -> None:
        """Make stops inelastic: at the end of the step no joint has passed its stop (see exact_friction). A joint that is
        beyond its stop already stays at rest there."""
        d = self._d
        rows = d.efc_type == self._mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
        slowest = -np.maximum(d.efc_pos[rows], 0.0) / step
        d.efc_aref[rows] = (slowest - d.efc_vel[rows]) / kick

    def poses(self, state: Array) -> dict[str, tuple[float, ...]]:
        """Pose (x, y, z, qx, qy, qz, qw) of each object, by name; m, world frame. The poses follow from the configuration,
        since the poses that MuJoCo stores lag by one step."""
        poses = {}
        for name in self._objects:
            body = self._m.body(f"object/{name}")
            if body.dofnum[0]:
                at = int(self._m.jnt_qposadr[body.jntadr[0]])
                pose = state[at : at + 7]
            else:
                pose = np.concatenate([self._m.body_pos[body.id], self._m.body_quat[body.id]])
            poses[name] = (*pose[:3].tolist(), *pose[4:7].tolist(), float(pose[3]))
        return poses

    def forces(self) -> dict[str, tuple[float, float, float]]:
        """Contact forces in N; see `asrsim.engines.contact_forces.contact_forces`."""
        return contact_forces(self._objects, self._ground, self._points())

    def _points(self) -> Iterator[tuple[str, str, Array]]:
        values = np.zeros(6)
        for index, contact in enumerate(self._d.contact):
            first, second = (self._owner[geom] for geom in contact.geom)
            self._mujoco.mj_contactForce(self._m, self._d, index, values)
            # MuJoCo's frame points from the first shape to the second; the force is on the second.
            yield second, first, values[:3] @ contact.frame.reshape(3, 3)
