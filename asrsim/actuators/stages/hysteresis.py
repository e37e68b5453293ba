"""Hysteresis of springs: a Dahl element parallel to each spring (Dahl 1968; the Bouc-Wen model with n = 1, beta = gamma).

    dh/dx = (tau - sgn(dx/dt) h) / x_0        h: N m; x: deflection, rad; tau: hysteresis_torque; x_0: hysteresis_deflection

The torque depends on the path and not on time, and its magnitude is at most tau. The element is passive for every motion. It
stores the energy x_0 h^2 / (2 tau). A cycle between the turning points +-A dissipates 4 tau (A - x_0 tanh(A / x_0)).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, nan

from asrsim.actuators.modes import Mode
from asrsim.actuators.parameters import DAHL, Parameter
from asrsim.actuators.stages.base import Kick, Stage
from asrsim.quantities import Quantity
from asrsim.records import constant, value


@dataclass(slots=True)
class HysteresisMemory:
    """Memory of the element of one spring."""

    torque: float = value("torque at the last kick", "N m")
    deflection: float = value("deflection at the last kick; NaN before the first kick", "rad", start=nan)
    last_torque: float = value("torque at the previous kick", "N m")
    last_deflection: float = value("deflection at the previous kick", "rad", start=nan)


@dataclass(slots=True)
class HysteresisConstants:
    """Constants of an element."""

    level: float = constant("level tau of the torque", "N m")
    length: float = constant("deflection x_0 over which the torque reverses", "rad")


class Hysteresis(Stage):
    """The element of each spring."""

    name = "hysteresis"
    title = "Hysteresis of the springs"
    source = DAHL
    parameters = (
        Parameter(
            name="hysteresis_torque", default=0.0, unit="N m", minimum=0.0, source=DAHL, optional=True,
            doc="hysteresis torque of each spring: half the width of its hysteresis loop",
        ),
        Parameter(
            name="hysteresis_deflection", default=0.01, unit="rad", minimum=0.0, exclusive_minimum=True, source=DAHL,
            optional=True, needs="hysteresis_torque",
            doc="deflection over which the hysteresis torque changes its sign after a reversal",
        ),
    )  # fmt: skip
    Memory = HysteresisMemory
    Constants = HysteresisConstants
    lost = "hysteresis_loss"
    quantities = (Quantity(lost, "J", r"$E_h$", "energy lost in the springs' hysteresis since the start", apart=True),)

    @classmethod
    def constants(cls, values: Mapping[str, float], motor: int, mode: Mode) -> HysteresisConstants | None:
        level = values["hysteresis_torque"]
        return HysteresisConstants(level, values["hysteresis_deflection"]) if level > 0.0 else None

    @staticmethod
    def torque(memory: HysteresisMemory, own: HysteresisConstants, deflection: float, velocity: float) -> float:
        return torque_at(memory, own, deflection)

    @staticmethod
    def remember(memory: HysteresisMemory, own: HysteresisConstants, kick: Kick) -> None:
        # The memory advances once in each substep. It must not advance in the shorter steps of a motor, in which the link does
        # not move, since the state of hysteresis would be partly erased.
        now = torque_at(memory, own, kick.deflection)
        memory.last_torque, memory.last_deflection = memory.torque, memory.deflection
        memory.torque, memory.deflection = now, kick.deflection

    @staticmethod
    def energy(memory: HysteresisMemory, own: HysteresisConstants) -> float:
        return 0.5 * own.length * memory.torque * memory.torque / own.level

    @staticmethod
    def loss(memory: HysteresisMemory, own: HysteresisConstants) -> float:
        # The formula is exact for motion in one direction, so that the loss is never negative.
        moved = memory.deflection - memory.last_deflection
        now, last = memory.torque, memory.last_torque
        stored = 0.5 * own.length * (now * now - last * last) / own.level
        signed = now - last if moved > 0.0 else last - now
        return own.level * abs(moved) - own.length * signed - stored

    @staticmethod
    def stiffness_bound(own: HysteresisConstants) -> float:
        # The element is stiffest when the motion reverses. Its torque is then -tau, and begins to approach tau.
        return 2.0 * own.level / own.length


def torque_at(memory: HysteresisMemory, own: HysteresisConstants, deflection: float) -> float:
    """Torque in N m of the element at the deflection `deflection` in rad, which has changed since the last kick."""
    last = memory.deflection
    # In the first kick the last deflection is unknown (NaN), and the change is 0.
    change = deflection - last if last == last else 0.0
    return dahl(memory.torque, change, own.level, own.length)


def dahl(torque: float, change: float, level: float, length: float) -> float:
    """Torque in N m after the deflection has changed by `change` rad in one direction: the exact solution for any step.

    torque: h before the change in N m; level: tau in N m; length: x_0 in rad.
    """
    if change > 0.0:
        return level + (torque - level) * exp(-change / length)
    return (torque + level) * exp(change / length) - level
