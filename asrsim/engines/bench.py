"""A test bench: the links' motion is prescribed, as on a machine that measures one actuator. No dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from asrsim.engines.base import EngineKernel
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario, for_joint
from asrsim.signals import Constant
from asrsim.signals.base import Signal

CHUNK = 4096
"""Rows of the motion that are worked out at once."""
LONGEST = 4_000_000
"""Steps of joints, at most, whose motion is kept as a whole, for compiled loops."""


class Table(NamedTuple):
    """The motion as compiled loops read it."""

    positions: Array
    velocities: Array
    forces: Array
    friction: Array
    wrench: Array
    places: Array
    """(n, joints) rad, m at whole steps."""
    speeds: Array
    """(n, joints) rad/s, m/s between them."""
    row: Any
    """(1,) of both."""


def look(world: Table) -> None:
    """Where links are and how they move."""
    for j in range(len(world.positions)):
        world.positions[j] = world.places[world.row[0], j]
        world.velocities[j] = world.speeds[world.row[0], j]


def move(world: Table) -> None:
    """One step: the bench holds the links."""
    world.row[0] += 1


def _unpack(states: Any, j: int) -> tuple[float, float]:
    return states[0][j], states[1][j]


def link_motion(scenario: Scenario, joint: str) -> Signal:
    """How a bench moves a joint's link: locked where the scenario does not say."""
    return for_joint(scenario.motion, joint, Constant(value=for_joint(scenario.initial_positions, joint, 0.0)))


class BenchEngine:
    """Joints move as signals say (locked without one); torques are taken and change nothing."""

    model = None
    version = "bench"
    unpack = staticmethod(_unpack)

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self.joints = tuple(joint.name for joint in robot.moving_joints)
        self._signals = [link_motion(scenario, name) for name in self.joints]
        self._duration = scenario.duration
        self.prepare(scenario.step, staggered=True)

    def prepare(self, step: float, *, staggered: bool) -> None:
        """The step in s; the motion starts over."""
        self.step = step
        self._row = np.zeros(1, np.int64)
        self._sample(0)

    def _sample(self, first: int) -> None:
        """Positions at whole steps and velocities between them, as a stepping engine has them; at rest before the start."""
        self._first = first
        places, speeds = self._motion(first, first + CHUNK)
        self._positions, self._velocities = places.tolist(), speeds.tolist()

    def _motion(self, first: int, last: int) -> tuple[Array, Array]:
        """(n, joints) positions and velocities at steps from `first` until before `last`."""
        time = np.round(np.arange(max(first - 1, 0), last) * self.step, 12)
        positions = np.column_stack([signal.values(time) for signal in self._signals])
        if not first:
            positions = np.concatenate([positions[:1], positions])
        return positions[1:], np.diff(positions, axis=0) / self.step

    def set_state(self, positions: Sequence[float], velocities: Sequence[float]) -> None:
        """The motion's start: it is prescribed."""
        self.restore(0)

    def states(self) -> tuple[list[float], list[float]]:
        """See `read`."""
        row = int(self._row[0])
        index = row - self._first
        if not 0 <= index < CHUNK:
            self._sample(row)
            index = 0
        return self._positions[index], self._velocities[index]

    read = states

    def states_type(self) -> Any:
        """Raises: a bench is compiled as a whole or not at all."""
        raise NotImplementedError("so long a run of the bench is one in plain Python")

    def set_friction(self, bounds: Sequence[float]) -> None:
        """Nothing: the bench holds the links."""

    def advance(self, forces: Sequence[float], fraction: float = 1.0) -> None:
        """One step: the bench holds the links."""
        self._row[0] += 1

    def snapshot(self) -> int:
        """Where the motion is."""
        return int(self._row[0])

    def restore(self, state: int) -> None:
        """Continue from there."""
        self._row[0] = state

    def vary(self, robot: Robot) -> bool:
        """Nothing of the robot's counts here."""
        return True

    def mechanical_energy(self) -> None:
        """Not a thing of the bench."""

    def apply_wrench(self, index: int, values: Sequence[float]) -> None:
        """Nothing: the bench holds the links."""

    def bodies(self) -> Mapping[str, tuple[float, ...]]:
        """None."""
        return {}

    def contacts(self) -> Mapping[str, tuple[float, float, float]]:
        """None."""
        return {}

    def accelerate(self) -> None:
        """Nothing to compile."""

    def kernel(self) -> EngineKernel | None:
        """The whole motion as a table."""
        joints, steps = len(self.joints), self._duration / self.step + 4.0
        if not steps * joints < LONGEST:
            return None
        positions, velocities, forces, friction = (np.zeros(joints) for _ in range(4))
        places, speeds = map(np.ascontiguousarray, self._motion(0, int(steps)))
        world = Table(positions, velocities, forces, friction, np.zeros((0, 6)), places, speeds, self._row)
        return EngineKernel(move=move, look=look, world=world, compiled={}, version="bench", inline=(__name__,))

    def close(self) -> None:
        """Nothing to release."""
