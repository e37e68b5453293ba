"""Units of the quantities of a joint, which depend on its kind, on its actuator, and on its operation mode."""

from __future__ import annotations

from asrsim.actuators import ACTUATORS, Actuator
from asrsim.actuators.modes import MODES, Mode
from asrsim.quantities import each_motor, linear_unit, unit_of
from asrsim.samples import JointInfo

_OF_ADJUSTER = "reference_2", "sent_reference_2", "motor_2_position", "motor_2_velocity"
_REFERENCES = (*each_motor("reference_{}"), *each_motor("sent_reference_{}"))


def unit_at(quantity: str, joint: JointInfo) -> str:
    """Unit of a quantity of this joint: m and N for a prismatic joint, the unit of the operation mode for a reference, m for
    the adjuster of AwAS-II. "" for a pure number and for an unknown quantity.
    """
    mode = MODES.get(joint.mode) if joint.mode is not None else None
    actuator = ACTUATORS.get(joint.actuator) if joint.actuator in ACTUATORS else None
    if actuator is not None and actuator.adjuster and quantity in _OF_ADJUSTER:
        return actuator.reference_2_unit + ("/s" if quantity == "motor_2_velocity" else "")
    unit = unit_of(quantity)
    if quantity in _REFERENCES and mode is not None:
        unit = reference_unit(actuator, mode, int(quantity[-1]))
    return linear_unit(unit) if joint.prismatic else unit


def reference_unit(actuator: type[Actuator] | None, mode: Mode, number: int) -> str:
    """Unit of reference 1, 2, ... of an actuator at a revolute joint. The second reference of an actuator with an adjuster is
    the adjuster's position in every mode. None: the actuator is unknown.
    """
    if number == 2 and actuator is not None and (actuator.adjuster or mode.mapped):
        return actuator.reference_2_unit
    return mode.units[min(number, len(mode.units)) - 1]
