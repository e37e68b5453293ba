"""MuJoCo behind the engine interface.

Without contacts, asrsim computes the step from MuJoCo's rigid-body routines (`asrsim.engines.mujoco_step`), with exact friction
and stops of the joints. With contacts, MuJoCo's solver computes contacts, friction and stops together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from asrsim.compiled import compiling
from asrsim.compiled.packed import pack
from asrsim.engines import mujoco_step
from asrsim.engines.base import (
    DAMPING,
    FRICTION,
    POSITION,
    ROBOT,
    TORQUE,
    VELOCITY,
    Native,
    NativeRecord,
    Scene,
    contact_forces,
    whole_kick,
)
from asrsim.engines.mujoco_build import HARD, build, link_body
from asrsim.engines.mujoco_library import (
    bound,
    compiled_step,
    library_version,
    load,
    overlaps,
    stop_the_clock,
)
from asrsim.engines.rigid import BEFORE, IMPLICITNESS, NOW, STEP, WORK_SPACE, Calculation, RigidEngine, make_room, unused
from asrsim.errors import Problem
from asrsim.robot.inertia import principal_axes
from asrsim.robot.merge import LinkPlacement, merge_for_engine
from asrsim.robot.meshes import usable_shapes
from asrsim.robot.model import Link, Robot
from asrsim.robot.poses import rotation_matrix
from asrsim.samples import Array, HeldWrench
from asrsim.scenario.data import Scenario

NORMAL_STEPS, FRICTION_STEPS = 10.0, 20.0
"""NORMAL_STEPS: time constant of contacts along the normal, in steps; FRICTION_STEPS: time constant of the friction of
contacts, in steps. The values were chosen by measurements on a sliding box (docs/validation.md)."""
LIGHTER = 1e-2
"""Factor on the inverse inertia by which MuJoCo regularises friction. With this factor, errors of velocities below 5e-8 rad/s
were measured."""
REACH = 2.0
"""Number of steps within which a joint that moves 1 rad/s faster than at present can reach a stop that counts as near."""
TOLERANCE = 1e-12
"""Smallest improvement of the scaled cost in a round of MuJoCo's solver; the solver ends after a smaller improvement."""
SEARCH = 1000
"""Largest number of iterations of a line search in MuJoCo's solver. With 50, its default, 1 % of the steps of a sliding box
ended far from the solution."""


