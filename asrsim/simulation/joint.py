"""One substep of a joint: measurements of its sensors, motion of its motors, springs, limits, and the torque on its link.

The functions work on the rows of one joint (`asrsim.simulation.layout`) and run as Python or compiled.
"""

from __future__ import annotations

from math import ceil, exp, floor, sqrt
from typing import Any

from asrsim.actuators.hysteresis import dahl
from asrsim.actuators.motor import motor_kick, velocity_bounds
from asrsim.simulation.laws import joint_step, numbers, spring_law
from asrsim.simulation.layout import (
    ANCHOR,
    APPLIED,
    AT_LIMIT,
    BRAKE,
    CONTROLLED,
    CONTROLLERS,
    CURRENT,
    D_CONSTANT,
    D_DAMPING,
    D_HIGH,
    D_LOW,
    D_MOST,
    D_RESISTANCE,
    DEFLECTION,
    DIRECT,
    DRIVE_TORQUE,
    DYNAMIC,
    ENGINE_VELOCITY,
    FIRST_DRIFT,
    FIRST_DRIVE,
    FIRST_MOTOR,
    FRICTION,
    GOALS,
    HYSTERESIS,
    IMPLICITNESS,
    INTEGRAL,
    JOINT_STEP,
    KICK_POSITION,
    KIND,
    LAST_DEFLECTION,
    LAST_ENGINE_VELOCITY,
    LAST_HYSTERESIS,
    LAW,
    LOAD,
    MEAN_VELOCITY,
    MOTOR_INTEGRAL,
    MOTOR_POSITION,
    MOTOR_VELOCITY,
    MOTOR_WORKS,
    MOTORS,
    ON_LINK,
    P_BRAKE,
    P_COULOMB,
    P_CUTOFF,
    P_DAMPING,
    P_DAMPING_INERTIA,
    P_DAMPING_RATIO,
    P_DELAY,
    P_DERIVATIVE,
    P_EFFORT,
    P_FADE,
    P_FASTEST,
    P_INTEGRAL,
    P_LENGTH,
    P_LEVEL,
    P_PROPORTIONAL,
    P_QUANTUM,
    P_REST,
    P_SHARE,
    P_SPRING,
    P_STRIBECK,
    P_SUBSTEPS,
    PER_DRIVE,
    PER_MOTOR,
    POSITION,
    READ_ERROR,
    READ_PUSH,
    RING,
    RINGS,
    ROW_WORK,
    SPRING_LAW,
    SPRINGS,
    SPRUNG,
    STEP,
    STIFFNESS,
    THETAS,
    TORQUE,
    TORQUES,
    VOLTAGE,
    WEIGHT_LAST,
    WEIGHT_NOW,
    WORK,
)  # fmt: skip


def read_sensors(s: Any, p: Any, k: Any, z: Any, u: Any) -> None:
    """Compute the errors of the measured positions and velocities. Measurements are delayed and held until the next sample;
    positions are also noisy and quantised.

    A ring buffer stores past positions and velocities. The buffer is followed by the index of its newest entry and by the last
    measurement.
    """
    size = int(p[P_DELAY]) + 2
    for i in range(k[CONTROLLERS]):
        m, ring = FIRST_MOTOR + i * PER_MOTOR, k[RINGS] + i * k[RING]
        if k[ON_LINK]:
            ahead = 0.0
            x, lagging = s[POSITION], z[WEIGHT_NOW] * s[ENGINE_VELOCITY] + z[WEIGHT_LAST] * s[LAST_ENGINE_VELOCITY]
            gain = p[P_DERIVATIVE]
        else:
            # The sensor measures at the time of the kick, to which the motor's position is extrapolated by this fraction of a
            # step.
            ahead = z[FIRST_DRIFT]
            lagging = s[m + MOTOR_VELOCITY]
            x = s[m + MOTOR_POSITION] + ahead * z[STEP] * lagging
            gain = p[FIRST_DRIVE + i * PER_DRIVE + 2]
        newest = int(s[ring + 2 * size])
        speed = (1.0 + ahead) * lagging - ahead * s[ring + 2 * ((newest + size - 1) % size) + 1]
        s[ring + 2 * newest], s[ring + 2 * newest + 1] = x, lagging
        oldest = (newest + 1) % size
        s[ring + 2 * size] = float(oldest)
        samples = GOALS + k[MOTORS] + 2 * i
        if u[samples] != 0.0:
            late = (newest + 2) % size
            reading = s[ring + 2 * late] + u[samples + 1]
            if p[P_QUANTUM] > 0.0:
                reading = p[P_QUANTUM] * floor(reading / p[P_QUANTUM] + 0.5)
            s[ring + 2 * size + 1] = reading
            s[ring + 2 * size + 2] = (1.0 + ahead) * s[ring + 2 * late + 1] - ahead * s[ring + 2 * oldest + 1]
        s[m + READ_ERROR] = s[ring + 2 * size + 1] - x
        s[m + READ_PUSH] = -gain * (s[ring + 2 * size + 2] - speed)


