"""Joints of one kind, whose laws are evaluated together on arrays (joints, n)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.actuators import Actuator
from asrsim.samples import Array, picking
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.substep import RAW

MOTOR_1, MOTOR_2 = RAW.index("position_1"), RAW.index("position_2")
"""Columns of the raw record: position, mean velocity, torque and friction of a motor."""


@dataclass(frozen=True, kw_only=True)
class Group:
    """Joints with the same actuator and the same motors."""

    actuator: type[Actuator]
    motors: int
    """Motors with dynamics in their modes."""
    drives: tuple[SteppedJoint, ...]
    pick: Any
    """Picks their rows of an array (joints, n), as :func:`asrsim.samples.picking` says."""

    @property
    def elastic(self) -> tuple[Any, ...]:
        """Parameters of the springs, for laws on arrays: numbers, or columns (joints, 1) where the joints differ."""
        return tuple(map(column, zip(*(drive.elastic for drive in self.drives), strict=True)))

    def value(self, name: str) -> Any:
        """A parameter of all joints, likewise."""
        return column([drive.values[name] for drive in self.drives])

    def electricity(self, raw: Array) -> dict[str, Array]:
        """Currents in A and voltages in V of the motors, (joints, n), of their records (columns, joints, n); NaN where a motor
        is not electric. Both belong to the whole step: the torque is that of the kick at its middle."""
        found = {}
        for i, first in zip(range(1, self.motors + 1), (MOTOR_1, MOTOR_2), strict=False):
            constant = np.asarray(self.value(f"motor_{i}_torque_constant")) * self.value(f"motor_{i}_gear_ratio")
            velocity, torque = raw[first + 1], raw[first + 2]
            current = torque / np.where(constant > 0.0, constant, np.nan)
            found[f"motor_{i}_current"] = current
            found[f"motor_{i}_voltage"] = self.value(f"motor_{i}_resistance") * current + constant * velocity
        return found


def spring_groups(drives: Sequence[SteppedJoint]) -> tuple[Group, ...]:
    """Groups of the joints whose mode has springs."""
    members: dict[tuple[type[Actuator], int], list[int]] = {}
    for j, drive in enumerate(drives):
        if drive.actuator and drive.mode and drive.mode.spring:
            members.setdefault((drive.actuator, drive.dynamic_motors), []).append(j)
    return tuple(
        Group(actuator=actuator, motors=motors, drives=tuple(drives[j] for j in rows), pick=picking(rows))
        for (actuator, motors), rows in members.items()
    )


def column(values: Sequence[float]) -> Any:
    """A parameter of all joints, for arrays (joints, n): a number, or (joints, 1) where the joints differ."""
    return values[0] if len(set(values)) == 1 else np.array(values, dtype=float)[:, None]
