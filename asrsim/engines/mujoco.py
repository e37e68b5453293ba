"""MuJoCo behind the engine interface.

Without contacts the step is ours (:mod:`asrsim.engines.mujoco_stages`), from MuJoCo's rigid-body routines, and runs compiled
for whole stretches; friction of joints and their stops are exact. With contacts MuJoCo's own solver has all three.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from asrsim.engines import mujoco_stages as stages
from asrsim.engines.base import EngineKernel
from asrsim.engines.mujoco_build import base_centre, build, link_body
from asrsim.engines.mujoco_contacts import MujocoContacts
from asrsim.engines.mujoco_library import (
    compiled_stage,
    library_version,
    load,
    overlaps,
    plain_stage,
    say_nothing,
    stop_the_clock,
)
from asrsim.engines.mujoco_model import MujocoModel
from asrsim.engines.mujoco_world import make_world, plain_world
from asrsim.errors import Problem
from asrsim.packed import pack
from asrsim.robot.engine_text import usable_shapes
from asrsim.robot.inertia import principal_axes
from asrsim.robot.merge import MergedRobot, merge_fixed
from asrsim.robot.model import Link, Robot
from asrsim.robot.poses import rotation_matrix
from asrsim.samples import Array
from asrsim.scenario.data import Scenario, for_joint


def _unpack(states: tuple[Array, Array], j: int) -> tuple[float, float]:
    return float(states[0][j]), float(states[1][j])


class MujocoEngine:
    """One robot and its world."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self._mujoco = mujoco = load()
        # MuJoCo would write its warnings into a file of the working folder.
        mujoco.set_mju_user_warning(say_nothing)
        stop_the_clock()
        self.version = f"mujoco {library_version()}"
        self.robot = robot
        self._scenario = scenario
        merged = merge_fixed(robot)
        contacts = not scenario.world.empty
        shaped, self.warnings = usable_shapes(merged.robot, package_paths=scenario.package_paths)
        self._m = self.raw_model = build(mujoco, scenario, shaped)
        self._d = mujoco.MjData(self._m)
        self.joints = tuple(joint.name for joint in robot.moving_joints)
        self.base = "" if scenario.fixed_base else merged.robot.root.name
        self._centre = base_centre(scenario, merged.robot)
        self._set_inertials(merged.robot.links)
        places = self._places(merged)
        self._home = self._m.qpos0.copy()
        self.model = MujocoModel(mujoco, self._m, joints=self.joints, home=self._home, places=places)
        self._at_q, self._at_v = self.model.at_q, self.model.at_v
        self._contacts = MujocoContacts(mujoco, self._m, self._d, scenario.world) if contacts else None
        self._world = self.state = make_world(
            self._m, self._d, robot, at_q=self._at_q, at_v=self._at_v, free=bool(self.base), wrenches=scenario.wrenches,
            places=places,
        )  # fmt: skip
        self._packed = pack(self._world)
        self.stage: Callable[[int], None] = partial(plain_stage(), plain_world(self._world))
        """Runs one of the stages of :mod:`asrsim.engines.mujoco_stages`."""
        positions = [float(for_joint(scenario.initial_positions, name, 0.0)) for name in self.joints]
        self.prepare(scenario.step, staggered=True)
        self.set_state(positions, [0.0] * len(positions))

    # -- setting up -------------------------------------------------------------------------------------------------

    def _set_inertials(self, links: Sequence[Link]) -> None:
        """Masses, centres and principal moments as the robot's data have them."""
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
        self._mujoco.mj_setConst(m, self._d)

    def _shift(self, link: str) -> Array:
        """(3,) m: origin of a link's body in the link's frame."""
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

    def prepare(self, step: float, *, staggered: bool) -> None:
        """Before the first step."""
        self._world.scheme[:] = (step, 1.5, -0.5, 1.0) if staggered else (step, 1.0, 0.0, 1.0)
        self._weights = tuple(self._world.scheme[1:3].tolist())
        if self._contacts is not None:
            self._contacts.tune(self._world)

    def set_state(self, positions: Sequence[float], velocities: Sequence[float]) -> None:
        """Joints there, moving so; everything else as at the start."""
        self._mujoco.mj_resetData(self._m, self._d)
        world = self._world
        world.qpos[:] = self._home
        world.qpos[self._at_q] = positions
        world.qvel[self._at_v] = velocities
        world.previous[:] = world.qvel
        world.held[:] = 0

    # -- stepping ---------------------------------------------------------------------------------------------------

    def states(self) -> tuple[Array, Array]:
        """Positions and velocities of the joints, the engine's own arrays."""
        self.stage(stages.LOOK)
        return self._world.positions, self._world.velocities

    unpack = staticmethod(_unpack)

    def states_type(self) -> Any:
        """Numba's type of `states`."""
        import numba

        kinds: Any = numba
        return kinds.typeof((self._world.positions, self._world.velocities))

    def read(self) -> tuple[list[float], list[float]]:
        """Positions and velocities of the joints."""
        positions, velocities = self.states()
        return positions.tolist(), velocities.tolist()

    def set_friction(self, bounds: Sequence[float]) -> None:
        """Coulomb friction of the joints."""
        self._world.friction[:] = bounds

    def advance(self, forces: Sequence[float], fraction: float = 1.0) -> None:
        """One step under mean torques."""
        world = self._world
        world.forces[:] = forces
        start = None
        if fraction != 1.0:
            start = world.qvel.copy()
            world.scheme[1:] = (1.0, 0.0, fraction)
        if self._contacts is not None:
            self._contacts.move(world)
        else:
            self.stage(stages.MOVE)
        if start is not None:
            # The velocity half a step before the start, as if the first kick had been a whole one.
            world.previous[:] = 2.0 * start - world.qvel
            world.scheme[1:] = (*self._weights, 1.0)

    def set_orientation(self, rotation: Array) -> None:
        """Turn a floating base."""
        self._mujoco.mju_mat2Quat(self._world.qpos[3:7], np.ascontiguousarray(rotation).ravel())

    def velocity_torques(self) -> Array:
        """(v,) N m, N: Coriolis and centrifugal torques in the state that the stages saw last."""
        velocity = self._d.qvel.copy()
        both = np.zeros((2, self._m.nv))
        for row, speed in zip(both, (velocity, 0.0), strict=True):
            self._d.qvel[:] = speed
            self._mujoco.mj_comVel(self._m, self._d)
            self._mujoco.mj_rne(self._m, self._d, 0, row)
        self._d.qvel[:] = velocity
        difference: Array = both[0] - both[1]
        return difference

    def apply_wrench(self, index: int, values: Sequence[float]) -> None:
        """Force and torque of wrench `index` for the next step."""
        self._world.wrench[index] = values

    def accelerate(self) -> None:
        """Steps from Python through compiled code, too."""
        self.stage = partial(compiled_stage(self._world, self.version).call, self._packed.ctypes.data)

    def kernel(self) -> EngineKernel | None:
        """The step for compiled loops; with contacts there is none."""
        return self.kernel_of(stages.move_at, stages.look_at) if self._contacts is None else None

    def kernel_of(
        self,
        move: Callable[[Any], None],
        look: Callable[[Any], None] | None = None,
        advance: Callable[[Sequence[float]], None] | None = None,
    ) -> EngineKernel:
        """Of compiled stages; see :class:`asrsim.engines.base.EngineKernel`."""
        from numba import types

        world, packed = self._world, compiled_stage(self._world, self.version)
        handle = stages.Handle(
            self._packed.ctypes.data, world.positions, world.velocities, world.forces, world.wrench, world.friction
        )
        symbol = types.ExternalFunction(packed.symbol, types.void(types.intp, types.intp))
        return EngineKernel(
            move=move, look=look, advance=advance, world=handle, compiled={"compiled_stage": symbol}, version=self.version
        )

    def vary(self, robot: Robot) -> bool:
        """Take over inertials and friction."""
        if self._contacts is not None:
            return False
        if robot.links != self.robot.links:
            merged = merge_fixed(robot).robot
            if not np.array_equal(self._centre, base_centre(self._scenario, merged)):
                return False
            self._set_inertials(merged.links)
            self.model.forget()
        self._world.friction[:] = [joint.friction for joint in robot.moving_joints]
        self.robot = robot
        return True

    def snapshot(self) -> Any:
        """The engine's whole state."""
        world = self._world
        warm = self._d.qacc_warmstart.copy()
        return tuple(array.copy() for array in (world.qpos, world.qvel, world.previous, world.held)), warm, self._d.time

    def restore(self, state: Any) -> None:
        """Continue from a snapshot."""
        world = self._world
        arrays, warm, self._d.time = state
        for array, saved in zip((world.qpos, world.qvel, world.previous, world.held), arrays, strict=True):
            array[:] = saved
        self._d.qacc_warmstart[:] = warm

    # -- what is around ---------------------------------------------------------------------------------------------

    def mechanical_energy(self) -> float | None:
        """Kinetic and gravitational energy of the robot's links in J; None with contacts or a free base."""
        if self.base or self._contacts is not None:
            return None
        q, v = self._world.qpos[self._at_q], self._world.qvel[self._at_v]
        return 0.5 * float(v @ self.model.mass_matrix(q) @ v) + self.model.potential_energy(q)

    def bodies(self) -> Mapping[str, tuple[float, ...]]:
        """Poses of the world's objects, and of the base link if it floats."""
        qpos = self._world.qpos
        poses: dict[str, tuple[float, ...]] = {}
        if self.base:
            turn = np.zeros(9)
            self._mujoco.mju_quat2Mat(turn, qpos[3:7])
            origin = qpos[:3] - turn.reshape(3, 3) @ self._centre
            poses[self.base] = (*origin.tolist(), *qpos[4:7].tolist(), float(qpos[3]))
        return poses | (self._contacts.poses() if self._contacts is not None else {})

    def contacts(self) -> Mapping[str, tuple[float, float, float]]:
        """Contact forces on the world's objects and on the robot by the ground."""
        return {} if self._contacts is None else self._contacts.forces()

    def close(self) -> None:
        """Nothing that Python does not release."""


def make_mujoco(scenario: Scenario, robot: Robot) -> tuple[MujocoEngine, tuple[Problem, ...]]:
    """The scenario's world in MuJoCo, and warnings of what the engine does not take. Raises RobotError, SimulationError."""
    engine = MujocoEngine(scenario, robot)
    return engine, (*engine.warnings, *overlaps())
