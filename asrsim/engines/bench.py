"""The engine of a test bench: the motion of the links is prescribed, as on a machine that measures one actuator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from asrsim import compiling
from asrsim.engines.base import POSITION, VELOCITY, Native, Record, Scene
from asrsim.packed import pack
from asrsim.robot.model import Robot
from asrsim.samples import Array, grid
from asrsim.scenario.data import Scenario, for_joint
from asrsim.signals import Constant
from asrsim.signals.base import Signal

CHUNK = 4096
"""Number of rows of the motion that are sampled in one call."""
LONGEST = 4_000_000
"""Largest size (steps times joints) of a motion that is tabulated in advance, for native steps."""


class MotionTable(NamedTuple):
    """The whole prescribed motion, for native steps."""

    places: Array
    """Positions (n, joints) at whole steps, rad or m; NaN in the last row, since the motion ends with the scenario."""
    speeds: Array
    """Mean velocities (n, joints) over the step before each position, rad/s or m/s."""


def move(table: Any, state: Any, exchange: Any, wrenches: Any, lengths: Any) -> None:
    """Move the links to the next row of the table: the bench prescribes their motion."""
    state[0] += 1.0
    row = min(int(state[0]), len(table.places) - 1)
    last = len(lengths) - 1
    for j in range(table.places.shape[1]):
        exchange[last, j, POSITION] = table.places[row, j]
        exchange[last, j, VELOCITY] = table.speeds[row, j]


def _sizes(table: Any) -> tuple[int, int, int, int]:
    return 1, table.places.shape[1], 0, 6


def link_motion(scenario: Scenario, joint: str) -> Signal:
    """Motion of a joint's link on a bench: the link is locked unless the scenario prescribes a motion."""
    return for_joint(scenario.motion, joint, Constant(value=for_joint(scenario.initial_positions, joint, 0.0)))


class BenchEngine:
    """Joints follow prescribed signals; a joint without a signal is locked. Torques have no effect."""

    model = None
    version = "bench"

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self.joints = tuple(joint.name for joint in robot.moving_joints)
        self._signals = [link_motion(scenario, name) for name in self.joints]
        self._duration = scenario.duration
        self.state = 0

    def start(
        self, positions: Sequence[float], velocities: Sequence[float], *, step: float, staggered: bool, implicitness: float
    ) -> tuple[Sequence[float], Sequence[float]]:
        """Restart the prescribed motion; the given positions and velocities are ignored."""
        self._step, self.state = step, 0
        self._sample(0)
        return self._places[0].tolist(), self._speeds[0].tolist()

    def _sample(self, first: int) -> None:
        """Sample the next rows: positions at whole steps, velocities at half steps; the links are at rest before the start."""
        self._first = first
        self._places, self._speeds = self._motion(first, first + CHUNK)

    def _motion(self, first: int, last: int) -> tuple[Array, Array]:
        """Positions and velocities (n, joints) at the steps `first` to `last` - 1."""
        before = max(first - 1, 0)
        time = grid(before, last - before, self._step)
        positions = np.column_stack([signal.values(time) for signal in self._signals])
        if not first:
            positions = np.concatenate([positions[:1], positions])
        return positions[1:], np.diff(positions, axis=0) / self._step

    def step(self, exchange: Array, wrenches: Array, lengths: Array) -> None:
        """Move the links to the next sampled row."""
        self.state = row = int(self.state) + 1
        if not 0 <= row - self._first < CHUNK:
            self._sample(row)
        exchange[-1, :, POSITION] = self._places[row - self._first]
        exchange[-1, :, VELOCITY] = self._speeds[row - self._first]

    def scene(self) -> Scene:
        """An empty scene: a test bench has no bodies and no contacts."""
        return Scene({}, {})

    def vary(self, robot: Robot) -> bool:
        """True: the robot's inertials have no effect on a prescribed motion."""
        return True

    @property
    def native(self) -> Native | None:
        """A step through a table of the whole motion; None if this table would be larger than `LONGEST`."""
        joints, steps = len(self.joints), self._duration / self._step + 4.0
        if not steps * joints < LONGEST or not compiling.available():
            return None
        table = MotionTable(*(np.ascontiguousarray(rows) for rows in self._motion(0, int(steps))))
        table.places[-1] = table.speeds[-1] = np.nan
        compiled = compiling.compile_packed(move, table, _sizes)
        words = pack(table)
        return Native(compiled.address, 1, lambda: Record(words.ctypes.data, (words, table, compiled)))

    def close(self) -> None:
        """Do nothing: a test bench owns no resources."""
