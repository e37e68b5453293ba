"""Heating: the temperature of each motor's winding, and the torque limit that falls where the winding is hot.

    C dT/dt = p tau^2 - (T - T_a) / R        T: temperature; p: R_w / (n k_t)^2, W/(N m)^2; tau: torque of the motor, N m

A winding is one thermal mass with the capacity C. The thermal resistance R connects it to surroundings at the temperature T_a.
The torque limit falls from its full value at `derating_temperature` to 0 at `max_temperature`. The electric resistance of the
winding is constant in this model, although a real winding's resistance rises with the temperature.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp
from typing import Any

from asrsim.actuators.modes import Mode
from asrsim.actuators.parameters import Parameter
from asrsim.actuators.stages.base import Kick, Stage
from asrsim.quantities import of_motors
from asrsim.records import constant, value


@dataclass(slots=True)
class HeatingMemory:
    """State of a winding."""

    rise: float = value("temperature above the temperature of the surroundings, at the next kick", "K")
    temperature: float = value("temperature at the kick", "°C", log="motor_{}_temperature")
    power: float = value("heat at the last kick; -1 before the first kick", "W", start=-1.0)


@dataclass(slots=True)
class HeatingConstants:
    """Constants of a winding."""

    heat: float = constant("heat per squared torque", "W/(N m)^2")
    resistance: float = constant("thermal resistance to the surroundings", "K/W")
    capacity: float = constant("thermal capacity", "J/K")
    ambient: float = constant("temperature of the surroundings", "°C")
    derating: float = constant("temperature above which the torque limit falls", "°C")
    hottest: float = constant("temperature at which the torque limit is 0", "°C")


_OWN: dict[str, Any] = {"optional": True, "source": "one thermal mass; values of a small brushless motor"}
_NEEDS: dict[str, Any] = {"needs": "thermal_resistance", **_OWN}


class Heating(Stage):
    """The winding of each motor."""

    name = "heating"
    title = "Heating of the motors"
    source = "one thermal mass"
    parameters = (
        Parameter(
            name="thermal_resistance", default=0.0, unit="K/W", minimum=0.0, **_OWN,
            doc="thermal resistance from each motor's winding to its surroundings; 0: motors have no temperature",
        ),
        Parameter(
            name="thermal_capacity", default=100.0, unit="J/K", minimum=0.0, exclusive_minimum=True, **_NEEDS,
            doc="thermal capacity of each motor",
        ),
        Parameter(
            name="winding_heat", default=0.0, unit="W/(N m)^2", minimum=0.0, **_NEEDS,
            doc="heat of each winding per squared torque at the output; 0: R / (n k_t)^2 of the electric motor",
        ),
        Parameter(
            name="ambient_temperature", default=25.0, unit="°C", minimum=-273.15, **_NEEDS,
            doc="temperature of the surroundings, and of the motors at the start",
        ),
        Parameter(
            name="derating_temperature", default=80.0, unit="°C", minimum=-273.15, **_NEEDS,
            doc="temperature above which the torque limit falls",
        ),
        Parameter(
            name="max_temperature", default=120.0, unit="°C", minimum=-273.15, **_NEEDS,
            doc="temperature at which the torque limit has fallen to 0",
        ),
    )  # fmt: skip
    Memory = HeatingMemory
    Constants = HeatingConstants
    quantities = of_motors("motor_{}_temperature", "°C", "$T_{}$", "temperature of the winding of motor {}", apart=True)

    @classmethod
    def constants(cls, values: Mapping[str, float], motor: int, mode: Mode) -> HeatingConstants | None:
        heat, torque_constant = values["winding_heat"], values[f"motor_{motor}_torque_constant"]
        if heat == 0.0 and torque_constant > 0.0:
            heat = values[f"motor_{motor}_resistance"] / (torque_constant * values[f"motor_{motor}_gear_ratio"]) ** 2
        if not mode.motor or heat == 0.0 or values["thermal_resistance"] == 0.0:
            return None
        return HeatingConstants(
            heat=heat,
            resistance=values["thermal_resistance"],
            capacity=values["thermal_capacity"],
            ambient=values["ambient_temperature"],
            derating=values["derating_temperature"],
            hottest=values["max_temperature"],
        )

    @staticmethod
    def limit(memory: HeatingMemory, own: HeatingConstants, torque: float) -> float:
        temperature = own.ambient + memory.rise
        if temperature <= own.derating:
            return torque
        if temperature >= own.hottest:
            return 0.0
        return torque * (own.hottest - temperature) / (own.hottest - own.derating)

    @staticmethod
    def remember(memory: HeatingMemory, own: HeatingConstants, kick: Kick) -> None:
        power = own.heat * kick.motor_torque * kick.motor_torque
        last = memory.power if memory.power >= 0.0 else power
        memory.temperature = own.ambient + memory.rise
        # The mean power until the next kick is not yet known, so extrapolate it from the powers at this kick and at the last
        # kick.
        mean = power + 0.5 * (power - last)
        decay = exp(-kick.next_step / (own.resistance * own.capacity))
        memory.rise = memory.rise * decay + own.resistance * mean * (1.0 - decay)
        memory.power = power
