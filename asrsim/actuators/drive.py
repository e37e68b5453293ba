"""The drive of one joint: an actuator in a mode with values of its parameters, and quantities that follow from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from asrsim.actuators.electric import Electric, electric_of
from asrsim.actuators.hysteresis import hysteresis_of
from asrsim.actuators.motor import motor_numbers
from asrsim.actuators.vectorised import Array, over_arrays

if TYPE_CHECKING:
    from asrsim.actuators.base import Actuator
    from asrsim.actuators.modes import Mode


@dataclass(frozen=True, kw_only=True)
class Drive:
    """An actuator on its joint, for simulation, gravity compensation and learning.

    Tuples of controllers and motors have an entry for each motor; they are empty in modes without controllers or motors.
    """

    joint: str
    actuator: type[Actuator]
    mode: Mode
    values: Mapping[str, float]
    """Parameter values by name."""

    @cached_property
    def elastic(self) -> tuple[float, ...]:
        """Parameters of the spring in the order of its laws."""
        return self.actuator.law_values(self.values)

    @property
    def max_deflection(self) -> float:
        """rad beyond which the springs' torques stay constant; infinite for a law without that parameter."""
        return self.values.get("max_deflection", math.inf)

    @cached_property
    def hysteresis(self) -> tuple[float, float] | None:
        """Level (N m) and length (rad) of the springs' hysteresis; None where there is none."""
        return hysteresis_of(self.values) if self.mode.spring else None

    @property
    def dynamic_motors(self) -> int:
        """Motors with dynamics in this mode."""
        return self.actuator.motors if self.mode.motor else 0

    @cached_property
    def electric(self) -> tuple[Electric, ...]:
        """Relation between command and torque of each motor."""
        return tuple(electric_of(self.values, i, self.mode) for i in range(1, self.actuator.motors + 1))

    @cached_property
    def proportional(self) -> tuple[float, ...]:
        """N m/rad, gain of each controller, converted from volts or amperes for electric motors."""
        return self._gains("proportional")

    @cached_property
    def integral(self) -> tuple[float, ...]:
        """N m/(rad s)."""
        return self._gains("integral")

    @cached_property
    def derivative(self) -> tuple[float, ...]:
        """N m s/rad."""
        return self._gains("derivative")

    @cached_property
    def max_torque(self) -> tuple[float, ...]:
        """N m of each motor at rest."""
        return tuple(min(one.limit, one.stall) for one in self.electric) if self.mode.motor else ()

    @cached_property
    def motor_inertia(self) -> tuple[float, ...]:
        """kg m^2."""
        return self._of_motors("inertia")

    @cached_property
    def motor_damping(self) -> tuple[float, ...]:
        """N m s/rad, with the back-EMF where voltage is commanded."""
        return tuple(d + one.lag for d, one in zip(self._of_motors("damping"), self.electric, strict=False))

    @cached_property
    def motor_friction(self) -> tuple[float, ...]:
        """N m."""
        return self._of_motors("friction_torque")

    @cached_property
    def max_velocity(self) -> tuple[float, ...]:
        """rad/s."""
        return self._of_motors("max_velocity")

    @cached_property
    def motor_ranges(self) -> tuple[tuple[float, float], ...]:
        """rad, least and largest position of each motor."""
        return tuple(zip(self._of_motors("min_position"), self._of_motors("max_position"), strict=True))

    def motor_numbers(self, index: int) -> tuple[float, ...]:
        """Parameters of :func:`asrsim.actuators.motor.motor_kick` of motor `index` (1, 2, ...)."""
        return motor_numbers(self.values, index, self.mode)

    def without_friction(self) -> Drive:
        """The same drive without friction of its motors; their damping stays."""
        motors = range(1, self.actuator.motors + 1)
        names = [f"motor_{i}_{name}" for i in motors for name in ("friction_torque", "stribeck_friction", "load_friction")]
        return replace(self, values={**self.values, **dict.fromkeys(names, 0.0)})

    def goals(self, references: Array) -> Array:
        """Goals of the motors or springs from references (columns, n): through the reference map in modes 3 and 6."""
        goals = references.copy()
        if self.mode.mapped:
            mapped = over_arrays(self.actuator.motor_references)(references[0], references[1])
            goals[: len(mapped)] = mapped
        return goals

    def _gains(self, name: str) -> tuple[float, ...]:
        if not self.mode.controller:
            return ()
        return tuple(one.gain * self.values[f"controller_{i}_{name}"] for i, one in enumerate(self.electric, start=1))

    def _of_motors(self, name: str) -> tuple[float, ...]:
        return tuple(self.values[f"motor_{i}_{name}"] for i in range(1, self.dynamic_motors + 1))
