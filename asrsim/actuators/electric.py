"""The electric part of a motor: its torque from its command, and the constants that this needs."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from asrsim.actuators.modes import Mode


class Electric(NamedTuple):
    """Torque of a motor from its command: tau = gain * command - lag * omega, within the limits."""

    gain: float
    """N m per unit of the command: 1, N m/A or N m/V."""
    lag: float
    """N m s/rad: the back-EMF's part where voltage is commanded."""
    damping: float
    """N m s/rad of the back-EMF at full voltage; 0: no limit of the voltage."""
    stall: float
    """N m at full voltage and rest."""
    limit: float
    """N m."""

    def torque_of(self, command: Any) -> Any:
        """Torque at rest in N m for a command, number or array."""
        most = min(self.limit, self.stall)
        return np.clip(self.gain * command, -most, most)


def command_of(values: Mapping[str, float], index: int, mode: Mode) -> str:
    """Command of motor `index`: torque, voltage or current. Controllers of electric motors give one of the latter two."""
    if not (mode.controller and mode.motor) or values.get(f"motor_{index}_torque_constant", 0.0) <= 0.0:
        return mode.command
    return "voltage" if values[f"motor_{index}_resistance"] > 0.0 else "current"


def electric_of(values: Mapping[str, float], index: int, mode: Mode) -> Electric:
    """Constants of motor `index` from its parameters."""
    command, limit = command_of(values, index, mode), values[f"motor_{index}_max_torque"]
    constant = values.get(f"motor_{index}_torque_constant", 0.0) * values.get(f"motor_{index}_gear_ratio", 1.0)
    if constant <= 0.0 or not mode.motor:
        return Electric(1.0 if command == "torque" else 0.0, 0.0, 0.0, inf, limit)
    limit = min(limit, constant * values[f"motor_{index}_max_current"])
    resistance = values[f"motor_{index}_resistance"]
    damping, stall = 0.0, inf
    if resistance > 0.0:
        damping, stall = constant * constant / resistance, constant / resistance * values[f"motor_{index}_max_voltage"]
    if command == "voltage":
        return Electric(constant / resistance if resistance > 0.0 else 0.0, damping, damping, stall, limit)
    return Electric(constant if command == "current" else 1.0, 0.0, damping, stall, limit)


def largest_command(values: Mapping[str, float], index: int, mode: Mode) -> float:
    """Largest useful direct reference of motor `index`: N m, V or A."""
    electric = electric_of(values, index, mode)
    if mode.command == "voltage" and isfinite(values[f"motor_{index}_max_voltage"]):
        return values[f"motor_{index}_max_voltage"]
    return electric.limit / electric.gain if electric.gain > 0.0 else 0.0


NEEDED = {"torque": (), "current": ("torque_constant",), "voltage": ("torque_constant", "resistance")}
"""Command of a mode -> constants of its motors that must be larger than 0."""


def missing_constants(values: Mapping[str, float], motors: int, mode: Mode) -> tuple[str, ...]:
    """Parameters of the motors that must be larger than 0 for the mode's references, and are not."""
    names = (f"motor_{i}_{name}" for i in range(1, motors + 1) for name in NEEDED[mode.command])
    return tuple(name for name in names if values[name] <= 0.0)