class MujocoEngine(RigidEngine):
    """A robot in a world without contacts; MuJoCo gives mass matrix and bias."""

    takes_weightless = True

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self._mujoco = mujoco = load()
        stop_the_clock()
        self.version = f"mujoco {library_version()}"
        self.robot, self._scenario = robot, scenario
        merged, self.origin = merge_for_engine(robot, fixed_base=scenario.fixed_base)
        shaped = merged.robot
        if not scenario.world.empty:
            shaped, self.warnings = usable_shapes(shaped, package_paths=scenario.package_paths)
        self._m = self.raw_model = build(scenario, shaped, self.origin)
        self._d = mujoco.MjData(self._m)
        self.joints = tuple(joint.name for joint in robot.moving_joints)
        self.root, self._free = merged.robot.root.name, not scenario.fixed_base
        self._set_inertials(merged.robot.links, self._d)
        home = self._m.qpos0.copy()
        self._places = {name: self._place(place) for name, place in merged.places.items()}
        """MuJoCo body of each link and movable object, and position (3,) in m and rotation (3, 3) of the frame of the link or
        object in this body."""
        for item in scenario.world.objects if not scenario.world.empty else ():
            if item.mass:
                self._places[item.name] = self._m.body(f"object.{item.name}").id, np.zeros(3), np.eye(3)
        gravity = np.array(scenario.gravity)
        self._floats = [
            (self._body(link.name), np.array(centre), mass * gravity)
            for link in merged.robot.links
            for mass, centre in [link.weightless]
            if mass
        ]
        """MuJoCo body, centre (m) and weight (N) of each mass on which gravity does not act."""
        self._hand = mujoco_step.empty_hand(len(self._places))
        """Wrenches that are held on bodies; all records share this object."""
        self._record, self._lent = self._make_record(self._d), False
        """_record: work space of the engine's own step; _lent: whether a compiled kernel also uses this work space."""
        make = partial(compiled_step, self.version, unused(self._record.room))
        step = Calculation(bound(mujoco_step.step), self._record, make, own=WORK_SPACE)
        super().__init__(self._record.room, home, step, scenario=scenario)

    # -- setting up -------------------------------------------------------------------------------------------------

    def _set_inertials(self, links: Sequence[Link], data: Any) -> None:
        """Set masses, centres of mass and principal moments of inertia from the robot's data."""
        m = self._m
        turn = np.zeros(4)
        for link in links:
            body = self._body(link.name)
            if not body:
                continue
            moments, rpy = principal_axes(link)
            self._mujoco.mju_mat2Quat(turn, rotation_matrix(rpy).ravel())
            m.body_mass[body] = link.mass or 0.0
            m.body_inertia[body] = moments
            m.body_ipos[body] = link.centre_of_mass
            m.body_iquat[body] = turn
        self._mujoco.mj_setConst(m, data)

    def _body(self, link: str) -> int:
        """Number of the MuJoCo body of a link that is not merged. It is 0, the world's body, for a fixed base without
        contacts."""
        return max(int(self._mujoco.mj_name2id(self._m, self._mujoco.mjtObj.mjOBJ_BODY, link_body(link))), 0)

    def _place(self, place: LinkPlacement) -> tuple[int, Array, Array]:
        """MuJoCo body of a link, and position (3,) in m and rotation (3, 3) of the link in that body."""
        body, pose = self._body(place.body), place.pose
        if body:
            return body, pose.position, pose.rotation
        turn = rotation_matrix(self._scenario.base_rpy)
        return body, self._scenario.base_position + turn @ pose.position, turn @ pose.rotation

    def _make_record(self, data: Any) -> mujoco_step.MujocoRecord:
        joints = [self._m.joint(name) for name in self.joints]
        room = make_room(
            self.robot,
            qpos=data.qpos,
            qvel=data.qvel,
            joint_q=[joint.qposadr[0] for joint in joints],
            joint_v=[joint.dofadr[0] for joint in joints],
            free=self._free,
            parent=self._m.dof_parentid,
            reduce=self._scenario.world.empty,
        )
        return mujoco_step.make_record(self._m, data, room, self._scenario.wrenches, self._places, self._floats, self._hand)

    def _make_native_record(self, stride: int) -> NativeRecord:
        if stride == 1 and not self._lent:
            # One kernel may use the engine's own record, since the engine does not step while the kernel steps.
            self._lent = True
            return NativeRecord(self._calculation.packed.ctypes.data, self._calculation)
        data = self._mujoco.MjData(self._m)
        record = self._make_record(data)
        # All records share the array that `start` and `vary` set, since all runs of an engine have the same step.
        scheme = self._room.scheme
        if stride > 1:
            scheme = scheme.copy()
            scheme[STEP] *= stride
        record = record._replace(room=record.room._replace(scheme=scheme, armature=self._room.armature))
        words = pack(record)
        return NativeRecord(words.ctypes.data, (words, record, data))

    # -- stepping ---------------------------------------------------------------------------------------------------

    def step(self, exchange: Array, wrenches: Array, lengths: Array) -> None:
        """Advance by one step. The step runs compiled after `native` has been read. The results are bitwise the same."""
        self._calculation(self._state, exchange, wrenches, lengths)

    @property
    def holdable(self) -> tuple[str, ...]:
        """The robot's links and the movable objects."""
        return tuple(self._places)

    def hold(self, wrenches: Sequence[HeldWrench]) -> None:
        """Hold wrenches; see `asrsim.engines.base.Engine`."""
        hand = self._hand
        hand.number[0] = len(wrenches)
        for row, wrench in enumerate(wrenches):
            body, offset, turn = self._places[wrench.body]
            hand.body[row], hand.point[row] = body, offset + turn @ np.array(wrench.point)
            hand.load[row] = *wrench.force, *wrench.torque

    @property
    def native(self) -> Native | None:
        """The step compiled by Numba; None if Numba is not installed."""
        if not compiling.numba_available():
            return None
        return Native(self._calculation.compile().address, len(self._state), self._make_native_record)

    def vary(self, robot: Robot) -> bool:
        """Replace the inertials; see `asrsim.engines.base.Engine`."""
        if robot.inertials != self.robot.inertials:
            if any(link.weightless[0] for link in (*robot.links, *self.robot.links)):
                return False
            armature = [joint.armature for joint in robot.moving_joints]
            if any(armature) and not self._room.reduced:
                return False
            self._room.armature[:] = armature
            merged, origin = merge_for_engine(robot, fixed_base=self._scenario.fixed_base)
            if origin != self.origin:
                return False
            self._set_inertials(merged.robot.links, self._d)
        self.robot = robot
        return True


