"""The motor in more detail than the toolbox's, as one pure law: Stribeck and load-dependent friction, voltage and current.

Friction is Dahl's as in :mod:`asrsim.actuators.motor`, but the torque at which its bristles slip varies:

    tau_c + c |tau_s| + tau_x exp(-(omega / omega_x)^2)

with the Coulomb level tau_c, the spring's torque tau_s on the motor (its share c as in BAM's M3: Duclusaud et al. 2025) and the
Stribeck excess tau_x (Armstrong-Helouvry et al. 1994). The bristles give back no more than they took whatever the level does,
so friction is passive. The electric motor has no inductance, and its constants are seen from the output:

    tau = n k_t i,    u = R i + n k_t omega,    |u| <= max_voltage,  |i| <= max_current
"""

from __future__ import annotations

from collections.abc import Mapping
from math import exp, inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from asrsim.actuators.modes import Mode
from asrsim.actuators.parameters import FRICTION_STIFFNESS


class Electric(NamedTuple):
    """How a motor's command becomes torque: tau = gain * command - lag * omega, within the limits."""

    gain: float
    """N m per unit of the command: 1, N m/A or N m/V."""
    lag: float
    """N m s/rad: the back-EMF's part where voltage is commanded."""
    damping: float
    """N m s/rad of the back-EMF at full voltage; 0: no limit of the voltage."""
    stall: float
    """N m at full voltage and rest."""
    limit: float
    """N m."""

    def torque_of(self, command: Any) -> Any:
        """N m at rest under a command, number or array."""
        most = min(self.limit, self.stall)
        return np.clip(self.gain * command, -most, most)


DETAILS = tuple(f"motor_{i}_{name}" for i in (1, 2) for name in ("stribeck_friction", "load_friction", "torque_constant"))
"""Parameters that make a motor more than the toolbox's, motor by motor; all are 0 where it is that."""


def is_detailed(values: Mapping[str, float], motors: int) -> bool:
    """Whether any motor has more than the toolbox's."""
    stiff = (values.get(f"motor_{i}_friction_stiffness", FRICTION_STIFFNESS) for i in range(1, motors + 1))
    return any(values.get(name, 0.0) > 0.0 for name in DETAILS[: 3 * motors]) or any(k != FRICTION_STIFFNESS for k in stiff)


def command_of(values: Mapping[str, float], index: int, mode: Mode) -> str:
    """What motor `index` is told: torque, voltage or current; controllers of electric motors give one of the latter."""
    if not (mode.controller and mode.motor) or values.get(f"motor_{index}_torque_constant", 0.0) <= 0.0:
        return mode.command
    return "voltage" if values[f"motor_{index}_resistance"] > 0.0 else "current"


def electric_of(values: Mapping[str, float], index: int, mode: Mode) -> Electric:
    """Constants of motor `index` from its parameters."""
    command, limit = command_of(values, index, mode), values[f"motor_{index}_max_torque"]
    constant = values.get(f"motor_{index}_torque_constant", 0.0) * values.get(f"motor_{index}_gear_ratio", 1.0)
    if constant <= 0.0 or not mode.motor:
        return Electric(1.0 if command == "torque" else 0.0, 0.0, 0.0, inf, limit)
    limit = min(limit, constant * values[f"motor_{index}_max_current"])
    resistance = values[f"motor_{index}_resistance"]
    damping, stall = 0.0, inf
    if resistance > 0.0:
        damping, stall = constant * constant / resistance, constant / resistance * values[f"motor_{index}_max_voltage"]
    if command == "voltage":
        return Electric(constant / resistance if resistance > 0.0 else 0.0, damping, damping, stall, limit)
    return Electric(constant if command == "current" else 1.0, 0.0, damping, stall, limit)


def largest_command(values: Mapping[str, float], index: int, mode: Mode) -> float:
    """The most that a direct reference of motor `index` does: N m, V or A."""
    electric = electric_of(values, index, mode)
    if mode.command == "voltage" and isfinite(values[f"motor_{index}_max_voltage"]):
        return values[f"motor_{index}_max_voltage"]
    return electric.limit / electric.gain if electric.gain > 0.0 else 0.0


