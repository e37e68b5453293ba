"""The physics of a world: the loop over substeps, the substep of a joint, and the energy balance; as Python or compiled.

In a substep, sensors are read, motors move and their springs load the links; the engine moves the links; the energy balance is
updated. If an input jumps, the kick is split into pieces with separate inputs, which act on the links one after the other. The
functions work on the rows of one joint (`asrsim.simulation.layout`).

Work is the mean torque times the displacement: the trapezoidal rule, of second order in the step. If an input jumps, there are
separate means before and after the jump. With the default stepping the residual of the balance thus decreases as h^2. If the
step is too large for a spring, the residual stays large, which reveals divergence before any number overflows.
"""

from __future__ import annotations

from math import ceil, exp, floor, isfinite, nan, sqrt
from typing import Any

from asrsim.actuators.hysteresis import dahl
from asrsim.actuators.motor import motor_kick, velocity_bounds
from asrsim.simulation.laws import engine_step, joint_step, numbers, row, spring_law
from asrsim.simulation.layout import (
    ANCHOR,
    APPLIED,
    APPLIED_BEFORE,
    APPLIED_LAST,
    APPLIED_NEXT,
    AT_LIMIT,
    BRAKE,
    CONTROLLED,
    CONTROLLERS,
    CURRENT,
    D_CONSTANT,
    D_DAMPING,
    D_DERIVATIVE,
    D_HIGH,
    D_INERTIA,
    D_LOW,
    D_MAX_TORQUE,
    D_MOST,
    D_RESISTANCE,
    DAMPING,
    DAMPING_LOSS,
    DEFLECTION,
    DEFLECTION_COUNT,
    DIRECT,
    DRAG,
    DRIVE_TORQUE,
    DYNAMIC,
    E_DAMPING,
    E_FRICTION,
    E_POSITION,
    E_TORQUE,
    E_VELOCITY,
    EFFORT_COUNT,
    ENGINE_VELOCITY,
    EXCESS,
    EXTERNAL,
    FIRST_DRIFT,
    FIRST_DRIVE,
    FIRST_MOTOR,
    FREE,
    FREE_AFTER,
    FREE_BEFORE,
    FRICTION,
    FRICTION_LOSS,
    GOALS,
    HEALTHY,
    HYSTERESIS,
    HYSTERESIS_LOSS,
    IMPLICITNESS,
    INTEGRAL,
    JOINT_STEP,
    JUMPED,
    KICK_POSITION,
    KIND,
    KINETIC,
    LAST_DEFLECTION,
    LAST_ENGINE_VELOCITY,
    LAST_HYSTERESIS,
    LAST_KICK_POSITION,
    LAST_POSITION,
    LAST_POWER,
    LAW,
    LAW_ENERGY,
    LIMIT_LOSS,
    LINK_IMPLICITNESS,
    LINK_WORK,
    LOAD,
    MEAN_VELOCITY,
    MOTOR_ENERGY,
    MOTOR_INTEGRAL,
    MOTOR_POSITION,
    MOTOR_SPEED_COUNT,
    MOTOR_STOP_COUNT,
    MOTOR_VELOCITY,
    MOTOR_WORK,
    MOTOR_WORKS,
    MOTORS,
    NET_LINK_WORK,
    NO_VALUE,
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
    P_HIGHEST,
    P_INTEGRAL,
    P_LENGTH,
    P_LEVEL,
    P_LOWEST,
    P_MAX_DEFLECTION,
    P_PROPORTIONAL,
    P_QUANTUM,
    P_REST,
    P_SAMPLED,
    P_SHARE,
    P_SPRING,
    P_STRIBECK,
    P_SUBSTEPS,
    PER_DRIVE,
    PER_MOTOR,
    PLACED,
    POSITION,
    PUSH,
    PUSHES,
    RAN_AWAY,
    READ_ERROR,
    READ_PUSH,
    RESIDUAL,
    RING,
    RINGS,
    ROW_WORK,
    SATURATION_COUNT,
    SPRING_ENERGY,
    SPRING_LAW,
    SPRINGS,
    SPRUNG,
    STAGGERED,
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
    VOLTAGE,
    WEIGHT_LAST,
    WEIGHT_NOW,
    WINDING_LOSS,
    WORK,
)  # fmt: skip

