"""Parameters of actuators: numbers with a unit, a default, bounds and the source of the default."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from asrsim.errors import ActuatorError

TOOLBOX = "released toolbox, code default"
STRIBECK = "Armstrong-Helouvry, Dupont, Canudas de Wit (1994)"
LOAD_FRICTION = "Duclusaud et al. (2025), extended friction models of servo actuators (BAM), M3"
DC_MOTOR = "DC motor without inductance: n k_t i, u = R i + n k_t omega"
DAHL = "Dahl (1968)"
FRICTION_STIFFNESS = 1000.0
"""Pre-sliding stiffness K of the Dahl friction, N m/rad (paper eq. 8; fixed in the released toolbox)."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """Declaration of one parameter of an actuator or a stage; `docs/stages.md` has a table of the fields."""

    name: str
    """Name in snake_case, such as `max_deflection`."""
    default: float
    """Value of the parameter if the robot and the scenario state no value."""
    unit: str
    """SI unit; "1" for a dimensionless number."""
    doc: str
    """Meaning, for tables and messages."""
    source: str = TOOLBOX
    """Publication or code that the default comes from."""
    minimum: float = -math.inf
    """Smallest allowed value."""
    maximum: float = math.inf
    """Largest allowed value."""
    exclusive_minimum: bool = False
    """Whether the value must be larger than `minimum`; if False, the value may equal `minimum`."""
    finite: bool = True
    """Whether the value must be finite; infinite values mean that there is no limit."""
    unused: str = ""
    """Reason why the value has no effect; empty if the value has an effect."""
    needs: str = ""
    """Name of another parameter; this parameter has no effect while the other parameter is 0."""
    optional: bool = False
    """Whether the parameter belongs to a model that the toolbox lacks and that is off by default; lists of values omit it while
    the model is off."""

    def __post_init__(self) -> None:
        """Raises ActuatorError for a name that is not an identifier, and for a default that is not allowed."""
        fault = self.fault(self.default)
        if fault or not self.name.isidentifier():
            message = f"the default {fault}" if fault else "the name must be a Python identifier"
            raise ActuatorError(message, key=self.name, value=self.default, code="bad-parameter")

    def fault(self, value: float) -> str | None:
        """Reason why `value` is not allowed; None if `value` is allowed."""
        if math.isnan(value):
            return "must be a number"
        if self.finite and math.isinf(value):
            return "must be finite"
        if value < self.minimum or (self.exclusive_minimum and value == self.minimum):
            return f"must be {'larger than' if self.exclusive_minimum else 'at least'} {self.minimum:g} {self.unit}"
        if value > self.maximum:
            return f"must be at most {self.maximum:g} {self.unit}"
        return None


_POSITIVE: dict[str, Any] = {"minimum": 0.0, "exclusive_minimum": True}
_STRIBECK: dict[str, Any] = {"source": STRIBECK, "optional": True}
_ELECTRIC: dict[str, Any] = {"source": DC_MOTOR, "optional": True}
_LIMIT: dict[str, Any] = {"default": math.inf, "finite": False, **_POSITIVE, **_ELECTRIC}
MOTOR_PARAMETERS = (
    Parameter(name="inertia", default=0.0233, unit="kg m^2", doc="inertia b at the link's side of the gear", **_POSITIVE),
    Parameter(name="damping", default=0.2698, unit="N m s/rad", doc="viscous damping d", minimum=0.0),
    Parameter(name="max_torque", default=6.0, unit="N m", doc="largest torque of the motor", minimum=0.0),
    Parameter(
        name="max_velocity", default=6.0, unit="rad/s", doc="largest speed of the motor", finite=False, **_POSITIVE
    ),
    Parameter(name="min_position", default=-math.inf, unit="rad", doc="lower stop of the motor", finite=False),
    Parameter(name="max_position", default=math.inf, unit="rad", doc="upper stop of the motor", finite=False),
    Parameter(
        name="friction_torque", default=0.02, unit="N m", doc="Coulomb level of the Dahl friction (paper eq. 8)", minimum=0.0
    ),
    Parameter(
        name="stribeck_friction", default=0.0, unit="N m", minimum=0.0, **_STRIBECK,
        doc="static friction minus Coulomb friction; this excess decreases with speed",
    ),
    Parameter(
        name="stribeck_velocity", default=0.1, unit="rad/s", needs="stribeck_friction", **_POSITIVE, **_STRIBECK,
        doc="velocity at which 37 % of the Stribeck friction is left",
    ),
    Parameter(
        name="load_friction", default=0.0, unit="1", minimum=0.0, source=LOAD_FRICTION, optional=True,
        doc="share of the spring's torque on the motor that adds to the Coulomb level",
    ),
    Parameter(
        name="friction_stiffness", default=FRICTION_STIFFNESS, unit="N m/rad", source=DAHL, optional=True, **_POSITIVE,
        doc="pre-sliding stiffness of the friction's bristles",
    ),
    Parameter(
        name="torque_constant", default=0.0, unit="N m/A", minimum=0.0, **_ELECTRIC,
        doc="torque constant k_t of the rotor, equal to its back-EMF constant in V s/rad; 0: the command is a torque",
    ),
    Parameter(
        name="resistance", default=0.0, unit="ohm", minimum=0.0, needs="torque_constant", **_ELECTRIC,
        doc="resistance R of the winding; 0: the controller commands a current, otherwise a voltage",
    ),
    Parameter(
        name="gear_ratio", default=1.0, unit="1", needs="torque_constant", **_POSITIVE, **_ELECTRIC,
        doc="turns n of the rotor per turn of the motor's output",
    ),
    Parameter(name="max_voltage", unit="V", needs="resistance", doc="largest voltage", **_LIMIT),
    Parameter(name="max_current", unit="A", needs="torque_constant", doc="largest current", **_LIMIT),
)  # fmt: skip
"""Parameters of a motor without the prefix `motor_1_`: the DC motor of section 3.1.1 of the paper."""


CONTROLLER_PARAMETERS = (
    Parameter(name="proportional", default=125.0, unit="N m/rad", doc="gain k_p on the position error"),
    Parameter(name="integral", default=0.0, unit="N m/(rad s)", doc="gain k_i on the integral of the position error"),
    Parameter(name="derivative", default=4.5, unit="N m s/rad", doc="gain k_d on the negative velocity"),
)
"""Parameters of a motor's PID controller (section 3.1.2 of the paper), without the prefix `controller_1_`. In mode 1, the
controller of the link has the same parameters with other defaults."""


@cache
def numbered(part: str, index: int) -> tuple[Parameter, ...]:
    """Parameters of motor `index` (1, 2, ...), or of its controller, with their prefix. part: `motor` or `controller`."""
    prefix = f"{part}_{index}"
    return tuple(
        replace(parameter, name=f"{prefix}_{parameter.name}", needs=parameter.needs and f"{prefix}_{parameter.needs}")
        for parameter in (MOTOR_PARAMETERS if part == "motor" else CONTROLLER_PARAMETERS)
    )


LINK_CONTROLLER_DEFAULTS = {
    "controller_1_proportional": 0.8,
    "controller_1_integral": 0.0,
    "controller_1_derivative": 0.2,
}
"""Controller defaults in mode 1, in which the PID controller acts on the link (released toolbox)."""
