"""The engine of a test bench: the motion of the links is prescribed, as on a machine that measures one actuator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from asrsim.compiled import compiling
from asrsim.engines.base import POSITION, VELOCITY, Engine, Native, NativeRecord
from asrsim.engines.rigid import Calculation
from asrsim.errors import SimulationError
from asrsim.robot.model import Robot
from asrsim.samples import Array, grid
from asrsim.scenario.data import Scenario, for_joint
from asrsim.scenario.starts import start_positions
from asrsim.signals import Constant

LONGEST = 50_000_000
"""Largest number of values (steps times joints) of a motion."""


class PrescribedMotion(NamedTuple):
    """The prescribed motion of the links."""

    places: Array
    """Positions (n, joints) at whole steps, rad or m."""
    step: Array
    """Duration (1,) of a step, s."""


def move(motion: Any, state: Any, exchange: Any, wrenches: Any, lengths: Any) -> None:
    """Move the links to the next row of the motion, and set their velocity to the mean over the step. Forces have no effect."""
    end = len(motion.places) - 1
    before, row = min(int(state[0]), end), min(int(state[0]) + 1, end)
    state[0] += 1.0
    last = len(lengths) - 1
    for j in range(motion.places.shape[1]):
        exchange[last, j, POSITION] = motion.places[row, j]
        exchange[last, j, VELOCITY] = (motion.places[row, j] - motion.places[before, j]) / motion.step[0]


def _sizes(motion: Any) -> tuple[int, int, int]:
    return motion.places.shape[1], 0, 6


class BenchEngine(Engine):
    """Joints follow prescribed signals; a joint without a signal is locked. Torques have no effect. After the scenario's
    duration the links stand still. The state is the number of the present row of the motion, (1,)."""

    version = "bench"
    takes_weightless = True

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self._scenario = scenario
        self._robot = robot
        self.joints = tuple(joint.name for joint in robot.moving_joints)
        self._state = np.zeros(1)
        self._motion = PrescribedMotion(np.zeros((0, len(self.joints))), np.zeros(1))

    def start(
        self, positions: Sequence[float], velocities: Sequence[float], *, step: float, staggered: bool, implicitness: float
    ) -> tuple[Sequence[float], Sequence[float]]:
        """Restart the prescribed motion from rest; the given positions and velocities are ignored. Raises SimulationError for a
        motion of more than `LONGEST` values."""
        if step != self._motion.step[0]:
            rows = int(self._scenario.duration / step + 4.0)
            if rows * len(self.joints) > LONGEST:
                raise SimulationError(
                    f"the bench's motion has more than {LONGEST} values: shorten the run, or take larger steps"
                )
            time = grid(0, rows, step)
            starts = start_positions(self._scenario, self._robot)
            signals = [for_joint(self._scenario.motion, name, Constant(value=starts[name])) for name in self.joints]
            columns = self._robot.couplings.expand(np.column_stack([signal.values(time) for signal in signals]))
            self._motion = PrescribedMotion(np.ascontiguousarray(columns), np.array([step]))
            self._calculation = Calculation(move, self._motion, lambda kind: compiling.compile_packed(move, kind, _sizes))
        self._state[:] = 0.0
        return self._motion.places[0].tolist(), [0.0] * len(self.joints)

    def step(self, exchange: Array, wrenches: Array, lengths: Array) -> None:
        """Move the links to the next row of the motion."""
        self._calculation(self._state, exchange, wrenches, lengths)

    @property
    def state(self) -> Array:
        """Number of the present row of the motion, (1,)."""
        return self._state.copy()

    @state.setter
    def state(self, values: Array) -> None:
        self._state[:] = values

    def vary(self, robot: Robot) -> bool:
        """Return True and change nothing, since the inertials of the robot have no effect on a prescribed motion."""
        return True

    @property
    def native(self) -> Native | None:
        """The step compiled by Numba; None if Numba is not installed."""
        if not compiling.numba_available():
            return None
        calculation = self._calculation
        return Native(
            calculation.compile().address, 1, lambda _stride: NativeRecord(calculation.packed.ctypes.data, calculation)
        )


def make(scenario: Scenario, robot: Robot) -> tuple[BenchEngine, tuple[()]]:
    """The scenario's test bench, without warnings."""
    return BenchEngine(scenario, robot), ()
