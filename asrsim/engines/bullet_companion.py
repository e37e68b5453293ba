"""What Bullet's step lacks, from MuJoCo's model of the same robot in the same state: velocity torques of the whole step, exact
friction and stops.

Bullet takes Coriolis and centrifugal torques at velocities half a step late, lets joints creep that friction holds, and gives
velocity torques their whole impulse in a kick that is a part of one. The torques found here make up for all three.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from struct import Struct
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.engines import mujoco_stages as stages
from asrsim.engines.base import EngineKernel, Model
from asrsim.engines.mujoco import MujocoEngine
from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario, World

if TYPE_CHECKING:
    from asrsim.engines.bullet import BulletEngine


def without_stops(robot: Robot) -> Robot:
    """The robot with joints that nothing stops: their stops are the companion's."""
    return replace(robot, joints=tuple(replace(joint, lower=None, upper=None) for joint in robot.joints))


def model_beside(scenario: Scenario, robot: Robot) -> Model:
    """MuJoCo's model of the robot alone."""
    return MujocoEngine(replace(scenario, world=World(), wrenches=()), robot).model


class Companion:
    """Torques on the joints, and what acts on a free base, beside those that Bullet knows of; asked once a step.

    engine: whose companion it is, by a reference that does not keep it. exact: friction and stops, too; Bullet has none then.
    Without it the world may have contacts.
    """

    def __init__(self, engine: BulletEngine, scenario: Scenario, robot: Robot, *, exact: bool) -> None:
        self._engine = engine
        self._exact = exact
        self._mujoco = MujocoEngine(scenario if exact else replace(scenario, world=World(), wrenches=()), robot)
        self._world = self._mujoco.state
        count = len(self._world.positions)
        self._write = Struct(f"{count}d").pack_into
        """Writes numbers into an array's memory, several times faster than NumPy takes them from a list."""
        self._memory = tuple(array.data for array in (self._world.positions, self._world.velocities, self._world.forces))
        self._task = stages.HOLD if exact else stages.CORRECT

    def vary(self, robot: Robot) -> bool:
        """Take over friction; the links are the same."""
        return self._mujoco.vary(robot)

    def accelerate(self) -> None:
        """Through Numba."""
        self._mujoco.accelerate()

    def kernel(self, advance: Callable[[Sequence[float]], None]) -> EngineKernel | None:
        """The same in a compiled loop; a free base has to be asked and pushed from Python. advance: Bullet's step."""
        if self._world.free:
            return None
        return self._mujoco.kernel_of(stages.hold_at if self._exact else stages.correct_at, advance=advance)

    def prepare(self, step: float, *, staggered: bool) -> None:
        """The step in s."""
        self._mujoco.prepare(step, staggered=staggered)

    def reset(self) -> None:
        """A new start."""
        self._world.held[:] = 0

    def forces(self, states: Sequence[Any], forces: Sequence[float]) -> list[float]:
        """`forces` with what Bullet lacks, mean torques in N m; what acts on a free base is applied. states: positions and
        velocities, joint by joint."""
        world = self._world
        positions, velocities, given = self._memory
        self._write(positions, 0, *[state[0] for state in states])
        self._write(velocities, 0, *[state[1] for state in states])
        self._write(given, 0, *forces)
        if world.free:
            self._take_base()
        self._mujoco.stage(self._task)
        if world.free:
            self._engine.push_base(world.lag[:3], self._rotation @ world.lag[3:6])
        return world.forces.tolist()  # type: ignore[no-any-return]

    def first(self, states: Sequence[Any], forces: Sequence[float], fraction: float) -> list[float]:
        """The same for a first kick that is `fraction` of one: torques in N m over the whole step."""
        world = self._world
        scheme = world.scheme.copy()
        world.scheme[1:] = (1.0, 0.0, fraction)
        whole = np.array(self.forces(states, forces)) * fraction
        world.scheme[:] = scheme
        self._start = world.qvel.copy()
        # Bullet gives velocity torques, but not gravity, their whole impulse.
        excess = (1.0 - fraction) * self._mujoco.velocity_torques()
        if world.free:
            self._engine.push_base(excess[:3], self._rotation @ excess[3:6])
        return (whole + excess[world.joint_v]).tolist()  # type: ignore[no-any-return]

    def after_first(self, velocities: Sequence[float]) -> None:
        """The velocity half a step before the start is as if the first kick had been a whole one."""
        world = self._world
        now = world.qvel.copy()
        now[world.joint_v] = velocities
        if world.free:
            now[:6] = self._engine.base_state()[2]
        world.previous[:] = 2.0 * self._start - now

    def _take_base(self) -> None:
        position, self._rotation, velocity = self._engine.base_state()
        self._world.qpos[:3] = position
        self._mujoco.set_orientation(self._rotation)
        self._world.qvel[:6] = velocity

    def set_friction(self, bounds: Sequence[float]) -> None:
        """Coulomb friction of the joints."""
        if self._exact:
            self._mujoco.set_friction(bounds)

    def wrench(self, index: int, values: Sequence[float]) -> None:
        """A wrench of the next step."""
        if self._exact:
            self._mujoco.apply_wrench(index, values)

    def snapshot(self) -> Any:
        """State."""
        return self._world.previous.copy(), self._world.held.copy()

    def restore(self, state: Any) -> None:
        """Continue from a snapshot."""
        self._world.previous[:], self._world.held[:] = state