def advance(s: Any, p: Any, k: Any, z: Any, u: Any, h: float, noted: bool, whole: bool) -> None:
    """Advance motors and controllers by h s under the inputs u, with the link at its present position, and set s[TORQUE].

    noted: whether the recorded values of the motors are stored; with motor substeps, these are the values of the middle motor
    substep. With h = 0 nothing moves. whole: whether stiffness and energy of the springs are computed too.
    """
    kind = k[KIND]
    if k[JOINT_STEP]:
        joint_step(k[JOINT_STEP], s, p, k, u, h, int(noted))
        if whole and kind == SPRUNG:
            find_state(s, p, k)
    elif kind == SPRUNG:
        _advance_springs(s, p, k, z, u, h, noted, whole)
    elif kind == CONTROLLED:
        # A PID controller on the rigid link (paper eq. 11); its derivative action acts as damping: see `limit`.
        error = u[GOALS] - s[FIRST_MOTOR + READ_ERROR] - s[POSITION]
        more = p[P_INTEGRAL] * h * error
        s[TORQUE] = p[P_PROPORTIONAL] * error + s[INTEGRAL] + s[FIRST_MOTOR + READ_PUSH] + 0.5 * more
        s[INTEGRAL] += more
    elif kind == DIRECT:
        s[TORQUE] = u[GOALS]
    else:
        s[TORQUE] = 0.0


