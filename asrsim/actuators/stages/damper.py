"""Damper: a viscous damper parallel to each spring, between motor and link.

    tau = c (dtheta/dt - dq/dt)        tau: N m on the link; c: spring_damping; theta, q: positions of motor and link, rad

The law receives the velocity at the time of the kick, so that the error of the torque is of second order in the step. In modes
without motor dynamics, motors have the speed of their references; a jump of a reference causes no damping torque.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from asrsim.actuators.modes import Mode
from asrsim.actuators.parameters import Parameter
from asrsim.actuators.stages.base import Kick, Stage
from asrsim.quantities import Quantity
from asrsim.records import constant, value


@dataclass(slots=True)
class DamperMemory:
    """Losses of a damper."""

    lost: float = value("energy lost between the last two kicks", "J")
    power: float = value("power lost at the last kick", "W")


@dataclass(slots=True)
class DamperConstants:
    """Constants of a damper."""

    damping: float = constant("damping c", "N m s/rad")


class Damper(Stage):
    """The damper of each spring."""

    name = "damper"
    title = "Damper parallel to the springs"
    source = "viscous damper: Kelvin-Voigt model of a spring"
    parameters = (
        Parameter(
            name="spring_damping",
            default=0.0,
            unit="N m s/rad",
            minimum=0.0,
            source=source,
            optional=True,
            doc="viscous damping c parallel to each spring, between motor and link",
        ),
    )
    Memory = DamperMemory
    Constants = DamperConstants
    lost = "damper_loss"
    quantities = (Quantity(lost, "J", r"$E_c$", "energy lost in the springs' dampers since the start", apart=True),)

    @classmethod
    def constants(cls, values: Mapping[str, float], motor: int, mode: Mode) -> DamperConstants | None:
        damping = values["spring_damping"]
        return DamperConstants(damping) if damping > 0.0 else None

    @staticmethod
    def torque(memory: DamperMemory, own: DamperConstants, deflection: float, velocity: float) -> float:
        return own.damping * velocity

    @staticmethod
    def remember(memory: DamperMemory, own: DamperConstants, kick: Kick) -> None:
        power = own.damping * kick.velocity * kick.velocity
        memory.lost = 0.5 * kick.step * (memory.power + power)
        memory.power = power

    @staticmethod
    def loss(memory: DamperMemory, own: DamperConstants) -> float:
        return memory.lost

    @staticmethod
    def damping_bound(own: DamperConstants) -> float:
        return own.damping