class MujocoContacts(MujocoEngine):
    """A robot in a world with contacts. MuJoCo computes the step."""

    native = None
    # No other inertials can be set, since the constraints depend on the inertials of the first robot.
    vary = RigidEngine.vary

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        super().__init__(scenario, robot)
        names = {self._m.geom(f"object.{item.name}").id: item.name for item in scenario.world.solids}
        self._owner = [names.get(index, ROBOT) for index in range(self._m.ngeom)]
        self._m.dof_invweight0[:] *= LIGHTER
        self._m.opt.tolerance, self._m.opt.ls_iterations = TOLERANCE, SEARCH

    def begin(self) -> None:
        """Set up the constraints, whose time constants are multiples of the step."""
        m, room, step = self._m, self._room, float(self._room.scheme[STEP])
        self._mujoco.mj_resetData(m, self._d)
        m.opt.timestep = step
        joints = m.dof_jntid[room.joint_v]
        m.dof_solimp[room.joint_v] = HARD
        m.dof_solref[room.joint_v] = (-1.0, -HARD[0] / step)
        limited = np.isfinite(room.lower) | np.isfinite(room.upper)
        m.jnt_limited[joints] = limited
        m.jnt_range[joints] = np.column_stack([np.maximum(room.lower, -1e9), np.minimum(room.upper, 1e9)])
        m.jnt_solimp[joints] = HARD
        self._limited = joints[limited]
        m.pair_solref[:] = (NORMAL_STEPS * step, 1.0)
        m.pair_solreffriction[:] = (FRICTION_STEPS * step, 1.0)

    def step(self, exchange: Array, wrenches: Array, lengths: Array) -> None:
        """Advance by one step. The difference from a step without contacts is that MuJoCo computes friction, stops and
        contacts, from the means over the pieces of the kick. In place of `regime`, the state has the accelerations from which
        the solver starts."""
        mj, m, d, room, state = self._mujoco, self._m, self._d, self._room, self._state
        loads, forces, fraction = whole_kick(exchange, wrenches, lengths)
        step, first, size = float(room.scheme[STEP]), len(d.qpos), len(d.qvel)
        kick = fraction * step
        lagging = state[first : first + size].copy()
        damping = loads[:, DAMPING]
        m.dof_armature[room.joint_v] = room.armature + room.scheme[IMPLICITNESS] * kick * damping
        # Friction may vary from step to step. MuJoCo makes a friction constraint only for joints whose friction is not 0 now.
        m.dof_frictionloss[room.joint_v] = loads[:, FRICTION]
        d.qpos[:] = state[:first]
        d.qvel[:] = lagging
        d.qacc_warmstart[:] = state[first + 2 * size :]
        # Only the stops that a joint may reach in this step become constraints.
        m.jnt_margin[self._limited] = REACH * step * (1.0 + np.abs(d.qvel[m.jnt_dofadr[self._limited]]))
        mj.mj_fwdPosition(m, d)
        d.qvel[:] = room.scheme[NOW] * lagging + room.scheme[BEFORE] * state[first + size : first + 2 * size]
        mj.mj_fwdVelocity(m, d)
        d.qvel[:] = lagging
        mj.mj_referenceConstraint(m, d)
        self._aim_at_stops(kick, step)
        self._couple(kick, step)
        d.qfrc_applied[:] = 0.0
        d.qfrc_applied[room.joint_v] = loads[:, TORQUE] - damping * lagging[room.joint_v]
        if forces.size or self._hand.number[0]:
            bound(mujoco_step.push)(self._record, forces, 0)
            d.qfrc_applied += room.full_force
        if self._floats:
            room.full_bias[:] = 0.0
            bound(mujoco_step.carry)(self._record)
            d.qfrc_applied -= room.full_bias
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
        """Make stops inelastic, so that no joint has passed its stop at the end of the step (see
        `asrsim.engines.exact_friction`). A joint that is already beyond its stop rests where it is."""
        d = self._d
        rows = d.efc_type == self._mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
        slowest = -np.maximum(d.efc_pos[rows], 0.0) / step
        d.efc_aref[rows] = (slowest - d.efc_vel[rows]) / kick

    def _couple(self, kick: float, step: float) -> None:
        """Make couplings of joints exact, so that the position of each follower at the end of the step follows from the
        position of its master."""
        d = self._d
        rows = d.efc_type == self._mujoco.mjtConstraint.mjCNSTR_EQUALITY
        d.efc_aref[rows] = -(d.efc_pos[rows] / step + d.efc_vel[rows]) / kick

    def scene(self) -> Scene:
        """Poses of the world's objects, and of the base link if the base floats; and contact forces."""
        d, world, poses = self._d, self._scenario.world, dict(super().scene().bodies)
        # The poses that MuJoCo stores are from the last step, so compute the present poses.
        d.qpos[:] = self._state[: len(d.qpos)]
        self._mujoco.mj_kinematics(self._m, d)
        for item in world.objects:
            body = d.body(f"object.{item.name}")
            w, *vector = body.xquat.tolist()
            poses[item.name] = (*body.xpos.tolist(), *vector, w)
        return Scene(poses, contact_forces(world, self._points()))

    def _points(self) -> Iterator[tuple[str, str, Array]]:
        values = np.zeros(6)
        for index, contact in enumerate(self._d.contact):
            first, second = (self._owner[geom] for geom in contact.geom)
            self._mujoco.mj_contactForce(self._m, self._d, index, values)
            # MuJoCo's contact frame points from the first shape to the second. The force in this frame acts on the second
            # shape.
            yield second, first, values[:3] @ contact.frame.reshape(3, 3)


def make(scenario: Scenario, robot: Robot) -> tuple[MujocoEngine, tuple[Problem, ...]]:
    """The scenario's world in MuJoCo, and warnings about ignored parts of the robot. Raises RobotError, SimulationError."""
    engine = (MujocoEngine if scenario.world.empty else MujocoContacts)(scenario, robot)
    return engine, (*engine.warnings, *overlaps())