def _advance_springs(s: Any, p: Any, k: Any, z: Any, u: Any, h: float, noted: bool, whole: bool) -> None:
    """Advance motors and springs by drift, kick, drift; second order if half of the drift precedes the kick.

    During motor substeps the link does not move. The mean spring torque of the motor substeps acts on the link, which keeps the
    torque bounded.
    """
    motors, dynamic, thetas, torques = k[MOTORS], k[DYNAMIC], k[THETAS], k[TORQUES]
    turns, step = 1, h
    if p[P_SUBSTEPS] > 1.0:
        turns = ceil(p[P_SUBSTEPS] * h / z[STEP])
        # The number of motor substeps is odd, also in a piece of a kick, so that there is a middle substep.
        turns += 1 - turns % 2
        step = h / turns
    before = z[FIRST_DRIFT] * step
    q, total = s[POSITION], 0.0
    for turn in range(turns):
        for i in range(motors):
            if i < dynamic:
                m, d = FIRST_MOTOR + i * PER_MOTOR, FIRST_DRIVE + i * PER_DRIVE
                s[thetas + i] = _between(s[m + MOTOR_POSITION] + before * s[m + MOTOR_VELOCITY], p[d + D_LOW], p[d + D_HIGH])
            else:
                s[thetas + i] = u[GOALS + i]
        now = noted and turn == turns // 2
        spring_law(k[SPRING_LAW], q, s, thetas, p, k[LAW], torques, int(whole and turn == turns // 2))
        if p[P_LEVEL] > 0.0:
            for i in range(k[SPRINGS]):
                s[torques + i] += hysteresis(s, p, i, s[thetas + i] - q)
        for i in range(motors):
            total += s[torques + i]
        for i in range(dynamic):
            _kick(s, p, k, z, u[GOALS + i], i, step, before, now)
        if now:
            for i in range(motors):
                m = FIRST_MOTOR + i * PER_MOTOR
                s[m + LOAD], s[m + KICK_POSITION] = s[torques + i], s[thetas + i]
    s[TORQUE] = total / turns


def _between(value: float, low: float, high: float) -> float:
    return high if value > high else low if value < low else value


def _kick(s: Any, p: Any, k: Any, z: Any, goal: float, i: int, step: float, before: float, noted: bool) -> None:
    """Compute the kick of motor i and the drift that follows, and add the works of the torques on the motor.

    The torques act for half a step with the velocity before the kick, and for half a step with the velocity after the kick.
    """
    m, d = FIRST_MOTOR + i * PER_MOTOR, FIRST_DRIVE + i * PER_DRIVE
    x, speed, load, pushed = s[k[THETAS] + i], s[m + MOTOR_VELOCITY], s[k[TORQUES] + i], s[m + READ_PUSH]
    slowest, fastest = velocity_bounds(x, p[d + D_LOW], p[d + D_HIGH], p[d + D_MOST], step)
    velocity, mean, anchor, integral, drive, friction = motor_kick(
        x, speed, s[m + ANCHOR], s[m + MOTOR_INTEGRAL] + pushed, goal - s[m + READ_ERROR],
        load, slowest, fastest, step, z[IMPLICITNESS], numbers(p, d),
    )  # fmt: skip
    s[m + MOTOR_POSITION] = _between(x + (step - before) * velocity, p[d + D_LOW], p[d + D_HIGH])
    s[m + MOTOR_VELOCITY], s[m + ANCHOR], s[m + MOTOR_INTEGRAL] = velocity, anchor, integral - pushed
    if step > 0.0 and (velocity >= fastest or velocity <= slowest):
        s[m + AT_LIMIT] = 1.0
    resistance = friction + p[d + D_DAMPING] * (speed + z[IMPLICITNESS] * (velocity - speed))
    _add_works(s, m, 0.5 * step * speed, drive, resistance, load)
    if noted:
        for c in range(MOTOR_WORKS):
            s[m + ROW_WORK + c], s[m + WORK + c] = s[m + WORK + c], 0.0
        constant = p[d + D_CONSTANT]
        s[m + DRIVE_TORQUE], s[m + FRICTION], s[m + MEAN_VELOCITY] = drive, friction, mean
        if constant > 0.0:
            s[m + CURRENT] = drive / constant
            s[m + VOLTAGE] = p[d + D_RESISTANCE] * s[m + CURRENT] + constant * mean
    _add_works(s, m, 0.5 * step * velocity, drive, resistance, load)


def _add_works(s: Any, m: int, way: float, drive: float, resistance: float, load: float) -> None:
    """Add the works of the torques (N m) on a motor that moves by `way` rad. m: first column of the motor in S."""
    s[m + WORK] += drive * way
    s[m + WORK + 1] += resistance * way
    s[m + WORK + 2] += load * way


def hysteresis(s: Any, p: Any, i: int, deflection: float) -> float:
    """Hysteresis torque of spring i in N m after the spring's deflection has changed from its value at the last kick to
    `deflection` rad."""
    m = FIRST_MOTOR + i * PER_MOTOR
    last = s[m + DEFLECTION]
    # Before the first kick there is no last deflection (NaN), and no change.
    change = deflection - last if last == last else 0.0
    return dahl(s[m + HYSTERESIS], change, p[P_LEVEL], p[P_LENGTH])


def remember_springs(s: Any, p: Any, k: Any) -> None:
    """Advance the hysteresis to the recorded kick, once per substep. Advancing the hysteresis in motor substeps, during which
    the link stands still, would wrongly erase part of the hysteresis memory."""
    for i in range(k[SPRINGS]):
        m = FIRST_MOTOR + i * PER_MOTOR
        deflection = s[m + KICK_POSITION] - s[POSITION]
        torque = hysteresis(s, p, i, deflection)
        s[m + LAST_HYSTERESIS], s[m + LAST_DEFLECTION] = s[m + HYSTERESIS], s[m + DEFLECTION]
        s[m + HYSTERESIS], s[m + DEFLECTION] = torque, deflection


def limit(s: Any, p: Any, v: float) -> float:
    """Derivative gain of the link's controller that acts at the velocity v; also stores the limited torque in s[APPLIED].

    The effort limit applies to the sum of torque and derivative action (mode 1). Within the limit the derivative action acts
    as damping; beyond the limit the derivative action is 0, and the torque equals the limit.
    """
    torque = s[TORQUE]
    if p[P_CUTOFF] != 0.0 and abs(s[ENGINE_VELOCITY]) >= p[P_FASTEST] and torque * s[ENGINE_VELOCITY] > 0.0:
        torque = 0.0
    braked = torque - p[P_BRAKE] * v
    if abs(braked) > p[P_EFFORT]:
        s[APPLIED] = p[P_EFFORT] if braked > 0.0 else -p[P_EFFORT]
        return 0.0
    s[APPLIED] = torque
    return p[P_BRAKE]  # type: ignore[no-any-return]


def push_of(s: Any, p: Any, external: float) -> float:
    """Sum of the external torque and the torque of the passive spring on the link, in N m."""
    return external + p[P_SPRING] * (p[P_REST] - s[POSITION])  # type: ignore[no-any-return]


def damping_of(s: Any, p: Any) -> float:
    """Viscous damping of the link in N m s/rad. A damping that varies with the stiffness k is c + 2 D sqrt(I k), with constant
    part c, damping ratio D and inertia I (paper section 4.2.2)."""
    if p[P_DAMPING_RATIO] == 0.0:
        return p[P_DAMPING]  # type: ignore[no-any-return]
    return p[P_DAMPING] + 2.0 * p[P_DAMPING_RATIO] * sqrt(max(p[P_DAMPING_INERTIA] * s[STIFFNESS], 0.0))  # type: ignore[no-any-return]


def find_state(s: Any, p: Any, k: Any) -> None:
    """Compute stiffness and energy of the springs at the recorded kick."""
    for i in range(k[MOTORS]):
        s[k[THETAS] + i] = s[FIRST_MOTOR + i * PER_MOTOR + KICK_POSITION]
    spring_law(k[SPRING_LAW], s[POSITION], s, k[THETAS], p, k[LAW], k[TORQUES], 1)


def friction_of(s: Any, p: Any, v: float) -> float:
    """Largest friction of the joint in N m: tau_c + c |tau| + tau_x exp(-(v / v_x)^2), with Coulomb friction tau_c, load
    coefficient c, actuator torque on the link tau, Stribeck excess tau_x and Stribeck velocity v_x. Friction dissipates energy
    at any level."""
    bound: float = p[P_COULOMB] + p[P_SHARE] * abs(s[APPLIED] - s[BRAKE] * v)
    if p[P_STRIBECK] > 0.0:
        ratio = v * p[P_FADE]
        bound += p[P_STRIBECK] * exp(-ratio * ratio)
    return bound