FASTEST = 1e4
"""Link speed above which a world counts as diverged, rad/s (m/s)."""
ENDLESS = 1e300
"""Torque above which a torque counts as infinite, N m."""
AT_STOP = 1e-12
"""Distance in rad or m from a stop below which a motor or a link counts as being at the stop, as a margin for rounding."""
SHARE = 0.5
"""Residual of the energy balance, as a fraction of the turnover, above which a run counts as diverged."""
FULL = 1.0 - 1e-9
"""Fraction of the speed limit above which a motor counts as being at the limit."""


def run(
    which: Any, first: int, count: int, every: int, watched: int, done: Any, fault: Any, states: Any, constants: Any,
    kinds: Any, z: Any, engine_states: Any, inputs: Any, references: Any, wrenches: Any, lengths: Any, cuts: Any,
    exchange: Any, engine: int, record: int, columns: Any, goals: Any, out: Any, last_rows: Any, measured: Any, gains: Any,
    coordinates: Any,
) -> None:  # fmt: skip
    """Advance worlds by `count` substeps.

    which: a row (m, 4) for each world to advance: index of the world, of its inputs and references, of its part of `out`, and
    of its wrenches, lengths and cuts; first: first row of the inputs; every: number of substeps between recorded rows;
    watched: 1 to compute energies, limits and spring stiffness, otherwise 0; done: number (worlds,) of completed substeps;
    fault: health and faulty joint (worlds, 2); states, constants: S and P (worlds, joints, ...) of `asrsim.simulation.layout`;
    kinds: K (joints, ...); z: numbers of the stepping; engine_states: state of the engine (worlds, ...); inputs, references,
    wrenches, lengths, cuts: see `asrsim.simulation.inputs.Given`; exchange: data (pieces, joints, 5) shared with the engine;
    engine: address of the engine's step function, which receives `record`; columns, goals: recorded columns of S and of the
    references; out: recorded values (m, rows, joints, columns of S and of the references); last_rows: last recorded row of each
    world (worlds, joints, ...); measured, gains, coordinates: see `observe`, empty without an observer.
    """
    for chosen in range(len(which)):
        w, own_set, place, timing = which[chosen][0], which[chosen][1], which[chosen][2], which[chosen][3]
        kept = cut = 0
        s_all, p_all, x, u_all, r_all = states[w], constants[w], engine_states[w], inputs[own_set], references[own_set]
        pushes, own_lengths, own_cuts = wrenches[timing], lengths[timing], cuts[timing]
        while cut < len(own_cuts) and 0 <= own_cuts[cut][0] < first:
            cut += 1
        for step in range(first, first + count):
            if fault[w, 0] != HEALTHY:
                break
            substep = done[w]
            asked = substep % every == 0
            if asked and len(measured) > 0:
                observe(s_all, kinds, z, x, measured[place], substep // every, gains, coordinates)
            jumped = cut < len(own_cuts) and own_cuts[cut][0] == step
            begin, end, on_time = step, step + 1, step
            if jumped:
                begin, end, on_time = own_cuts[cut][1], own_cuts[cut][2], own_cuts[cut][3]
                cut += 1
            # Time at which the kick begins, in substeps after the time of the substep.
            first_moment = -0.5 * z[STAGGERED] if substep > 0 else 0.0
            for j in range(len(kinds)):
                s, p, k = row(s_all, j), row(p_all, j), row(kinds, j)
                v = z[WEIGHT_NOW] * s[ENGINE_VELOCITY] + z[WEIGHT_LAST] * s[LAST_ENGINE_VELOCITY]
                if k[CONTROLLERS]:
                    remember_positions(s, p, k, z)
                if jumped:
                    _clear_means(s)
                total = torque = applied = push = drag = stiffness = energy = 0.0
                since, until = first_moment, -first_moment
                # A split kick is evaluated once more at the time of the substep, with h = 0: values are recorded, and nothing
                # moves.
                for turn in range(begin, end + 1 if jumped else end):
                    at, h, noted, on_row = turn, z[STEP], True, jumped and turn == on_time
                    whole = (watched and asked) or p[P_DAMPING_RATIO] != 0.0 or k[DYNAMIC] < k[PLACED]
                    if on_row:
                        at, h, since, until = step, 0.0, 0.0, 0.0
                    elif jumped:
                        at = turn - 1 if turn > on_time else turn
                        h, noted, whole = float(own_lengths[at]) * z[STEP], False, p[P_DAMPING_RATIO] != 0.0
                        until = since + float(own_lengths[at])
                    u = row(u_all[at], j)
                    if k[CONTROLLERS]:
                        read_sensors(s, p, k, z, u, since, until)
                    since = until
                    advance(s, p, k, z, u, h, noted, whole)
                    s[BRAKE] = limit(s, p, v)
                    s[PUSH] = push_of(s, p, u[EXTERNAL])
                    s[DRAG] = damping_of(s, p)
                    load = s[APPLIED] + s[PUSH]
                    total += load
                    if on_row:
                        s[FREE] = 1.0 if s[BRAKE] != 0.0 else 0.0
                        torque, applied, push, drag = s[TORQUE], s[APPLIED], s[PUSH], s[DRAG]
                        stiffness, energy = s[STIFFNESS], s[LAW_ENERGY]
                        continue
                    exchange[at - begin, j, E_TORQUE] = load
                    exchange[at - begin, j, E_DAMPING] = s[DRAG] + s[BRAKE]
                    exchange[at - begin, j, E_FRICTION] = friction_of(s, p, v)
                    if jumped:
                        exchange[at - begin, j, E_VELOCITY] = nan
                        _add_piece(s, p, 2.0 * float(own_lengths[at]), turn > on_time)
                if jumped:
                    s[TORQUE], s[APPLIED], s[PUSH], s[DRAG] = torque, applied, push, drag
                    s[STIFFNESS], s[LAW_ENERGY], s[BRAKE] = stiffness, energy, p[P_BRAKE]
                if not abs(total) < ENDLESS:
                    fault[w, 0], fault[w, 1] = NO_VALUE, j
                    break
            if fault[w, 0] != HEALTHY:
                break
            engine_step(engine, record, x, exchange, pushes[begin:end], own_lengths[begin:end], end - begin)
            for j in range(len(kinds)):
                s, p, k = row(s_all, j), row(p_all, j), row(kinds, j)
                velocity = exchange[end - begin - 1, j, E_VELOCITY]
                now = 0.5 * (s[ENGINE_VELOCITY] + velocity)
                if substep == 0 or z[STAGGERED] == 0.0:
                    now = s[ENGINE_VELOCITY]
                elif jumped and isfinite(exchange[on_time - begin - 1, j, E_VELOCITY]):
                    now = exchange[on_time - begin - 1, j, E_VELOCITY]
                read_engine(s, p, z, velocity, now, jumped)
                if p[P_LEVEL] > 0.0:
                    remember_springs(s, p, k)
                if watched:
                    update_ledger(s, p, k, z, substep == 0, jumped, asked)
                if asked:
                    for c in range(len(columns)):
                        out[place, kept, j, c] = s[columns[c]]
                    for c in range(len(goals)):
                        out[place, kept, j, len(columns) + c] = r_all[step][j][goals[c]]
                # The first kick of a staggered run is half a kick: the velocity before the kick is extrapolated to the velocity
                # before a full kick.
                s[LAST_ENGINE_VELOCITY] = (
                    2.0 * s[ENGINE_VELOCITY] - velocity if substep == 0 and z[STAGGERED] != 0.0 else s[ENGINE_VELOCITY]
                )
                s[ENGINE_VELOCITY], s[POSITION] = velocity, exchange[end - begin - 1, j, E_POSITION]
                if not abs(velocity) <= FASTEST:
                    fault[w, 0], fault[w, 1] = RAN_AWAY, j
            if asked:
                kept += 1
            done[w] = substep + 1
        for j in range(len(kinds) if kept else 0):
            for c in range(len(columns) + len(goals)):
                last_rows[w, j, c] = out[place, kept - 1, j, c]


def observe(
    s_all: Any, kinds: Any, z: Any, x: Any, measured: Any, step: int, gains: Any, coordinates: Any
) -> None:  # fmt: skip
    """Move positions and velocities towards measured positions, and replace these by the errors before the correction.

    measured: positions (steps, joints, 1 + motors) of links and motors at whole steps; NaN: not measured. gains: change of the
    position and of the velocity (1/s) per error. coordinates: indices (3, joints) of position, velocity and previous velocity
    of each link in the engine's state x.
    """
    for j in range(len(kinds)):
        s = row(s_all, j)
        for c in range(measured.shape[2]):
            m = FIRST_MOTOR + (c - 1) * PER_MOTOR
            place = s[POSITION] if c == 0 else s[m + MOTOR_POSITION] + z[FIRST_DRIFT] * z[STEP] * s[m + MOTOR_VELOCITY]
            error = measured[step, j, c] - place
            measured[step, j, c] = error
            if not abs(error) < ENDLESS:
                continue
            near, fast = gains[0] * error, gains[1] * error
            if c > 0:
                s[m + MOTOR_POSITION] += near
                s[m + MOTOR_VELOCITY] += fast
                s[m + ANCHOR] += near
                continue
            s[POSITION] += near
            s[ENGINE_VELOCITY] += fast
            s[LAST_ENGINE_VELOCITY] += fast
            x[coordinates[0, j]] += near
            x[coordinates[1, j]] += fast
            x[coordinates[2, j]] += fast


def _clear_means(s: Any) -> None:
    """Set the mean torques over the half kicks before and after the time of the substep to 0."""
    for c in range(PUSHES):
        s[APPLIED_BEFORE + c] = s[APPLIED_NEXT + c] = 0.0
    s[FREE_BEFORE] = s[FREE_AFTER] = 0.0


def _add_piece(s: Any, p: Any, share: float, late: bool) -> None:
    """Add the torques in a piece of a kick to the means over half kicks. share: length of the piece as a fraction of a half
    kick; late: whether the piece follows the time of the substep."""
    side = APPLIED_NEXT if late else APPLIED_BEFORE
    s[side] += share * s[APPLIED]
    s[side + 1] += share * s[TORQUE]
    s[side + 3] += share * s[PUSH]
    if s[BRAKE] == p[P_BRAKE]:
        s[FREE_AFTER if late else FREE_BEFORE] += share


def read_engine(s: Any, p: Any, z: Any, velocity: float, now: float, jumped: bool) -> None:
    """Compute damping torque, applied torque and link velocity at the time of the substep. Damping and derivative action act on
    the mean velocity over the kick; if an input jumps, the values at the time of the substep are different.

    velocity: of the link in the engine after the kick; now: of the link at the time of the substep.
    """
    mean = s[ENGINE_VELOCITY] + z[LINK_IMPLICITNESS] * (velocity - s[ENGINE_VELOCITY])
    brake = -s[BRAKE] * mean
    s[DAMPING] = -s[DRAG] * mean
    s[VELOCITY] = now
    if jumped:
        s[APPLIED_BEFORE] += brake * s[FREE_BEFORE]
        s[APPLIED_NEXT] += brake * s[FREE_AFTER]
        s[APPLIED_BEFORE + 2] = s[APPLIED_NEXT + 2] = s[DAMPING]
        s[DAMPING] = -s[DRAG] * now
        applied = s[APPLIED] - s[FREE] * p[P_BRAKE] * now
        s[APPLIED] = min(max(applied, -p[P_EFFORT]), p[P_EFFORT])
    else:
        s[APPLIED] += brake


# -- substep of a joint -------------------------------------------------------------------------------------------------


def remember_positions(s: Any, p: Any, k: Any, z: Any) -> None:
    """Store the present positions and velocities in the memory of the sensors.

    A ring buffer stores positions at the times of the substeps, and velocities at the times to which they belong. The buffer is
    followed by the index of its newest entry and by the last sample.
    """
    size = _ring_size(p)
    for i in range(k[CONTROLLERS]):
        m, ring = FIRST_MOTOR + i * PER_MOTOR, k[RINGS] + i * k[RING]
        newest = (int(s[ring + 2 * size]) + 1) % size
        s[ring + 2 * size] = float(newest)
        if k[ON_LINK]:
            s[ring + 2 * newest], s[ring + 2 * newest + 1] = s[POSITION], s[ENGINE_VELOCITY]
        else:
            # The position of a motor is known at the beginning of the substep.
            ahead = z[FIRST_DRIFT] * z[STEP] * s[m + MOTOR_VELOCITY]
            s[ring + 2 * newest], s[ring + 2 * newest + 1] = s[m + MOTOR_POSITION] + ahead, s[m + MOTOR_VELOCITY]


def _ring_size(p: Any) -> int:
    """Number of entries of a sensor's ring buffer; see `asrsim.simulation.effects.Sensor.memory`."""
    return int(p[P_DELAY] + 0.5) + 3


def read_sensors(s: Any, p: Any, k: Any, z: Any, u: Any, since: float, until: float) -> None:
    """Compute the errors of the measured positions and velocities in a piece of a kick. Measurements are late; positions are
    also noisy and quantised.

    since, until: times at which the piece begins and ends, in substeps after the time of the substep. Sensors with ticks take
    samples at the beginning of a piece and hold them. Measurements of other sensors are those in the middle of the piece; the
    mean over the piece if they are quantised.
    """
    middle, size, delay = 0.5 * (since + until), _ring_size(p), p[P_DELAY]
    for i in range(k[CONTROLLERS]):
        m, ring, samples = FIRST_MOTOR + i * PER_MOTOR, k[RINGS] + i * k[RING], GOALS + k[MOTORS] + 2 * i
        sample, noise = ring + 2 * size + 1, u[GOALS + k[MOTORS] + 2 * i + 1]
        lag = 0.5 * z[STAGGERED] if k[ON_LINK] else z[FIRST_DRIFT]
        gain = p[P_DERIVATIVE] if k[ON_LINK] else p[FIRST_DRIVE + i * PER_DRIVE + D_DERIVATIVE]
        if p[P_SAMPLED] != 0.0:
            if u[samples] != 0.0:
                place = _position_at(s, z, ring, size, since - delay) + noise
                s[sample] = _quantised(place, place, p[P_QUANTUM])
                s[sample + 1] = _velocity_at(s, ring, size, lag, since - delay)
            place, speed = s[sample], s[sample + 1]
        else:
            place = _position_at(s, z, ring, size, middle - delay) + noise
            speed = _velocity_at(s, ring, size, lag, middle - delay)
            if p[P_QUANTUM] > 0.0:
                before = _position_at(s, z, ring, size, since - delay) + noise
                place = _quantised(before, _position_at(s, z, ring, size, until - delay) + noise, p[P_QUANTUM])
        s[m + READ_ERROR] = place - (s[POSITION] if k[ON_LINK] else _position_at(s, z, ring, size, middle))
        s[m + READ_PUSH] = -gain * (speed - _velocity_at(s, ring, size, lag, middle))


def _position_at(s: Any, z: Any, ring: int, size: int, time: float) -> float:
    """Position in rad at a time in substeps after the present one, on straight lines between the stored positions."""
    newest = int(s[ring + 2 * size])
    if time >= 0.0:
        return s[ring + 2 * newest] + time * z[STEP] * s[ring + 2 * newest + 1]  # type: ignore[no-any-return]
    back = int(-time)
    later, earlier = ring + 2 * ((newest + size - back) % size), ring + 2 * ((newest + size - back - 1) % size)
    return s[later] + (-time - back) * (s[earlier] - s[later])  # type: ignore[no-any-return]


def _velocity_at(s: Any, ring: int, size: int, lag: float, time: float) -> float:
    """Velocity in rad/s at a time in substeps after the present one, on straight lines through the stored velocities, which
    belong to times `lag` substeps before those of the positions."""
    newest = int(s[ring + 2 * size])
    back = int(max(-time - lag, 0.0))
    later, earlier = ring + 2 * ((newest + size - back) % size), ring + 2 * ((newest + size - back - 1) % size)
    return s[later + 1] + (-time - lag - back) * (s[earlier + 1] - s[later + 1])  # type: ignore[no-any-return]


def _quantised(first: float, last: float, quantum: float) -> float:
    """Mean of the nearest multiples of the quantum for values that change evenly from `first` to `last`."""
    if quantum <= 0.0:
        return 0.5 * (first + last)
    start, end = first / quantum + 0.5, last / quantum + 0.5
    lowest = floor(start)
    steps = floor(end) - lowest
    if steps == 0:
        return quantum * lowest
    # The integral of the staircase floor(x) from 0 to x is steps (x - (steps + 1) / 2).
    return quantum * (lowest + steps * (end - lowest - 0.5 * (steps + 1)) / (end - start))


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
        spring_law(k[SPRING_LAW], s, thetas, torques, p, k[LAW], q, int(whole and turn == turns // 2))
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
        s[m + AT_LIMIT] = 2.0
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
    spring_law(k[SPRING_LAW], s, k[THETAS], k[TORQUES], p, k[LAW], s[POSITION], 1)


def friction_of(s: Any, p: Any, v: float) -> float:
    """Largest friction of the joint in N m: tau_c + c |tau| + tau_x exp(-(v / v_x)^2), with Coulomb friction tau_c, load
    coefficient c, actuator torque on the link tau, Stribeck excess tau_x and Stribeck velocity v_x. Friction dissipates energy
    at any level."""
    bound: float = p[P_COULOMB] + p[P_SHARE] * abs(s[APPLIED] - s[BRAKE] * v)
    if p[P_STRIBECK] > 0.0:
        ratio = v * p[P_FADE]
        bound += p[P_STRIBECK] * exp(-ratio * ratio)
    return bound


# -- energy balance and limits ------------------------------------------------------------------------------------------


def update_ledger(s: Any, p: Any, k: Any, z: Any, first: bool, jumped: bool, recorded: bool) -> None:
    """Add the energy flows since the last substep to the energies of the joint, count the limits that act in this substep, and
    store values for the next substep.

    first: whether this is the first substep of the run. jumped: whether an input jumps in this kick, so that
    the means over the half kicks differ from the present values. recorded: whether the row is recorded, so that the energies
    of the present state are needed.
    """
    before, following = (APPLIED_BEFORE, APPLIED_NEXT) if jumped else (APPLIED, APPLIED)
    half = 0.0 if first else 0.5 * (s[POSITION] - s[LAST_POSITION])
    link = (s[APPLIED_LAST] + s[before]) * half
    damped = -(s[APPLIED_LAST + 2] + s[before + 2]) * half
    push = (s[APPLIED_LAST + 3] + s[before + 3]) * half
    work = link
    if k[KIND] == SPRUNG:
        work = _update_springs(s, p, k, z[STEP], first, jumped, recorded, before)
        s[LIMIT_LOSS] += (s[APPLIED_LAST + 1] + s[before + 1]) * half - link
    s[LINK_WORK] += link
    s[DAMPING_LOSS] += damped
    s[NET_LINK_WORK] += link + push - damped
    s[MOTOR_WORK] += work
    s[TURNOVER] += abs(link) + abs(push) + abs(work)
    if k[KIND] == SPRUNG and (recorded or first):
        _balance(s, first)
    s[LAST_POSITION] = s[POSITION]
    s[JUMPED] = 1.0 if jumped else 0.0
    for c in range(PUSHES):
        s[APPLIED_LAST + c] = s[following + c]
    if abs(s[TORQUE]) > p[P_EFFORT]:
        s[EFFORT_COUNT] += 1.0
    if abs(s[VELOCITY]) > p[P_FASTEST]:
        s[VELOCITY_COUNT] += 1.0
    if s[POSITION] <= p[P_LOWEST] or s[POSITION] >= p[P_HIGHEST]:
        s[STOP_COUNT] += 1.0


def _update_springs(s: Any, p: Any, k: Any, step: float, first: bool, jumped: bool, recorded: bool, before: int) -> float:
    """Update energies and counts of the springs and motors, and return the work in J of the motors since the last substep.

    step: length of a substep in s. first, jumped, recorded: as in `update_ledger`. before: column of the torques on the
    link, or of their means over the half kick before the substep if an input jumps.
    """
    kinematic, energy_before, hysteretic = k[DYNAMIC] < k[PLACED], s[SPRING_ENERGY], 0.0
    if recorded or first or kinematic:
        s[SPRING_ENERGY] = s[LAW_ENERGY] + _hysteresis_energy(s, p, k)
        s[STIFFEST] = max(s[STIFFEST], abs(s[STIFFNESS]))
    if p[P_LEVEL] > 0.0 and not first:
        hysteretic = _hysteresis_loss(s, p, k)
        s[HYSTERESIS_LOSS] += hysteretic
    work = _update_motors(s, p, k, step, first)
    if kinematic:
        absorbed = s[SPRING_ENERGY] - energy_before + hysteretic
        work += 0.0 if first else _kinematic(s, p, k, before, absorbed, jumped or s[JUMPED] != 0.0)
        for i in range(k[MOTORS]):
            m = FIRST_MOTOR + i * PER_MOTOR
            s[m + LAST_KICK_POSITION] = s[m + KICK_POSITION]
    return work


def _update_motors(s: Any, p: Any, k: Any, step: float, first: bool) -> float:
    """Update energies and counts of the motors, and return their work in J since the last substep."""
    work = lost = kinetic = 0.0
    saturated = bent = False
    for i in range(k[MOTORS]):
        m, d = FIRST_MOTOR + i * PER_MOTOR, FIRST_DRIVE + i * PER_DRIVE
        theta, speed = s[m + KICK_POSITION], s[m + MEAN_VELOCITY]
        if i < k[SPRINGS] and abs(theta - s[POSITION]) > p[P_MAX_DEFLECTION]:
            bent = True
        if i >= k[DYNAMIC]:
            continue
        energy = 0.5 * p[d + D_INERTIA] * speed * speed
        kinetic += energy
        if not first:
            work += s[m + ROW_WORK]
            # A limit dissipates the rest of the balance: the energy of the impact, and the work of the torque at the limit.
            limited = s[m + ROW_WORK] - s[m + ROW_WORK + 2] - (energy - s[m + KINETIC])
            lost += limited if s[m + AT_LIMIT] > 0.0 else s[m + ROW_WORK + 1]
        s[m + KINETIC] = energy
        if s[m + AT_LIMIT] > 0.0:
            s[m + AT_LIMIT] -= 1.0
        if p[d + D_RESISTANCE] != 0.0:
            heat = p[d + D_RESISTANCE] * s[m + CURRENT] * s[m + CURRENT]
            s[WINDING_LOSS] += 0.0 if first else 0.5 * step * (heat + s[m + LAST_POWER])
            s[m + LAST_POWER] = heat
        if abs(s[m + DRIVE_TORQUE]) >= p[d + D_MAX_TORQUE]:
            saturated = True
        if theta <= p[d + D_LOW] + AT_STOP or theta >= p[d + D_HIGH] - AT_STOP:
            s[MOTOR_STOP_COUNT] += 1.0
        if abs(speed) >= FULL * p[d + D_MOST]:
            s[MOTOR_SPEED_COUNT] += 1.0
    s[MOTOR_ENERGY] = kinetic
    s[FRICTION_LOSS] += lost
    if saturated:
        s[SATURATION_COUNT] += 1.0
    if bent:
        s[DEFLECTION_COUNT] += 1.0
    return work


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
    spring_law(k[SPRING_LAW], s, k[THETAS], k[TORQUES], p, k[LAW], q, 1)
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
    """Energy in J lost in the springs' hysteresis since the last substep, for springs with hysteresis. The result is exact for
    motion in one direction, so it is never negative."""
    total = 0.0
    for i in range(k[SPRINGS]):
        m = FIRST_MOTOR + i * PER_MOTOR
        moved = s[m + DEFLECTION] - s[m + LAST_DEFLECTION]
        now, last = s[m + HYSTERESIS], s[m + LAST_HYSTERESIS]
        stored = 0.5 * p[P_LENGTH] * (now * now - last * last) / p[P_LEVEL]
        signed = now - last if moved > 0.0 else last - now
        total += p[P_LEVEL] * abs(moved) - p[P_LENGTH] * signed - stored
    return total


def _balance(s: Any, first: bool) -> None:
    """Compute the residual of the energy balance since the start."""
    stored = s[SPRING_ENERGY] + s[MOTOR_ENERGY]
    if first:
        s[START_ENERGY] = stored
    s[RESIDUAL] = (
        s[MOTOR_WORK] - s[FRICTION_LOSS] - s[LINK_WORK] - s[LIMIT_LOSS] - s[HYSTERESIS_LOSS] - (stored - s[START_ENERGY])
    )
    s[EXCESS] = max(s[EXCESS], abs(s[RESIDUAL]) - SHARE * s[TURNOVER])
