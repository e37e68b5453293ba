"""Energy balance of a joint over a substep, and counts of the limits that acted. The functions run as Python or compiled.

Work is the mean torque times the displacement: the trapezoidal rule, of second order in the step. If an input jumps, there are
separate means before and after the jump. With the default stepping the residual of the balance thus decreases as h^2. If the
step is too large for a spring, the residual stays large, which reveals divergence before any number overflows.
"""

from __future__ import annotations

from typing import Any

from asrsim.simulation.laws import spring_law
from asrsim.simulation.layout import (
    APPLIED,
    APPLIED_BEFORE,
    APPLIED_LAST,
    APPLIED_NEXT,
    AT_LIMIT,
    CURRENT,
    D_HIGH,
    D_INERTIA,
    D_LOW,
    D_MAX_TORQUE,
    D_MOST,
    D_RESISTANCE,
    DAMPING_LOSS,
    DEFLECTION,
    DEFLECTION_COUNT,
    DRIVE_TORQUE,
    DYNAMIC,
    EFFORT_COUNT,
    EXCESS,
    FIRST_DRIVE,
    FIRST_MOTOR,
    FRICTION_LOSS,
    HYSTERESIS,
    HYSTERESIS_LOSS,
    JUMPED,
    KICK_POSITION,
    KIND,
    LAST_AT_LIMIT,
    LAST_DEFLECTION,
    LAST_HYSTERESIS,
    LAST_KICK_POSITION,
    LAST_MEAN_VELOCITY,
    LAST_POSITION,
    LAST_POWER,
    LAW,
    LAW_ENERGY,
    LIMIT_LOSS,
    LINK_WORK,
    MEAN_VELOCITY,
    MOTOR_ENERGY,
    MOTOR_SPEED_COUNT,
    MOTOR_STOP_COUNT,
    MOTOR_WORK,
    MOTORS,
    NET_LINK_WORK,
    P_EFFORT,
    P_FASTEST,
    P_HIGHEST,
    P_LENGTH,
    P_LEVEL,
    P_LOWEST,
    P_MAX_DEFLECTION,
    PER_DRIVE,
    PER_MOTOR,
    PLACED,
    POSITION,
    PUSHES,
    RESIDUAL,
    ROW_WORK,
    SATURATION_COUNT,
    SPRING_ENERGY,
    SPRING_LAW,
    SPRINGS,
    SPRUNG,
    START_ENERGY,
    STEP,
    STIFFEST,
    STIFFNESS,
    STOP_COUNT,
    THETAS,
    TORQUE,
    TORQUES,
    TURNOVER,
    VELOCITY,
    VELOCITY_COUNT,
    WINDING_LOSS,
)  # fmt: skip

AT_STOP = 1e-12
"""Distance in rad or m from a stop below which a motor counts as being at the stop, as a margin for rounding."""
SHARE = 0.5
"""Residual of the energy balance, as a fraction of the turnover, above which a run counts as diverged."""
FULL = 1.0 - 1e-9
"""Fraction of the speed limit above which a motor counts as being at the limit."""


