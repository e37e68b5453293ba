"""Checks whether the values of an actuator, from a file or a scenario, can be used in calculations."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from asrsim.actuators import ACTUATORS, MODES, Parameter
from asrsim.actuators.electric import missing_constants
from asrsim.errors import Problem
from asrsim.robot.findings import LARGEST_NUMBER, SMALLEST
from asrsim.robot.model import ActuatorBlock

DEFLECTION = 1e-3
"""Deflection at which an actuator's laws are evaluated, rad; a smaller deflection limit replaces it."""


def parameter_fault(parameter: Parameter, value: float) -> str | None:
    """Reason why a parameter cannot have the value; None if it can. Too large and too small values would overflow."""
    fault = parameter.fault(value)
    if fault is None and math.isfinite(value) and value:
        if abs(value) > LARGEST_NUMBER:
            return f"is larger than {LARGEST_NUMBER:g}, which no actuator has"
        if abs(value) < SMALLEST:
            return f"is closer to 0 than {SMALLEST:g}, which no actuator is"
    return fault


def law_fault(block: ActuatorBlock) -> str | None:
    """Reason why the actuator's laws give no number near rest with its parameters; None if they give numbers.

    Other errors of a user's laws are reported where the laws are used.
    """
    actuator, values = ACTUATORS.get(block.actuator), block.values()
    if not MODES[block.mode].spring or any(map(math.isnan, values.values())):
        return None
    parameters = actuator.law_values(values)
    away = min(DEFLECTION, values.get("max_deflection", DEFLECTION))
    motors: tuple[float, ...] = ()
    laws: tuple[Any, ...] = actuator.elastic_torques, actuator.stiffness, actuator.elastic_energy
    for law in laws:
        try:
            motors = motors or actuator.motor_references(0.0, actuator.typical_preset)
            total = 0.0
            for q in (-away, 0.0, away):
                result = law(q, *motors, parameters)
                total += sum(result) if isinstance(result, tuple) else result
            if not math.isfinite(total):
                return f"its {law.__name__.replace('_', ' ')} is not finite"
        except ArithmeticError as error:
            return f"its {law.__name__.replace('_', ' ')} cannot be worked out ({error})"
        except Exception:
            return None
    return None


def together_faults(block: ActuatorBlock) -> Iterator[Problem]:
    """Problems of a block's values that are valid alone but do not fit together."""
    for index in range(1, ACTUATORS.get(block.actuator).motors + 1):
        low, high = (block.parameters[f"motor_{index}_{end}_position"] for end in ("min", "max"))
        if low.value > high.value:
            yield Problem(
                f"lower stop of motor {index} is above the upper one", line=low.line or high.line,
                key=f"parameters.{block.joint}", value=f"{low.value:g} > {high.value:g}", code="limits-crossed",
            )  # fmt: skip
    mode = MODES[block.mode]
    # Voltages and currents are for electric motors.
    lacking = missing_constants(block.values(), ACTUATORS.get(block.actuator).motors, mode) if mode.command != "torque" else ()
    if lacking:
        message = f"mode {mode.number} ({mode.name}) cannot drive its motors: {' and '.join(lacking)} must be larger than 0"
        yield Problem(message, key=f"modes.{block.joint}", code="operation-mode")
    fault = law_fault(block)
    if fault is not None:
        given = ", ".join(f"{one.name} = {one.value:g}" for one in block.parameters.values() if one.origin == "scenario")
        yield Problem(f"with these parameters {fault}", key=f"parameters.{block.joint}", value=given or None, code="law")


def has_spring(block: ActuatorBlock) -> bool:
    """Whether the springs give a torque at some deflection within the limit."""
    actuator, values = ACTUATORS.get(block.actuator), block.values()
    parameters = actuator.law_values(values)
    reach = min(values.get("max_deflection", 1.0), 1.0)
    motors = actuator.motor_references(0.0, actuator.typical_preset)
    try:
        return any(any(actuator.elastic_torques(-part * reach, *motors, parameters)) for part in (0.01, 0.1, 1.0))
    except Exception:
        return True
