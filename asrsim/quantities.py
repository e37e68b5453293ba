"""Quantities of a joint: names, units and labels shared by simulation, log, metrics and plots."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """A scalar signal of one joint that is logged or computed from the log."""

    name: str
    """Name in logs and commands."""
    unit: str
    """SI unit for a revolute joint; a prismatic joint has m for rad and N for N m. "" or "1" for a pure number."""
    label: str
    """Symbol for axes and legends, as in the paper, in mathtext."""
    doc: str
    """Meaning, for tables and logs."""
    apart: bool = False
    """Whether the quantity belongs to an optional model. It then has a separate topic, outside of the common messages."""

    def __post_init__(self) -> None:
        if self.unit == "1":
            object.__setattr__(self, "unit", "")


MOST_MOTORS = 8
"""Largest number of motors that an actuator can have."""


def each_motor(name: str) -> tuple[str, ...]:
    """Names of a quantity for all possible motors. `name` has {} in place of the number of the motor."""
    return tuple(name.format(i) for i in range(1, MOST_MOTORS + 1))


def of_motors(name: str, unit: str, label: str, doc: str, *, apart: bool = False) -> tuple[Quantity, ...]:
    """One quantity for each possible motor; texts have {} in place of the motor's number. The toolbox's messages have only two
    motors, so the quantities of further motors are `apart`."""
    return tuple(
        Quantity(name.format(i), unit, label.replace("{}", str(i)), doc.format(i), apart=apart or i > 2)
        for i in range(1, MOST_MOTORS + 1)
    )


QUANTITIES: dict[str, Quantity] = {
    quantity.name: quantity
    for quantity in (
        Quantity("link_position", "rad", "$q$", "position of the link"),
        Quantity("link_velocity", "rad/s", r"$\dot q$", "velocity of the link"),
        Quantity("link_torque", "N m", r"$\tau_q$", "torque of the actuator on the link, after the effort limit"),
        *of_motors("elastic_torque_{}", "N m", r"$\tau_{el,{}}$", "torque of spring {0} on motor {0}"),
        Quantity("stiffness", "N m/rad", "$k$", "stiffness seen by the link at fixed motors"),
        *(
            quantity
            for motor in zip(
                of_motors(
                    "motor_{}_position", "rad", r"$\theta_{}$", "position of motor {} behind its gear; of an adjuster, in m"
                ),
                of_motors("motor_{}_velocity", "rad/s", r"$\dot\theta_{}$", "velocity of motor {}"),
                of_motors("motor_{}_torque", "N m", r"$\tau_{m,{}}$", "torque of motor {}, after its limit"),
                strict=True,
            )
            for quantity in motor
        ),
        *of_motors("reference_{}", "", "$r_{}$", "reference {}; its meaning and unit follow from the operation mode"),
        Quantity("external_torque", "N m", r"$\tau_{ext}$", "external torque on the link"),
        Quantity("damping_torque", "N m", r"$\tau_d$", "torque of the link's viscous damping"),
        *of_motors("friction_torque_{}", "N m", r"$\tau_{f,{}}$", "friction torque on motor {}"),
        *of_motors("motor_{}_voltage", "V", "$u_{}$", "voltage of motor {}, if the motor is electric", apart=True),
        *of_motors("motor_{}_current", "A", "$i_{}$", "current of motor {}, if the motor is electric", apart=True),
        *of_motors(
            "sent_reference_{}", "", "$r_{s,{}}$", "reference {} as sent, without the `imperfections` of commands", apart=True
        ),
        Quantity("motor_work", "J", r"$W_m$", "work of the motors since the start"),
        Quantity("spring_energy", "J", r"$E_{el}$", "energy stored in the springs"),
        Quantity(
            "friction_loss",
            "J",
            r"$E_f$",
            "energy lost in motor friction, motor damping and at motor limits since the start",
        ),
        Quantity("link_work", "J", r"$W_q$", "work of the actuator on the link since the start"),
        Quantity(
            "limit_loss", "J", r"$E_l$", "energy withheld from the link by the effort limit since the start; it can be negative"
        ),
        Quantity("damping_loss", "J", r"$E_d$", "energy lost in the link's damping since the start"),
        Quantity("winding_loss", "J", r"$E_R$", "heat of the motors' windings since the start", apart=True),
        Quantity(
            "energy_residual", "J", r"$\Delta E$", "motor work - losses - stored - link work: error of the energy balance"
        ),
    )
}
"""Every quantity that a run may record, by name. A quantity that a joint lacks (such as motor 2 of an SEA) is absent from its
log, rather than zero.
"""

DERIVED: dict[str, Quantity] = {
    quantity.name: quantity
    for quantity in (
        Quantity("deflection", "rad", r"$\phi$", "equilibrium position of the motors minus link position"),
        Quantity("equilibrium_position", "rad", r"$\theta_{eq}$", "position at which the motors hold the unloaded link"),
        Quantity("position_error", "rad", "$e$", "reference position minus link position"),
    )
}
"""Quantities that `asrsim.log.derived` computes from the quantities in a log. They are not stored in logs."""

LIMITS = {
    "effort": "effort limit",
    "velocity": "velocity limit",
    "saturation": "motor limit",
    "motor_stop": "motor stop",
    "motor_speed": "motor speed",
    "deflection": "deflection limit",
    "stop": "joint stop",
}
"""Heading of the column with the number of substeps that each joint spent at a limit, by name of the limit."""


def linear_unit(unit: str) -> str:
    """Unit for a prismatic joint that corresponds to this unit for a revolute joint."""
    return unit.replace("kg m^2", "kg").replace("(N m)", "N").replace("N m", "N").replace("rad", "m")


PRISMATIC_UNITS = {unit: linear_unit(unit) for unit in ("rad", "rad/s", "N m", "N m/rad")}
"""Unit for a prismatic joint, by the corresponding unit for a revolute joint; for recordings and references."""


def is_comparable(name: str, wanted: Collection[str] | None = None) -> bool:
    """Whether this quantity is compared between a simulation and a recording. If `wanted` is given, the quantities that it
    names are compared. Without `wanted`, all quantities except energies are compared. Only simulations have energies, which
    follow from other quantities.
    """
    return unit_of(name) != "J" if wanted is None else name in wanted


def unit_of(name: str, *, prismatic: bool = False) -> str:
    """SI unit of a recorded or derived quantity. "" for a pure number, for a unit that depends on the operation mode, and for
    an unknown quantity. A log may have quantities of a user's stage that is not loaded.
    """
    known = QUANTITIES.get(name) or DERIVED.get(name)
    unit = known.unit if known else ""
    return linear_unit(unit) if prismatic else unit


def shown(value: float, unit: str = "", digits: int = 3) -> str:
    """Number and unit for people: `0.075 mm` for 7.5e-05 m. A small number gets a smaller unit instead of a power of ten."""
    scale, unit = prefixed((value,), unit)
    return f"{value * scale:.{digits}g} {unit}".rstrip()


def prefixed(values: Sequence[float], unit: str) -> tuple[float, str]:
    """Factor and unit in which numbers read well, without powers of ten. Numbers below 0.01 take a smaller unit, and so do
    numbers below 10 if any of them is below 0.0001. Numbers below 1e-9, which are mostly rounding errors, keep their unit.
    """
    sizes = [abs(value) for value in values if 0.0 < abs(value) < math.inf]
    if (
        unit not in _PREFIXED
        or not sizes
        or max(sizes) < 1e-9
        or (max(sizes) >= 1e-2 and min(sizes) >= 1e-4)
        or max(sizes) >= 10.0
    ):
        return 1.0, unit
    return (1e3, f"m{unit}") if max(sizes) >= 2e-5 else (1e6, f"µ{unit}")


_PREFIXED = ("m", "rad", "N", "N m", "J", "s", "V", "A", "W")
"""Units that may get the prefix m or µ."""
