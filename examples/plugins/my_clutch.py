"""A plugin with a stage: a clutch parallel to each spring, a smooth dry friction between motor and link.

tau = s tanh(v / v_0), with the rate v of the deflection. The clutch loses s v tanh(v / v_0) W and stores nothing.

Use the stage:    asrsim run scenario.yaml --set parameters.joint_1.clutch_torque=0.2 --plugin my_clutch.py
Check the stage:  asrsim check --stage clutch --plugin my_clutch.py
"""

from __future__ import annotations

from dataclasses import dataclass
from math import tanh

from asrsim.actuators import Parameter
from asrsim.actuators.stages import Stage
from asrsim.quantities import Quantity, of_motors
from asrsim.records import constant, value


@dataclass(slots=True)
class ClutchMemory:
    """Memory of the clutch of one spring."""

    power: float = value("power lost at the last kick", "W")
    lost: float = value("energy lost between the last two kicks", "J")
    slip: float = value("rate of the deflection", "rad/s", log="clutch_{}_slip")


@dataclass(slots=True)
class ClutchConstants:
    """Constants of a clutch."""

    level: float = constant("torque s of the sliding clutch", "N m")
    speed: float = constant("speed v_0", "rad/s")


class Clutch(Stage):
    """The clutch of each spring."""

    name = "clutch"
    title = "Clutch parallel to the springs"
    source = "an example of the asrsim documentation"
    parameters = (
        Parameter(name="clutch_torque", default=0.0, unit="N m", minimum=0.0, optional=True, doc="torque s while it slides"),
        Parameter(name="clutch_speed", default=0.1, unit="rad/s", minimum=0.0, exclusive_minimum=True, optional=True,
                  needs="clutch_torque", doc="speed v_0 at which 76 % of the torque act"),
    )  # fmt: skip
    Memory, Constants = ClutchMemory, ClutchConstants
    lost = "clutch_loss"
    quantities = (
        Quantity("clutch_loss", "J", "$E_s$", "energy lost in the clutches since the start", apart=True),
        *of_motors("clutch_{}_slip", "rad/s", "$v_{}$", "rate of the deflection at motor {}", apart=True),
    )

    @classmethod
    def constants(cls, values, motor, mode):
        level = values["clutch_torque"]
        return ClutchConstants(level, values["clutch_speed"]) if level > 0.0 else None

    @staticmethod
    def torque(memory, own, deflection, velocity):
        return own.level * tanh(velocity / own.speed)

    @staticmethod
    def remember(memory, own, kick):
        power = own.level * tanh(kick.velocity / own.speed) * kick.velocity
        memory.lost = 0.5 * kick.step * (memory.power + power)
        memory.power, memory.slip = power, kick.velocity

    @staticmethod
    def loss(memory, own):
        return memory.lost

    @staticmethod
    def damping_bound(own):
        return own.level / own.speed