def update_energies(s: Any, p: Any, k: Any, z: Any, first: bool, jumped: bool, recorded: bool) -> None:
    """Add the energy flows since the last substep to the energies of the joint, and store values for the next substep.

    first: whether this is the first substep of the run. jumped: whether an input jumps in this kick, so that
    the means over the half kicks differ from the present values. recorded: whether the row is recorded, so that the energies
    of the present state are needed.
    """
    before, following = (APPLIED_BEFORE, APPLIED_NEXT) if jumped else (APPLIED, APPLIED)
    sprung, dynamic = k[KIND] == SPRUNG, k[DYNAMIC]
    kinematic = sprung and dynamic < k[PLACED]
    energy_before = s[SPRING_ENERGY]
    if sprung and (recorded or first or kinematic):
        s[SPRING_ENERGY] = s[LAW_ENERGY] + _hysteresis_energy(s, p, k)
        s[STIFFEST] = max(s[STIFFEST], abs(s[STIFFNESS]))
    if not first:
        half = 0.5 * (s[POSITION] - s[LAST_POSITION])
        link = (s[APPLIED_LAST] + s[before]) * half
        damped = -(s[APPLIED_LAST + 2] + s[before + 2]) * half
        push = (s[APPLIED_LAST + 3] + s[before + 3]) * half
        work = link
        if sprung:
            lost = _hysteresis_loss(s, p, k)
            work = _motors(s, p, dynamic, z[STEP])
            if kinematic:
                jump = jumped or s[JUMPED] != 0.0
                work += _kinematic(s, p, k, before, s[SPRING_ENERGY] - energy_before + lost, jump)
            s[HYSTERESIS_LOSS] += lost
            s[LIMIT_LOSS] += (s[APPLIED_LAST + 1] + s[before + 1]) * half - link
        s[LINK_WORK] += link
        s[DAMPING_LOSS] += damped
        s[NET_LINK_WORK] += link + push - damped
        s[MOTOR_WORK] += work
        s[TURNOVER] += abs(link) + abs(push) + abs(work)
    if sprung and (recorded or first):
        _balance(s, p, k, first)
    s[LAST_POSITION] = s[POSITION]
    s[JUMPED] = 1.0 if jumped else 0.0
    for i in range(k[MOTORS]):
        m = FIRST_MOTOR + i * PER_MOTOR
        s[m + LAST_KICK_POSITION], s[m + LAST_MEAN_VELOCITY] = s[m + KICK_POSITION], s[m + MEAN_VELOCITY]
        s[m + LAST_AT_LIMIT], s[m + AT_LIMIT] = s[m + AT_LIMIT], 0.0
        resistance = p[FIRST_DRIVE + i * PER_DRIVE + D_RESISTANCE]
        if resistance != 0.0:
            s[m + LAST_POWER] = resistance * s[m + CURRENT] * s[m + CURRENT]
    for c in range(PUSHES):
        s[APPLIED_LAST + c] = s[following + c]


def _motors(s: Any, p: Any, dynamic: int, step: float) -> float:
    """Work in J of the motors with dynamics since the last substep; adds their losses to the losses of the joint."""
    total = lost = 0.0
    for i in range(dynamic):
        m, d = FIRST_MOTOR + i * PER_MOTOR, FIRST_DRIVE + i * PER_DRIVE
        work = s[m + ROW_WORK]
        total += work
        if s[m + AT_LIMIT] != 0.0 or s[m + LAST_AT_LIMIT] != 0.0:
            # A limit dissipates the rest of the balance: the energy of the impact, and the work of the torque at the limit.
            now, last = s[m + MEAN_VELOCITY], s[m + LAST_MEAN_VELOCITY]
            lost += work - s[m + ROW_WORK + 2] - 0.5 * p[d + D_INERTIA] * (now * now - last * last)
        else:
            lost += s[m + ROW_WORK + 1]
        if p[d + D_RESISTANCE] != 0.0:
            power = p[d + D_RESISTANCE] * s[m + CURRENT] * s[m + CURRENT]
            s[WINDING_LOSS] += 0.5 * step * (power + s[m + LAST_POWER])
    s[FRICTION_LOSS] += lost
    return total


def _kinematic(s: Any, p: Any, k: Any, before: int, absorbed: float, jump: bool) -> float:
    """Work in J of motors and adjusters without dynamics: the change of the springs' energy by their motion, with all other
    positions at their means. If an input jumps, the work is the energy that the springs absorbed (J) plus their work on the
    link."""
    half = 0.5 * (s[POSITION] - s[LAST_POSITION])
    if jump:
        work: float = absorbed + (s[APPLIED_LAST + 1] + s[before + 1]) * half
        for i in range(k[DYNAMIC]):
            work -= s[FIRST_MOTOR + i * PER_MOTOR + ROW_WORK + 2]
        return work
    middle = 0.5 * (s[POSITION] + s[LAST_POSITION])
    now = _energy_at(s, p, k, middle, KICK_POSITION)
    work = now - _energy_at(s, p, k, middle, LAST_KICK_POSITION)
    for i in range(k[DYNAMIC], k[SPRINGS]):
        m = FIRST_MOTOR + i * PER_MOTOR
        way = s[m + KICK_POSITION] - s[m + LAST_KICK_POSITION]
        work += 0.5 * (s[m + HYSTERESIS] + s[m + LAST_HYSTERESIS]) * way
    return work


