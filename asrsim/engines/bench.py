"""A test bench: the links' motion is prescribed, as on a machine that measures one actuator. No dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario, for_joint
from asrsim.signals import Constant
from asrsim.signals.base import Signal

CHUNK = 4096


class BenchEngine:
    """Joints move as signals say (locked without one); torques are taken and change nothing."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self.joints = tuple(joint.name for joint in robot.moving_joints)
        self._signals: list[Signal] = [
            for_joint(scenario.motion, name, Constant(value=for_joint(scenario.initial_positions, name, 0.0)))
            for name in self.joints
        ]
        self.set_step(scenario.step)

    def set_step(self, step: float) -> None:
        """Change the step; the motion starts over."""
        self.step = step
        self._k = 0
        self._first = 0
        self._rows = self._sample(0)

    def _sample(self, first: int) -> list[tuple[tuple[float, float, None, None], ...]]:
        """Positions at whole steps and velocities between them, as a stepping engine has them; at rest before the start."""
        time = np.round(np.arange(max(first - 1, 0), first + CHUNK) * self.step, 12)
        positions = np.column_stack([signal.values(time) for signal in self._signals])
        if not first:
            positions = np.concatenate([positions[:1], positions])
        velocities = np.diff(positions, axis=0) / self.step
        return [
            tuple((q, v, None, None) for q, v in zip(row, speeds, strict=True))
            for row, speeds in zip(positions[1:].tolist(), velocities.tolist(), strict=True)
        ]

    def read(self) -> Sequence[tuple[float, float, None, None]]:
        """Position and velocity of each joint."""
        index = self._k - self._first
        if index >= CHUNK:
            self._first = self._k
            self._rows = self._sample(self._first)
            index = 0
        return self._rows[index]

    def apply(self, *, forces: Sequence[float]) -> None:
        """Nothing: the bench holds the links."""

    def advance(self) -> None:
        """One step."""
        self._k += 1

    def half_advance(self) -> None:
        """One step."""
        self._k += 1

    def mass_matrix(self, positions: Sequence[float] | None = None) -> Array:
        """Links that nothing can move."""
        return 1e9 * np.eye(len(self.joints))

    def bias_difference(
        self, positions: Sequence[float], velocities: Sequence[float], others: Sequence[float]
    ) -> list[float] | None:
        """None: no dynamics."""
        return None

    def gravity_torques(self, positions: Sequence[float] | None = None) -> Array:
        """(n,) zeros."""
        return np.zeros(len(self.joints))

    def mechanical_energy(self) -> float:
        """0: not a thing of the bench."""
        return 0.0

    def apply_wrench(
        self, link: str, force: Sequence[float], torque: Sequence[float], point: Sequence[float], frame: str
    ) -> None:
        """Nothing: the bench holds the links."""

    def bodies(self) -> Mapping[str, tuple[float, ...]]:
        """None."""
        return {}

    def contacts(self) -> Mapping[str, tuple[float, float, float]]:
        """None."""
        return {}

    def close(self) -> None:
        """Nothing to release."""
