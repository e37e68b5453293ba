"""Quantities of a joint: names, units and labels shared by simulation, log, metrics and plots."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """Scalar signal of one joint."""

    name: str
    unit: str
    """SI unit for a revolute joint; a prismatic joint has m for rad and N for N m."""
    label: str
    """Symbol for axes and legends, as in the paper, in mathtext."""
    doc: str
    apart: bool = False
    """Whether the quantity belongs to an optional model and has a separate topic, outside the common messages."""


QUANTITIES: dict[str, Quantity] = {
    quantity.name: quantity
    for quantity in (
        Quantity("link_position", "rad", "$q$", "position of the link"),
        Quantity("link_velocity", "rad/s", r"$\dot q$", "velocity of the link"),
        Quantity("link_torque", "N m", r"$\tau_q$", "torque of the actuator on the link, after the effort limit"),
        Quantity("elastic_torque_1", "N m", r"$\tau_{el,1}$", "torque of spring 1 on motor 1"),
        Quantity("elastic_torque_2", "N m", r"$\tau_{el,2}$", "torque of spring 2 on motor 2"),
        Quantity("stiffness", "N m/rad", "$k$", "stiffness seen by the link at fixed motors"),
        Quantity("motor_1_position", "rad", r"$\theta_1$", "position of motor 1, at the link's side of the gear"),
        Quantity("motor_1_velocity", "rad/s", r"$\dot\theta_1$", "velocity of motor 1"),
        Quantity("motor_1_torque", "N m", r"$\tau_{m,1}$", "torque of motor 1, after its limit"),
        Quantity("motor_2_position", "rad", r"$\theta_2$", "position of motor 2 (AwAS-II: the adjuster's sigma, in m)"),
        Quantity("motor_2_velocity", "rad/s", r"$\dot\theta_2$", "velocity of motor 2"),
        Quantity("motor_2_torque", "N m", r"$\tau_{m,2}$", "torque of motor 2, after its limit"),
        Quantity("reference_1", "", "$r_1$", "first reference; its meaning and unit follow from the operation mode"),
        Quantity("reference_2", "", "$r_2$", "second reference; its meaning and unit follow from the operation mode"),
        Quantity("external_torque", "N m", r"$\tau_{ext}$", "external torque on the link"),
        Quantity("damping_torque", "N m", r"$\tau_d$", "torque of the link's viscous damping"),
        Quantity("friction_torque_1", "N m", r"$\tau_{f,1}$", "friction torque on motor 1"),
        Quantity("friction_torque_2", "N m", r"$\tau_{f,2}$", "friction torque on motor 2"),
        *(
            Quantity(f"motor_{i}_{name}", unit, rf"${symbol}_{i}$", f"{name} of motor {i}, where it is electric", apart=True)
            for i in (1, 2)
            for name, unit, symbol in (("voltage", "V", "u"), ("current", "A", "i"))
        ),
        Quantity("motor_work", "J", r"$W_m$", "work of the motors since the start"),
        Quantity("spring_energy", "J", r"$E_{el}$", "energy stored in the springs"),
        Quantity(
            "friction_loss", "J", r"$E_f$", "energy lost in the motors' friction, damping and at their limits since the start"
        ),
        Quantity("link_work", "J", r"$W_q$", "work of the actuator on the link since the start"),
        Quantity(
            "limit_loss", "J", r"$E_l$", "energy withheld from the link by the effort limit since the start; it can be negative"
        ),
        Quantity("damping_loss", "J", r"$E_d$", "energy lost in the link's damping since the start"),
        Quantity("winding_loss", "J", r"$E_R$", "heat of the motors' windings since the start", apart=True),
        Quantity("hysteresis_loss", "J", r"$E_h$", "energy lost in the springs' hysteresis since the start", apart=True),
        Quantity(
            "energy_residual", "J", r"$\Delta E$", "motor work - losses - stored - link work: error of the energy balance"
        ),
    )
}
"""Every quantity that a run may record, by name. Quantities that a joint lacks (motor 2 of an SEA) are absent from a log, not
zero.
"""

DERIVED: dict[str, Quantity] = {
    quantity.name: quantity
    for quantity in (
        Quantity("deflection", "rad", r"$\phi$", "equilibrium position of the motors minus link position"),
        Quantity("equilibrium_position", "rad", r"$\theta_{eq}$", "position at which the motors hold the unloaded link"),
        Quantity("position_error", "rad", "$e$", "reference of the position minus link position"),
    )
}
"""Quantities that `asrsim.log.derived` computes from a log; they are not stored."""

LIMITS = {
    "effort": "effort limit",
    "velocity": "velocity limit",
    "saturation": "motor limit",
    "motor_stop": "motor stop",
    "motor_speed": "motor speed",
    "deflection": "deflection limit",
    "stop": "joint stop",
}
"""Headings of columns with the number of substeps that each joint spent at a limit, by limit."""


def linear_unit(unit: str) -> str:
    """Unit of a prismatic joint that corresponds to a unit of a revolute joint."""
    return unit.replace("kg m^2", "kg").replace("N m", "N").replace("rad", "m")


PRISMATIC_UNITS = {unit: linear_unit(unit) for unit in ("rad", "rad/s", "N m", "N m/rad")}
"""Units of a prismatic joint by the corresponding unit of a revolute joint, for recordings and references."""


def is_comparable(name: str, wanted: Collection[str] | None = None) -> bool:
    """Whether a simulation and a recording are compared by this quantity: any that `wanted` names; without `wanted`, all but
    energies. Only simulations have energies, and these follow from other quantities."""
    return unit_of(name) != "J" if wanted is None else name in wanted


def unit_of(name: str, *, prismatic: bool = False) -> str:
    """SI unit of a quantity, recorded or derived; "" if the unit depends on the operation mode."""
    unit = (QUANTITIES | DERIVED)[name].unit
    return linear_unit(unit) if prismatic else unit


def shown(value: float, unit: str = "", digits: int = 3) -> str:
    """Number and unit for people: `0.075 mm` for 7.5e-05 m. A small number takes a smaller unit instead of a power of ten."""
    if unit in _PREFIXED and 0.0 < abs(value) < 1e-2:
        scale, prefix = (1e3, "m") if abs(value) >= 1e-5 else (1e6, "µ")
        value, unit = value * scale, prefix + unit
    return f"{value:.{digits}g} {unit}".rstrip()


_PREFIXED = ("m", "rad", "N", "N m", "N·m", "J", "s", "V", "A", "W")
"""Units that may take a prefix."""
