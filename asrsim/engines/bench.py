"""The engine of a test bench: the motion of the links is prescribed, as on a machine that measures one actuator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from asrsim import compiling
from asrsim.engines.base import POSITION, VELOCITY, Engine, Native, Record
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


class Motion(NamedTuple):
    """The prescribed motion, for native steps."""

    places: Array
    """Positions (n, joints) at whole steps, rad or m."""
    step: Array
    """Duration (1,) of a step, s."""


def move(motion: Any, state: Any, exchange: Any, wrenches: Any, lengths: Any) -> None:
    """Move the links to the next row of the motion, with the mean velocity of the step: the bench prescribes their motion."""
    end = len(motion.places) - 1
    before, row = min(int(state[0]), end), min(int(state[0]) + 1, end)
    state[0] += 1.0
    last = len(lengths) - 1
    for j in range(motion.places.shape[1]):
        exchange[last, j, POSITION] = motion.places[row, j]
        exchange[last, j, VELOCITY] = (motion.places[row, j] - motion.places[before, j]) / motion.step[0]


def _sizes(motion: Any) -> tuple[int, int, int]:
    return motion.places.shape[1], 0, 6


def link_motion(scenario: Scenario, joint: str) -> Signal:
    """Motion of a joint's link on a bench: the link is locked unless the scenario prescribes a motion."""
    return for_joint(scenario.motion, joint, Constant(value=for_joint(scenario.initial_positions, joint, 0.0)))


class BenchEngine(Engine):
    """Joints follow prescribed signals; a joint without a signal is locked. Torques have no effect. After the scenario's
    duration the links stand still."""

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
        """Restart the prescribed motion from rest; the given positions and velocities are ignored."""
        self._step, self.state = step, 0
        self._rows = int(self._duration / step + 4.0)
        self._first, self._places = 0, self._motion(0, CHUNK)
        return self._places[0].tolist(), [0.0] * len(self.joints)

    def _motion(self, first: int, count: int) -> Array:
        """Positions (count, joints) from the step `first` on."""
        time = np.minimum(grid(first, count, self._step), grid(self._rows - 1, 1, self._step))
        return np.column_stack([signal.values(time) for signal in self._signals])

    def step(self, exchange: Array, wrenches: Array, lengths: Array) -> None:
        """Move the links to the next sampled row."""
        before = int(self.state) - self._first
        if not 0 <= before < CHUNK - 1:
            self._first, before = int(self.state), 0
            self._places = self._motion(self._first, CHUNK)
        self.state = int(self.state) + 1
        exchange[-1, :, POSITION] = self._places[before + 1]
        exchange[-1, :, VELOCITY] = (self._places[before + 1] - self._places[before]) / self._step

    def vary(self, robot: Robot) -> bool:
        """True: the robot's inertials have no effect on a prescribed motion."""
        return True

    @property
    def native(self) -> Native | None:
        """A step through a table of the whole motion; None if this table would be larger than `LONGEST`."""
        if not self._rows * len(self.joints) < LONGEST or not compiling.available():
            return None
        motion = Motion(np.ascontiguousarray(self._motion(0, self._rows)), np.array([self._step]))
        compiled = compiling.compile_packed(move, motion, _sizes)
        words = pack(motion)
        return Native(compiled.address, 1, lambda: Record(words.ctypes.data, (words, motion, compiled)))


def make(scenario: Scenario, robot: Robot) -> tuple[BenchEngine, tuple[()]]:
    """The scenario's test bench, without warnings."""
    return BenchEngine(scenario, robot), ()