NEEDED = {"torque": (), "current": ("torque_constant",), "voltage": ("torque_constant", "resistance")}
"""Command of a mode -> constants of its motors without which it drives none."""


def missing_constants(values: Mapping[str, float], motors: int, mode: Mode) -> tuple[str, ...]:
    """Parameters of the motors that must be larger than 0 for the mode's references, and are not."""
    names = (f"motor_{i}_{name}" for i in range(1, motors + 1) for name in NEEDED[mode.command])
    return tuple(name for name in names if values[name] <= 0.0)


def detailed_kick(
    position: float,
    velocity: float,
    anchor: float,
    integral: float,
    reference: float,
    load: float,
    slowest: float,
    fastest: float,
    coefficients: tuple[float, ...],
) -> tuple[float, float, float, float, float, float]:
    """Accelerate a motor over one kick at a fixed position: as :func:`asrsim.actuators.motor.motor_kick`, which see. The
    velocity stays between `slowest` and `fastest`, and damping and back-EMF are those of that velocity.

    integral: of the controller, in units of the command. The level of friction is that of the kick's mean speed, found in two
    rounds, so that the kick stays of second order where friction falls with speed.
    """
    (
        p, hold, i_step, d, old, new, step, inertia, damping, gain, lag, emf, stall, limit,
        coulomb, excess, fade, share, stiffness,
    ) = coefficients  # fmt: skip
    error = reference - hold * position
    push = p * error + integral
    level = coulomb + share * abs(load)
    mean = velocity
    stretch = position - anchor
    torque = friction = after = 0.0
    for _ in range(2):
        slip = (level + excess * exp(-(mean * fade) * (mean * fade))) / stiffness
        stretch = position - anchor
        if abs(stretch) > slip:
            stretch = slip if stretch > 0.0 else -slip
        friction = stiffness * stretch
        drag = damping + gain * d + lag
        after = (velocity * (inertia - old * step * drag) + step * (gain * push - load - friction)) / (
            inertia + new * step * drag
        )
        after = fastest if after > fastest else slowest if after < slowest else after
        middle = old * velocity + new * after
        torque = gain * (push - d * middle) - lag * middle
        if abs(torque + emf * middle) > stall:
            most = stall if torque + emf * middle > 0.0 else -stall
            drag = damping + emf
            after = (velocity * (inertia - old * step * drag) + step * (most - load - friction)) / (inertia + new * step * drag)
            after = fastest if after > fastest else slowest if after < slowest else after
            torque = most - emf * (old * velocity + new * after)
        if abs(torque) > limit:
            torque = limit if torque > 0.0 else -limit
            after = (velocity * (inertia - old * step * damping) + step * (torque - load - friction)) / (
                inertia + new * step * damping
            )
            after = fastest if after > fastest else slowest if after < slowest else after
        mean = 0.5 * (velocity + after)
    if stretch != position - anchor:
        anchor = position - stretch
    return after, mean, anchor, integral + i_step * error, torque, friction


def detailed_coefficients(
    values: Mapping[str, float], index: int, *, step: float, implicitness: float, mode: Mode
) -> tuple[float, ...]:
    """Constants of :func:`detailed_kick` for a kick of `step` s; implicitness: as of the plain motor's."""
    motor, controller = f"motor_{index}", f"controller_{index}"
    p, i, d = 1.0, 0.0, 0.0
    if mode.controller:
        i = values[f"{controller}_integral"]
        p = values[f"{controller}_proportional"] + 0.5 * i * step
        d = values[f"{controller}_derivative"]
    electric = electric_of(values, index, mode)
    return (
        p, 1.0 if mode.controller else 0.0, i * step, d, 1.0 - implicitness, implicitness, step,
        values[f"{motor}_inertia"], values[f"{motor}_damping"], *electric,
        values[f"{motor}_friction_torque"], values[f"{motor}_stribeck_friction"], 1.0 / values[f"{motor}_stribeck_velocity"],
        values[f"{motor}_load_friction"], values[f"{motor}_friction_stiffness"],
    )  # fmt: skip
