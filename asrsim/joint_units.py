"""Units of the quantities of a joint, which depend on its kind, on its actuator, and on its operation mode."""

from __future__ import annotations

from asrsim.actuators import ACTUATORS
from asrsim.actuators.modes import MODES
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
        unit = mode.units[min(int(quantity[-1]), len(mode.units)) - 1]
    return linear_unit(unit) if joint.prismatic else unit
