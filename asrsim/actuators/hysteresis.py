"""Hysteresis of springs: a Dahl element parallel to each spring (Dahl 1968; the Bouc-Wen model with n = 1, beta = gamma).

    dh/dx = (tau - sgn(dx/dt) h) / x_0        h: N m; x: deflection, rad; tau: hysteresis_torque; x_0: hysteresis_deflection

The torque depends on the path, not on time. It is bounded by tau and passive for every motion; the element stores the energy
x_0 h^2 / (2 tau). A cycle between the turning points +-A dissipates 4 tau (A - x_0 tanh(A / x_0)).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, nan

from asrsim.actuators.parameters import DAHL, Parameter
from asrsim.records import constant, value

HYSTERESIS_PARAMETERS = (
    Parameter(
        name="hysteresis_torque", default=0.0, unit="N m", minimum=0.0, source=DAHL, optional=True,
        doc="hysteresis torque of each spring: half the width of its hysteresis loop",
    ),
    Parameter(
        name="hysteresis_deflection", default=0.01, unit="rad", minimum=0.0, exclusive_minimum=True, source=DAHL, optional=True,
        needs="hysteresis_torque",
        doc="deflection over which the hysteresis torque changes its sign after a reversal",
    ),
)  # fmt: skip
"""Parameters of the element."""


@dataclass(slots=True)
class Hysteresis:
    """Memory of the element of one spring."""

    torque: float = value("torque at the last kick", "N m")
    deflection: float = value("deflection at the last kick; NaN before the first kick", "rad", start=nan)
    last_torque: float = value("torque at the previous kick", "N m")
    last_deflection: float = value("deflection at the previous kick", "rad", start=nan)


@dataclass(slots=True)
class HysteresisConstants:
    """Constants of the elements of a joint."""

    level: float = constant("level tau of the torque; 0: no hysteresis", "N m")
    length: float = constant("deflection x_0 over which the torque reverses", "rad")


def hysteresis_of(values: Mapping[str, float]) -> HysteresisConstants | None:
    """Constants for the values of an actuator's parameters; None without hysteresis."""
    level = values["hysteresis_torque"]
    return HysteresisConstants(level, values["hysteresis_deflection"]) if level > 0.0 else None


def stiffness_bound(own: HysteresisConstants) -> float:
    """Largest stiffness in N m/rad that the element adds: where a motion reverses."""
    return own.level / own.length


def hysteresis_torque(memory: Hysteresis, own: HysteresisConstants, deflection: float) -> float:
    """Torque in N m after the deflection has changed from its value at the last kick to `deflection` rad."""
    last = memory.deflection
    # Before the first kick there is no last deflection (NaN), and no change.
    change = deflection - last if last == last else 0.0
    return dahl(memory.torque, change, own.level, own.length)


def remember_deflection(memory: Hysteresis, own: HysteresisConstants, deflection: float) -> None:
    """Advance the element to a deflection in rad."""
    torque = hysteresis_torque(memory, own, deflection)
    memory.last_torque, memory.last_deflection = memory.torque, memory.deflection
    memory.torque, memory.deflection = torque, deflection


def hysteresis_energy(memory: Hysteresis, own: HysteresisConstants) -> float:
    """Energy in J that is stored in the element."""
    return 0.5 * own.length * memory.torque * memory.torque / own.level


def hysteresis_loss(memory: Hysteresis, own: HysteresisConstants) -> float:
    """Energy in J lost between the last two kicks. The result is exact for motion in one direction, so it is never negative."""
    moved = memory.deflection - memory.last_deflection
    now, last = memory.torque, memory.last_torque
    stored = 0.5 * own.length * (now * now - last * last) / own.level
    signed = now - last if moved > 0.0 else last - now
    return own.level * abs(moved) - own.length * signed - stored


def dahl(torque: float, change: float, level: float, length: float) -> float:
    """Torque in N m after the deflection has changed by `change` rad in one direction: the exact solution for any step.

    torque: h before the change in N m; level: tau in N m; length: x_0 in rad.
    """
    if change > 0.0:
        return level + (torque - level) * exp(-change / length)
    return (torque + level) * exp(change / length) - level
