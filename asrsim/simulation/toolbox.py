"""The released toolbox's order of a step, bit for bit where it is defined, for people who must reproduce old runs.

Semi-implicit Euler motors; in modes 5 and 6 the motors get the spring's torque at their old positions and the link the
torque at their new ones (not passive). One-motor actuators carry the second motor that the released code integrates too:
for the SEA it drives nothing, for AwAS-II it moves the adjuster, with the class's own constants.

Faults of the released code that are *not* kept, since they are not defined or serve nobody: references are 0 and not random
memory before the first command; the load on AwAS-II's second motor is 0; the first step is as long as the second; mode 4 does
not overwrite its own reference; `inf` limits are infinite; constant arithmetic in tags is evaluated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from asrsim.actuators.base import Actuator
from asrsim.actuators.modes import Mode
from asrsim.actuators.parameters import FRICTION_STIFFNESS
from asrsim.simulation.kernels import Advance, advance_passive, advance_torque

IDLE_MOTOR = (0.0, 0.0, 0.0, 0.0)
"""State of a motor at rest."""

PHANTOM_MOTOR = (0.0233, 0.2698, 6.0, -math.inf, math.inf)
"""Inertia (kg m^2), damping (N m s/rad), torque limit (N m) and position limits (rad) of the released DCMotor."""
PHANTOM_SEA = {"friction_torque": 0.02, "proportional": 125.0, "integral": 0.0, "derivative": 4.5}
"""N m, N m/rad, N m/(rad s), N m s/rad of the motor that the released SEA plugin updates beside its own."""
PHANTOM_AWAS_II = {"friction_torque": 0.5, "proportional": 164.0, "integral": 0.0, "derivative": 41.0}
"""The second motor of one-motor actuators: defaults of the released classes (N m; N m/rad, N m/(rad s), N m s/rad)."""


def toolbox_motor(
    position: float, velocity: float, anchor: float, push: float, load: float, step: float, constants: tuple[float, ...]
) -> tuple[float, float, float, float, float]:
    """One update of the released DCMotor: friction from the old position, then acceleration, velocity, position, limits.

    Returns position, velocity, anchor, published effort (NaN at a limit), friction torque.
    """
    inertia, damping, limit, low, high, friction_torque = constants[:6]
    if push > limit:
        push = limit
    elif push < -limit:
        push = -limit
    slip = friction_torque / FRICTION_STIFFNESS
    if position - anchor > slip:
        anchor = position - slip
    elif position - anchor < -slip:
        anchor = position + slip
    friction = FRICTION_STIFFNESS * (position - anchor)
    velocity = velocity + (push - load - friction - damping * velocity) / inertia * step
    position = position + velocity * step
    if position > high:
        return high, 0.0, anchor, math.nan, friction
    if position < low:
        return low, 0.0, anchor, math.nan, friction
    return position, velocity, anchor, push, friction


def motor_constants(actuator: type[Actuator], values: Mapping[str, float], index: int) -> tuple[float, ...]:
    """Inertia, damping, torque limit, position limits, friction, P, I, D of motor `index`, phantom ones included."""
    gains = ("proportional", "integral", "derivative")
    if index <= actuator.motors:
        motor, controller = f"motor_{index}_", f"controller_{index}_"
        names = ("inertia", "damping", "max_torque", "min_position", "max_position", "friction_torque")
        return (*(values[motor + name] for name in names), *(values[controller + name] for name in gains))
    phantom = PHANTOM_AWAS_II if actuator.adjuster else PHANTOM_SEA
    return (*PHANTOM_MOTOR, phantom["friction_torque"], *(phantom[name] for name in gains))


def toolbox_constants(actuator: type[Actuator], values: Mapping[str, float], mode: Mode, step: float) -> Any:
    """Constants of :func:`make_toolbox_advance` for a step of `step` s."""
    if mode.number == 1:
        return (values["controller_1_proportional"], values["controller_1_integral"], values["controller_1_derivative"], step)
    return (actuator.law_values(values), step, motor_constants(actuator, values, 1), motor_constants(actuator, values, 2))


def make_toolbox_advance(actuator: type[Actuator] | None, mode: Mode | None) -> tuple[Advance, tuple[float, ...]]:
    """The joint's step in the released order, and its initial state: motors at 0, wherever the link is."""
    if actuator is None or mode is None:
        return advance_passive, ()
    if mode.number == 0:
        return advance_torque, ()
    if mode.number == 1:
        return _advance_link_controller, (0.0,)
    elastic_torques, controlled = actuator.elastic_torques, mode.controller

    def advance_ideal(
        state: Any, constants: Any, q: float, v: float, r_1: float, r_2: float
    ) -> tuple[float, Any, tuple[float, ...]]:
        torque_1, torque_2 = elastic_torques(q, r_1, r_2, constants[0])
        return torque_1 + torque_2, state, (torque_1, torque_2, r_1, 0.0, 0.0, 0.0, r_2, 0.0, 0.0, 0.0)

    def advance_motors(
        state: Any, constants: Any, q: float, v: float, r_1: float, r_2: float
    ) -> tuple[float, Any, tuple[float, ...]]:
        elastic, step, motor_1, motor_2 = constants
        x, v_x, anchor_x, integral_x, y, v_y, anchor_y, integral_y = state
        push_x, push_y = r_1, r_2
        torque_x, torque_y = elastic_torques(q, x, y, elastic)
        if controlled:
            error_x, error_y = push_x - x, push_y - y
            integral_x = integral_x + motor_1[7] * error_x * step
            integral_y = integral_y + motor_2[7] * error_y * step
            push_x = integral_x + motor_1[6] * error_x + motor_1[8] * (0.0 - v_x)
            push_y = integral_y + motor_2[6] * error_y + motor_2[8] * (0.0 - v_y)
        x, v_x, anchor_x, drive_x, friction_x = toolbox_motor(x, v_x, anchor_x, push_x, torque_x, step, motor_1)
        y, v_y, anchor_y, drive_y, friction_y = toolbox_motor(y, v_y, anchor_y, push_y, torque_y, step, motor_2)
        if controlled:
            torque_x, torque_y = elastic_torques(q, x, y, elastic)
        record = (torque_x, torque_y, x, v_x, drive_x, friction_x, y, v_y, drive_y, friction_y)
        return torque_x + torque_y, (x, v_x, anchor_x, integral_x, y, v_y, anchor_y, integral_y), record

    return (advance_motors, IDLE_MOTOR * 2) if mode.motor else (advance_ideal, ())


def _advance_link_controller(
    state: Any, constants: Any, q: float, v: float, r_1: float, r_2: float
) -> tuple[float, Any, tuple[float, ...]]:
    p, i, d, step = constants
    error = r_1 - q
    integral = state[0] + i * error * step
    torque = integral + p * error + d * (0.0 - v)
    return torque, (integral,), advance_torque(state, constants, q, v, torque, r_2)[2]
