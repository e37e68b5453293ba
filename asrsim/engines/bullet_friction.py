"""Exact Coulomb friction and stops of joints for Bullet, by the rule that the MuJoCo engine has; Bullet steps, unaware of
them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from asrsim.engines import mujoco_stages as stages
from asrsim.engines.mujoco import MujocoEngine
from asrsim.engines.mujoco_library import compile_stage, plain_stage
from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario

if TYPE_CHECKING:
    from asrsim.engines.bullet import BulletEngine


def without_stops(robot: Robot) -> Robot:
    """The robot with free ways of its joints: their stops are somebody else's."""
    return replace(robot, joints=tuple(replace(joint, lower=None, upper=None) for joint in robot.joints))


class ExactFriction:
    """The torques that hold and brake the joints, found on MuJoCo's model of the same robot in the same state."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self._engine = MujocoEngine(scenario, robot)
        self._world = self._engine.state
        self._hold: Any = plain_stage(stages.hold)

    def accelerate(self) -> None:
        """Through Numba."""
        self._hold = compile_stage(stages.hold, self._world, self._engine.version)

    def prepare(self, step: float, *, staggered: bool) -> None:
        """The step in s."""
        self._engine.prepare(step, staggered=staggered)

    def reset(self) -> None:
        """A new start."""
        self._world.held[:] = 0
        self._fresh = True

    def forces(
        self,
        engine: BulletEngine,
        positions: list[float],
        velocities: list[float],
        forces: Sequence[float],
        fraction: float = 1.0,
    ) -> list[float]:
        """`forces` with those of friction and stops, mean torques in N m over the kick."""
        world = self._world
        world.qpos[world.joint_q] = positions
        world.qvel[world.joint_v] = velocities
        if world.free:
            place, rotation, velocity = engine.base_state()
            world.qpos[:3] = place
            self._engine.set_orientation(rotation)
            world.qvel[:6] = velocity
        if self._fresh:
            world.previous[:] = world.qvel
            self._fresh = False
        self._start = world.qvel.copy()
        kept = world.scheme.copy()
        if fraction != 1.0:
            world.scheme[1:] = (1.0, 0.0, fraction)
        world.forces[:] = forces
        self._hold(world)
        world.scheme[:] = kept
        world.wrench[:] = 0.0
        return world.forces.tolist()  # type: ignore[no-any-return]

    def after_first(self, engine: BulletEngine, velocities: list[float]) -> None:
        """The velocity half a step before the start is as if the first kick had been a whole one."""
        world = self._world
        now = world.qvel.copy()
        now[world.joint_v] = velocities
        if world.free:
            now[:6] = engine.base_state()[2]
        world.previous[:] = 2.0 * self._start - now

    def wrench(self, index: int, values: Sequence[float]) -> None:
        """A wrench of the next step."""
        self._engine.apply_wrench(index, values)

    def snapshot(self) -> Any:
        """State."""
        return self._world.previous.copy(), self._world.held.copy(), self._fresh

    def restore(self, state: Any) -> None:
        """Continue from a snapshot."""
        self._world.previous[:], self._world.held[:], self._fresh = state
