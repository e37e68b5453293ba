"""The electric part of a motor: the torque that a command gives, and the constants of this relation."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from asrsim.actuators.modes import Mode


class Electric(NamedTuple):
    """Relation between command and torque of a motor: tau = gain * command - lag * omega, within the limits."""

    gain: float
    """Torque in N m per unit of the command: 1, N m/A or N m/V."""
    lag: float
    """Damping of the motor in N m s/rad by its back-EMF if the command is a voltage; else 0."""
    damping: float
    """Damping in N m s/rad by the back-EMF while the voltage is at its limit; 0 if the motor has no resistance."""
    stall: float
    """Torque in N m at the voltage limit and at rest; infinite without a limit."""
    limit: float
    """Largest torque of the motor in N m, by its torque limit and its current limit."""

    def torque_of(self, command: Any) -> Any:
        """Torque at rest in N m for a command (number or array)."""
        most = min(self.limit, self.stall)
        return np.clip(self.gain * command, -most, most)


def electric_of(values: Mapping[str, float], index: int, mode: Mode) -> Electric:
    """Electric constants of motor `index`, computed from its parameters."""
    motor = f"motor_{index}"
    limit, resistance = values[f"{motor}_max_torque"], values[f"{motor}_resistance"]
    constant = values[f"{motor}_torque_constant"] * values[f"{motor}_gear_ratio"]
    if constant <= 0.0 or not mode.motor:
        return Electric(1.0 if mode.command == "torque" else 0.0, 0.0, 0.0, inf, limit)
    command = mode.command
    if mode.controller:
        # A controller commands the voltage of an electric motor, or its current if no resistance is stated.
        command = "voltage" if resistance > 0.0 else "current"
    limit = min(limit, constant * values[f"{motor}_max_current"])
    damping, stall = 0.0, inf
    if resistance > 0.0:
        damping, stall = constant * constant / resistance, constant / resistance * values[f"{motor}_max_voltage"]
    if command == "voltage":
        return Electric(constant / resistance if resistance > 0.0 else 0.0, damping, damping, stall, limit)
    return Electric(constant if command == "current" else 1.0, 0.0, damping, stall, limit)


def largest_command(values: Mapping[str, float], index: int, mode: Mode) -> float:
    """Largest direct reference of motor `index` that still raises the torque, in N m, V or A."""
    electric = electric_of(values, index, mode)
    if mode.command == "voltage" and isfinite(values[f"motor_{index}_max_voltage"]):
        return values[f"motor_{index}_max_voltage"]
    return electric.limit / electric.gain if electric.gain > 0.0 else 0.0


NEEDED = {"torque": (), "current": ("torque_constant",), "voltage": ("torque_constant", "resistance")}
"""Motor constants that must be larger than 0, by kind of command."""


def missing_constants(values: Mapping[str, float], motors: int, mode: Mode) -> tuple[str, ...]:
    """Names of the parameters of motors that are 0, although the mode's kind of command (torque, current or voltage) needs
    them."""
    names = (f"motor_{i}_{name}" for i in range(1, motors + 1) for name in NEEDED[mode.command])
    return tuple(name for name in names if values[name] <= 0.0)