def _energy_at(s: Any, p: Any, k: Any, q: float, positions: int) -> float:
    """Energy of the springs in J for a link at q rad. Motors with dynamics are at their mean positions, the others at the
    positions in the column `positions`."""
    for i in range(k[MOTORS]):
        m = FIRST_MOTOR + i * PER_MOTOR
        half_way = 0.5 * (s[m + KICK_POSITION] + s[m + LAST_KICK_POSITION])
        s[k[THETAS] + i] = half_way if i < k[DYNAMIC] else s[m + positions]
    stiffness, energy = s[STIFFNESS], s[LAW_ENERGY]
    spring_law(k[SPRING_LAW], q, s, k[THETAS], p, k[LAW], k[TORQUES], 1)
    energy_there = s[LAW_ENERGY]
    s[STIFFNESS], s[LAW_ENERGY] = stiffness, energy
    return energy_there  # type: ignore[no-any-return]


def _hysteresis_energy(s: Any, p: Any, k: Any) -> float:
    """Energy in J that is stored in the springs' hysteresis."""
    total = 0.0
    if p[P_LEVEL] > 0.0:
        for i in range(k[SPRINGS]):
            torque = s[FIRST_MOTOR + i * PER_MOTOR + HYSTERESIS]
            total += 0.5 * p[P_LENGTH] * torque * torque / p[P_LEVEL]
    return total


def _hysteresis_loss(s: Any, p: Any, k: Any) -> float:
    """Energy in J lost in the springs' hysteresis since the last substep. The result is exact for motion in one direction, so
    it is never negative."""
    total = 0.0
    if p[P_LEVEL] > 0.0:
        for i in range(k[SPRINGS]):
            m = FIRST_MOTOR + i * PER_MOTOR
            moved = s[m + DEFLECTION] - s[m + LAST_DEFLECTION]
            now, last = s[m + HYSTERESIS], s[m + LAST_HYSTERESIS]
            stored = 0.5 * p[P_LENGTH] * (now * now - last * last) / p[P_LEVEL]
            signed = now - last if moved > 0.0 else last - now
            total += p[P_LEVEL] * abs(moved) - p[P_LENGTH] * signed - stored
    return total


def _balance(s: Any, p: Any, k: Any, first: bool) -> None:
    """Compute the energy stored in springs and motors, and the residual of the energy balance since the start."""
    kinetic = 0.0
    for i in range(k[DYNAMIC]):
        m, d = FIRST_MOTOR + i * PER_MOTOR, FIRST_DRIVE + i * PER_DRIVE
        kinetic += 0.5 * p[d + D_INERTIA] * s[m + MEAN_VELOCITY] * s[m + MEAN_VELOCITY]
    s[MOTOR_ENERGY] = kinetic
    stored = s[SPRING_ENERGY] + kinetic
    if first:
        s[START_ENERGY] = stored
    s[RESIDUAL] = (
        s[MOTOR_WORK] - s[FRICTION_LOSS] - s[LINK_WORK] - s[LIMIT_LOSS] - s[HYSTERESIS_LOSS] - (stored - s[START_ENERGY])
    )
    s[EXCESS] = max(s[EXCESS], abs(s[RESIDUAL]) - SHARE * s[TURNOVER])


def count_limits(s: Any, p: Any, k: Any) -> None:
    """Count the limits of the joint that act in this substep."""
    if abs(s[TORQUE]) > p[P_EFFORT]:
        s[EFFORT_COUNT] += 1.0
    if abs(s[VELOCITY]) > p[P_FASTEST]:
        s[VELOCITY_COUNT] += 1.0
    if s[POSITION] <= p[P_LOWEST] or s[POSITION] >= p[P_HIGHEST]:
        s[STOP_COUNT] += 1.0
    if k[KIND] != SPRUNG:
        return
    dynamic, springs = k[DYNAMIC], k[SPRINGS]
    saturated = bent = False
    for i in range(k[MOTORS]):
        m, d = FIRST_MOTOR + i * PER_MOTOR, FIRST_DRIVE + i * PER_DRIVE
        theta = s[m + KICK_POSITION]
        if i < springs and abs(theta - s[POSITION]) > p[P_MAX_DEFLECTION]:
            bent = True
        if i >= dynamic:
            continue
        if abs(s[m + DRIVE_TORQUE]) >= p[d + D_MAX_TORQUE]:
            saturated = True
        if theta <= p[d + D_LOW] + AT_STOP or theta >= p[d + D_HIGH] - AT_STOP:
            s[MOTOR_STOP_COUNT] += 1.0
        if abs(s[m + MEAN_VELOCITY]) >= FULL * p[d + D_MOST]:
            s[MOTOR_SPEED_COUNT] += 1.0
    if saturated:
        s[SATURATION_COUNT] += 1.0
    if bent:
        s[DEFLECTION_COUNT] += 1.0
