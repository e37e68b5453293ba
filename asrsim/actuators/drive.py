"""The drive of one joint: an actuator, its mode and its parameter values, and quantities that follow from these three."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.actuators.electric import Electric, electric_of
from asrsim.actuators.motor import MotorConstants
from asrsim.actuators.parameters import MOTOR_PARAMETERS
from asrsim.actuators.stages import STAGES, Stage
from asrsim.actuators.vectorised import Array, over_arrays

if TYPE_CHECKING:
    from asrsim.actuators.base import Actuator
    from asrsim.actuators.modes import Mode

MOTOR_NAMES = tuple(parameter.name for parameter in MOTOR_PARAMETERS)


@dataclass(frozen=True, kw_only=True)
class Drive:
    """An actuator on its joint, for simulation, gravity compensation and learning.

    Tuples about controllers or motors have one entry per motor. They are empty in modes without controllers or without motors.
    """

    joint: str
    actuator: type[Actuator]
    mode: Mode
    values: Mapping[str, float]
    """Values of all parameters, by name."""

    @cached_property
    def elastic(self) -> tuple[float, ...]:
        """Values of the spring parameters, in the order in which the laws take them."""
        return self.actuator.law_values(self.values)

    @property
    def max_deflection(self) -> float:
        """Deflection in rad beyond which the springs' torques stay constant; infinite if the law has no parameter
        `max_deflection`."""
        return self.values.get("max_deflection", math.inf)

    @cached_property
    def stages(self) -> Mapping[str, tuple[Any, ...]]:
        """Constants of each stage that acts, by name of the stage: one entry per motor, None at motors where the stage does not
        act."""
        motors = range(1, self.actuator.motors + 1) if self.mode.spring else ()
        found = {one.name: tuple(self._constants(one, i) for i in motors) for one in STAGES.loaded()}
        return {name: own for name, own in found.items() if any(one is not None for one in own)}

    def _constants(self, stage: type[Stage], motor: int) -> Any:
        """Constants of a stage at motor 1, 2, ...; None if the stage does not act there. Stages parallel to or in series with a
        spring do not act at a motor on the housing, since no spring connects this motor to the link.
        """
        if self.actuator.is_housed(motor - 1) and (stage.has("torque") or stage.has("place")):
            return None
        return stage.constants(self.values, motor, self.mode)

    def placed(self, motor: int, deflection: Array) -> Array:
        """Deflections (...) of the spring of motor 1, 2, ... in rad at rest, for deflections (...) of the joint. The two differ
        by the deflections of the stages in series with the spring, such as a play."""
        for name, constants in self.stages.items():
            stage, own = STAGES.get(name), constants[motor - 1]
            if stage.has("place") and own is not None:
                deflection = np.vectorize(partial(stage.place, stage.Memory(), own), otypes=[float])(deflection)
        return deflection

    @property
    def dynamic_motors(self) -> int:
        """Number of motors that have dynamics in this mode."""
        return self.actuator.motors if self.mode.motor else 0

    @cached_property
    def electric(self) -> tuple[Electric, ...]:
        """Relation between the command and the torque of each motor."""
        return tuple(electric_of(self.values, i, self.mode) for i in range(1, self.actuator.motors + 1))

    @cached_property
    def proportional(self) -> tuple[float, ...]:
        """Proportional gain of each controller in N m/rad, converted from volts or amperes for electric motors."""
        return self._gains("proportional")

    @cached_property
    def integral(self) -> tuple[float, ...]:
        """Integral gain of each controller in N m/(rad s)."""
        return self._gains("integral")

    @cached_property
    def derivative(self) -> tuple[float, ...]:
        """Derivative gain of each controller in N m s/rad."""
        return self._gains("derivative")

    @cached_property
    def max_torque(self) -> tuple[float, ...]:
        """Largest torque of each motor in N m while the motor is at rest."""
        return tuple(min(one.limit, one.stall) for one in self.electric) if self.mode.motor else ()

    @cached_property
    def motor_inertia(self) -> tuple[float, ...]:
        """Inertia of each motor in kg m^2."""
        return self._of_motors("inertia")

    @cached_property
    def motor_damping(self) -> tuple[float, ...]:
        """Viscous damping of each motor in N m s/rad; this damping includes the back-EMF if the command is a voltage."""
        return tuple(d + one.lag for d, one in zip(self._of_motors("damping"), self.electric, strict=False))

    @cached_property
    def motor_friction(self) -> tuple[float, ...]:
        """Coulomb friction of each motor in N m."""
        return self._of_motors("friction_torque")

    @cached_property
    def max_velocity(self) -> tuple[float, ...]:
        """Speed limit of each motor in rad/s."""
        return self._of_motors("max_velocity")

    @cached_property
    def motor_ranges(self) -> tuple[tuple[float, float], ...]:
        """Smallest and largest position of each motor in rad."""
        return tuple(zip(self._of_motors("min_position"), self._of_motors("max_position"), strict=True))

    def motor_constants(self, index: int) -> MotorConstants:
        """Constants of motor `index` (1, 2, ...) for the simulation."""
        own = {name: self.values[f"motor_{index}_{name}"] for name in MOTOR_NAMES}
        # Without a controller, the command is the reference. Gains of 1, 0 and 0 have this effect.
        gains = {"proportional": 1.0, "integral": 0.0, "derivative": 0.0}
        if self.mode.controller:
            gains = {name: self.values[f"controller_{index}_{name}"] for name in gains}
        electric, (low, high) = self.electric[index - 1], self.motor_ranges[index - 1]
        return MotorConstants(
            **gains, hold=float(self.mode.controller), inertia=own["inertia"], damping=own["damping"], gain=electric.gain,
            lag=electric.lag, emf=electric.damping, stall=electric.stall, limit=electric.limit,
            coulomb=own["friction_torque"], excess=own["stribeck_friction"], fade=1.0 / own["stribeck_velocity"],
            share=own["load_friction"], bristles=own["friction_stiffness"], low=low, high=high,
            most=self.max_velocity[index - 1],
            torque_constant=own["torque_constant"] * own["gear_ratio"], resistance=own["resistance"],
        )  # fmt: skip

    def goals(self, references: Array) -> Array:
        """Positions (columns, n) that the references (columns, n) demand of the motors, or of the springs in modes without
        motors. In modes 3 and 6 the reference map converts equilibrium and preset into positions."""
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
