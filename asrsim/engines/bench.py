"""A test bench: the links' motion is prescribed, as on a machine that measures one actuator. No dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario, for_joint
from asrsim.signals import Constant
from asrsim.signals.base import Signal

CHUNK = 4096


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
        self.prepare(scenario.step, staggered=True)

    def prepare(self, step: float, *, staggered: bool) -> None:
        """The step in s; the motion starts over."""
        self.step = step
        self._staggered = staggered
        self._k = 0
        self._sample(0)

    def _sample(self, first: int) -> None:
        """Positions at whole steps and velocities between them, as a stepping engine has them; at rest before the start."""
        self._first = first
        time = np.round(np.arange(max(first - 1, 0), first + CHUNK) * self.step, 12)
        positions = np.column_stack([signal.values(time) for signal in self._signals])
        if not first:
            positions = np.concatenate([positions[:1], positions])
        self._velocities = (np.diff(positions, axis=0) / self.step).tolist()
        self._positions = positions[1:].tolist()

    def set_state(self, positions: Sequence[float], velocities: Sequence[float]) -> None:
        """The motion's start: it is prescribed."""
        self.restore(0)

    def states(self) -> tuple[list[float], list[float]]:
        """See `read`."""
        index = self._k - self._first
        if not 0 <= index < CHUNK:
            self._sample(self._k)
            index = 0
        return self._positions[index], self._velocities[index]

    read = states

    def states_type(self) -> Any:
        """Raises: there is nothing to be won by compiling a bench."""
        raise NotImplementedError("the bench runs in plain Python")

    def set_friction(self, bounds: Sequence[float]) -> None:
        """Nothing: the bench holds the links."""

    def advance(self, forces: Sequence[float], fraction: float = 1.0) -> None:
        """One step: the bench holds the links."""
        self._k += 1

    def snapshot(self) -> int:
        """Where the motion is."""
        return self._k

    def restore(self, state: int) -> None:
        """Continue from there."""
        self._k = state

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

    def kernel(self) -> None:
        """None."""

    def close(self) -> None:
        """Nothing to release."""
