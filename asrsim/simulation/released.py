"""The released toolbox's order of a step, reproduced bit for bit wherever the released code has a defined result, so that old
runs can be reproduced.

The semi-implicit Euler method integrates the motors. In modes 5 and 6, the spring's torque on a motor is computed from the
motors' old positions, and the torque on the link from their new positions; this scheme is not passive. Actuators with one motor
also have the second motor that the released code integrates. In the SEA the second motor drives nothing; in AwAS-II the second
motor moves the adjuster, with constants of the released class.

Faults of the released code that are *not* reproduced, since they are undefined or useless: references are 0 and not random
memory before the first command; the load on AwAS-II's second motor is 0; the first step is as long as the second; mode 4 does
not overwrite its own reference; `inf` limits are infinite; constant arithmetic in tags is evaluated.
"""

from __future__ import annotations

import math
from typing import Any

from asrsim.actuators.parameters import FRICTION_STIFFNESS
from asrsim.simulation.laws import spring_law
from asrsim.simulation.layout import (
    ANCHOR,
    AT_LIMIT,
    CONTROLLED,
    D_COULOMB,
    D_DAMPING,
    D_DERIVATIVE,
    D_HIGH,
    D_HOLD,
    D_INERTIA,
    D_INTEGRAL,
    D_LIMIT,
    D_LOW,
    D_PROPORTIONAL,
    DIRECT,
    DRIVE_TORQUE,
    DYNAMIC,
    ENGINE_VELOCITY,
    FIRST_DRIVE,
    FIRST_MOTOR,
    FRICTION,
    GOALS,
    INTEGRAL,
    KICK_POSITION,
    KIND,
    LAW,
    LOAD,
    MEAN_VELOCITY,
    MOTOR_INTEGRAL,
    MOTOR_POSITION,
    MOTOR_VELOCITY,
    P_DERIVATIVE,
    P_INTEGRAL,
    P_PROPORTIONAL,
    PER_DRIVE,
    PER_MOTOR,
    POSITION,
    ROW_WORK,
    SPRING_LAW,
    SPRUNG,
    THETAS,
    TORQUE,
    TORQUES,
)  # fmt: skip

PHANTOM = {D_INERTIA: 0.0233, D_DAMPING: 0.2698, D_LIMIT: 6.0, D_LOW: -math.inf, D_HIGH: math.inf}
"""Constants of the released DCMotor class, which simulates a second motor for every actuator: columns of P and values. Units:
inertia kg m^2, damping N m s/rad, torque N m, positions rad."""
PHANTOM_SEA = {D_COULOMB: 0.02, D_PROPORTIONAL: 125.0, D_INTEGRAL: 0.0, D_DERIVATIVE: 4.5}
"""Constants of the second motor that the released SEA plugin also updates: friction in N m, PID gains in N m/rad, N m/(rad s)
and N m s/rad."""
PHANTOM_AWAS_II = {D_COULOMB: 0.5, D_PROPORTIONAL: 164.0, D_INTEGRAL: 0.0, D_DERIVATIVE: 41.0}
"""Constants of the second motor that the released AwAS-II plugin updates: friction in N m, PID gains in N m/rad, N m/(rad s)
and N m s/rad."""
MOTORS = 2
"""Number of motors that every released actuator integrates."""


def released_step(s: Any, p: Any, k: Any, u: Any, h: float, note: int) -> None:
    """Advance a joint by h s in the released order; see `asrsim.simulation.kernel.advance`."""
    if k[KIND] == SPRUNG:
        _springs(s, p, k, u, h)
    elif k[KIND] == CONTROLLED:
        error = u[GOALS] - s[POSITION]
        s[INTEGRAL] += p[P_INTEGRAL] * error * h
        s[TORQUE] = s[INTEGRAL] + p[P_PROPORTIONAL] * error + p[P_DERIVATIVE] * (0.0 - s[ENGINE_VELOCITY])
    elif k[KIND] == DIRECT:
        s[TORQUE] = u[GOALS]
    else:
        s[TORQUE] = 0.0


def _springs(s: Any, p: Any, k: Any, u: Any, h: float) -> None:
    moving = k[DYNAMIC] > 0
    controlled = moving and p[FIRST_DRIVE + D_HOLD] != 0.0
    thetas, torques = k[THETAS], k[TORQUES]
    for i in range(MOTORS):
        s[thetas + i] = s[FIRST_MOTOR + i * PER_MOTOR + MOTOR_POSITION] if moving else u[GOALS + i]
    spring_law(k[SPRING_LAW], s, thetas, torques, p, k[LAW], s[POSITION], 0)
    for i in range(MOTORS):
        m = FIRST_MOTOR + i * PER_MOTOR
        if moving:
            _move(s, p, m, FIRST_DRIVE + i * PER_DRIVE, u[GOALS + i], s[torques + i], controlled, h)
            s[thetas + i] = s[m + MOTOR_POSITION]
        s[m + KICK_POSITION] = s[thetas + i]
    if controlled:
        spring_law(k[SPRING_LAW], s, thetas, torques, p, k[LAW], s[POSITION], 0)
    for i in range(MOTORS):
        s[FIRST_MOTOR + i * PER_MOTOR + LOAD] = s[torques + i]
    s[TORQUE] = s[torques] + s[torques + 1]


def _move(s: Any, p: Any, m: int, d: int, goal: float, load: float, controlled: bool, h: float) -> None:
    """Update a motor as the released DCMotor does: controller, friction at the old position, acceleration, velocity, position,
    limits. The published torque is NaN at a limit."""
    position, velocity, push = s[m + MOTOR_POSITION], s[m + MOTOR_VELOCITY], goal
    if controlled:
        error = goal - position
        s[m + MOTOR_INTEGRAL] += p[d + D_INTEGRAL] * error * h
        push = s[m + MOTOR_INTEGRAL] + p[d + D_PROPORTIONAL] * error + p[d + D_DERIVATIVE] * (0.0 - velocity)
    if push > p[d + D_LIMIT]:
        push = p[d + D_LIMIT]
    elif push < -p[d + D_LIMIT]:
        push = -p[d + D_LIMIT]
    slip = p[d + D_COULOMB] / FRICTION_STIFFNESS
    if position - s[m + ANCHOR] > slip:
        s[m + ANCHOR] = position - slip
    elif position - s[m + ANCHOR] < -slip:
        s[m + ANCHOR] = position + slip
    friction = FRICTION_STIFFNESS * (position - s[m + ANCHOR])
    before = position
    velocity = velocity + (push - load - friction - p[d + D_DAMPING] * velocity) / p[d + D_INERTIA] * h
    position = position + velocity * h
    if position > p[d + D_HIGH] or position < p[d + D_LOW]:
        position = p[d + D_HIGH] if position > p[d + D_HIGH] else p[d + D_LOW]
        velocity, push = 0.0, math.nan
        s[m + AT_LIMIT] = 2.0
    way = position - before
    s[m + ROW_WORK] = 0.5 * (s[m + DRIVE_TORQUE] + push) * way
    s[m + ROW_WORK + 1] = (0.5 * (s[m + FRICTION] + friction) + p[d + D_DAMPING] * velocity) * way
    s[m + MOTOR_POSITION], s[m + MOTOR_VELOCITY], s[m + MEAN_VELOCITY] = position, velocity, velocity
    s[m + DRIVE_TORQUE], s[m + FRICTION] = push, friction
