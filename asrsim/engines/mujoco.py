"""MuJoCo behind the engine interface.

Without contacts, asrsim computes the step from MuJoCo's rigid-body routines (`asrsim.engines.mujoco_step`), with exact friction
and stops of the joints. With contacts, MuJoCo's solver computes contacts, friction and stops.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from asrsim import compiling
from asrsim.engines import mujoco_step
from asrsim.engines.base import Native, Record, Scene
from asrsim.engines.mujoco_build import base_centre, build, link_body
from asrsim.engines.mujoco_contacts import MujocoContacts
from asrsim.engines.mujoco_library import (
    bound,
    compiled_step,
    library_version,
    load,
    overlaps,
    say_nothing,
    stop_the_clock,
)
from asrsim.engines.mujoco_model import MujocoModel
from asrsim.engines.rigid import RigidEngine, make_room, plain
from asrsim.errors import Problem
from asrsim.packed import pack
from asrsim.robot.engine_text import usable_shapes
from asrsim.robot.inertia import principal_axes
from asrsim.robot.merge import MergedRobot, merge_fixed
from asrsim.robot.model import Link, Robot
from asrsim.robot.poses import rotation_matrix
from asrsim.samples import Array
from asrsim.scenario.data import Scenario


class MujocoEngine(RigidEngine):
    """One robot and its world in MuJoCo."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self._mujoco = mujoco = load()
        # Otherwise MuJoCo writes its warnings to a file in the working folder.
        mujoco.set_mju_user_warning(say_nothing)
        stop_the_clock()
        self.version = f"mujoco {library_version()}"
        self.robot = robot
        self._scenario = scenario
        merged = merge_fixed(robot)
        shaped, self.warnings = usable_shapes(merged.robot, package_paths=scenario.package_paths)
        self._m = self.raw_model = build(mujoco, scenario, shaped)
        data = mujoco.MjData(self._m)
        self.joints = tuple(joint.name for joint in robot.moving_joints)
        self.base = "" if scenario.fixed_base else merged.robot.root.name
        self._centre = base_centre(scenario, merged.robot)
        self._set_inertials(merged.robot.links, data)
        home = self._m.qpos0.copy()
        self.model = MujocoModel(mujoco, self._m, joints=self.joints, home=home, places=self._places(merged))
        self._record = self._make_record(data)
        self._call: Any = None
        super().__init__(self._record.room, home)
        self._words = pack(self._record)
        self._plain_step = partial(bound(mujoco_step.step), plain(self._record))
        self._contacts = None if scenario.world.empty else MujocoContacts(mujoco, self._m, data, scenario.world)

    # -- setting up -------------------------------------------------------------------------------------------------

    def _set_inertials(self, links: Sequence[Link], data: Any) -> None:
        """Set masses, centres of mass and principal moments of inertia from the robot's data."""
        m = self._m
        turn = np.zeros(4)
        for link in links:
            body = m.body(link_body(link.name)).id
            moments, rpy = principal_axes(link)
            self._mujoco.mju_mat2Quat(turn, rotation_matrix(rpy).ravel())
            m.body_mass[body] = link.mass or 0.0
            m.body_inertia[body] = moments
            m.body_ipos[body] = link.centre_of_mass - self._shift(link.name)
            m.body_iquat[body] = turn
        self._mujoco.mj_setConst(m, data)

    def _shift(self, link: str) -> Array:
        """Origin (3,) of the link's MuJoCo body in m, in the frame of the link."""
        return self._centre if link == self.base else np.zeros(3)

    def _places(self, merged: MergedRobot) -> dict[str, tuple[int, Array, Array]]:
        return {
            name: (
                int(self._m.body(link_body(place.body)).id),
                place.pose.position - self._shift(place.body),
                place.pose.rotation,
            )
            for name, place in merged.places.items()
        }

    def _make_record(self, data: Any) -> mujoco_step.Record:
        model = self.model
        room = make_room(
            self.robot, qpos=data.qpos, qvel=data.qvel, joint_q=model.at_q, joint_v=model.at_v,
            free=bool(self.base),
        )  # fmt: skip
        return mujoco_step.make_record(self._m, data, room, self._scenario.wrenches, model.places)

    def _make_native_record(self) -> Record:
        data = self._mujoco.MjData(self._m)
        record = self._make_record(data)
        # All records share the constants that `start` sets.
        record = record._replace(room=record.room._replace(scheme=self._room.scheme))
        words = pack(record)
        return Record(words.ctypes.data, (words, record, data))

    # -- stepping ---------------------------------------------------------------------------------------------------

    def start(
        self, positions: Sequence[float], velocities: Sequence[float], *, step: float, staggered: bool, implicitness: float
    ) -> tuple[Sequence[float], Sequence[float]]:
        """Begin a run; see `asrsim.engines.base.Engine`."""
        super().start(positions, velocities, step=step, staggered=staggered, implicitness=implicitness)
        if self._contacts is not None:
            self._contacts.start(self._room)
        return positions, velocities

    def step(self, exchange: Array, wrenches: Array, lengths: Array) -> None:
        """Advance by one step. The step is compiled after `native` has been read; the results are bitwise identical."""
        if self._contacts is not None:
            self._contacts.step(self._record, self._state, exchange, wrenches, lengths)
        elif self._call is not None:
            arrays = self._words, self._state, exchange, wrenches, lengths
            self._call(*[array.ctypes.data for array in arrays], len(lengths))
        else:
            self._plain_step(self._numbers, exchange.data, wrenches.data, lengths.data)

    @property
    def native(self) -> Native | None:
        """The step compiled by Numba; None with contacts, and if Numba is not installed."""
        if self._contacts is not None or not compiling.available():
            return None
        compiled = compiled_step(compiling.type_of(self._record), self.version)
        self._call = compiled.call
        return Native(compiled.address, len(self._state), self._make_native_record)

    def vary(self, robot: Robot) -> bool:
        """Replace the inertials; see `asrsim.engines.base.Engine`."""
        if robot.links != self.robot.links:
            merged = merge_fixed(robot).robot
            if self._contacts is not None or not np.array_equal(self._centre, base_centre(self._scenario, merged)):
                return False
            self._set_inertials(merged.links, self._mujoco.MjData(self._m))
            self.model.forget()
        self.robot = robot
        return True

    # -- surroundings -----------------------------------------------------------------------------------------------

    def scene(self) -> Scene:
        """Poses of the world's objects, and of a floating base link; contact forces on the objects, and of the ground on the
        robot."""
        poses: dict[str, tuple[float, ...]] = {}
        if self.base:
            turn = np.zeros(9)
            self._mujoco.mju_quat2Mat(turn, self._state[3:7])
            w, *vector = self._state[3:7].tolist()
            poses[self.base] = (*(self._state[:3] - turn.reshape(3, 3) @ self._centre).tolist(), *vector, w)
        if self._contacts is None:
            return Scene(poses, {})
        return Scene(poses | self._contacts.poses(self._state), self._contacts.forces())


def make_mujoco(scenario: Scenario, robot: Robot) -> tuple[MujocoEngine, tuple[Problem, ...]]:
    """The scenario's world in MuJoCo, and warnings about ignored parts of the robot. Raises RobotError, SimulationError."""
    engine = MujocoEngine(scenario, robot)
    return engine, (*engine.warnings, *overlaps())
