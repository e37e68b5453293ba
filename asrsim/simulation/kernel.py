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

from asrsim.actuators.motor import MotorConstants, motor_kick, velocity_bounds
from asrsim.simulation.fields import JointConstants, JointKind, JointState, MotorState, Pushes, Scheme, Works
from asrsim.simulation.laws import (
    drive_of,
    engine_step,
    joint_of,
    joint_step,
    kind_of,
    link_of,
    memory_of,
    motor_of,
    row,
    scheme_of,
    spring_law,
    value_of,
)
from asrsim.simulation.layout import (
    CONTROLLED,
    DIRECT,
    E_DAMPING,
    E_FRICTION,
    E_MIDDLE,
    E_POSITION,
    E_TORQUE,
    E_VELOCITY,
    EXTERNAL,
    GOALS,
    HEALTHY,
    LOSE,
    NO_VALUE,
    RAN_AWAY,
    REMEMBER,
    SPRUNG,
    STORE,
    WHOLE,
)
from asrsim.simulation.staged import begin_stages, end_stages, lead_stages, note_kick

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
    kinds: Any, stepping: Any, engine_states: Any, inputs: Any, references: Any, wrenches: Any, lengths: Any, cuts: Any,
    exchange: Any, engine: int, record: int, columns: Any, goals: Any, out: Any, last_rows: Any, measured: Any, gains: Any,
    coordinates: Any,
) -> None:  # fmt: skip
    """Advance worlds by `count` substeps.

    which: a row (m, 4) for each world to advance: index of the world, of its inputs and references, of its part of `out`, and
    of its wrenches, lengths and cuts; first: first row of the inputs; every: number of substeps between recorded rows;
    watched: 1 to compute energies, limits and spring stiffness, otherwise 0; done: number (worlds,) of completed substeps;
    fault: health and faulty joint (worlds, 2); states, constants: S and P (worlds, joints, ...) of `asrsim.simulation.fields`;
    kinds: K (joints, ...); stepping: a `Scheme`; engine_states: state of the engine (worlds, ...); inputs, references,
    wrenches, lengths, cuts: see `asrsim.simulation.inputs.Given`; exchange: data (pieces, joints, 6) shared with the engine;
    engine: address of the engine's step function, which receives `record`; columns, goals: recorded columns of S and of the
    references; out: recorded values (m, rows, joints, columns of S and of the references); last_rows: last recorded row of each
    world (worlds, joints, ...); measured, gains, coordinates: see `observe`, empty without an observer.
    """
    scheme = scheme_of(stepping)
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
                observe(s_all, kinds, scheme, x, measured[place], substep // every, gains, coordinates)
            jumped = cut < len(own_cuts) and own_cuts[cut][0] == step
            begin, end, on_time = step, step + 1, step
            if jumped:
                begin, end, on_time = own_cuts[cut][1], own_cuts[cut][2], own_cuts[cut][3]
                cut += 1
            # Time at which the kick begins, in substeps after the time of the substep.
            first_moment = -0.5 * scheme.staggered if substep > 0 else 0.0
            for j in range(len(kinds)):
                joint, link, kind = joint_of(s_all, j), link_of(p_all, j), kind_of(kinds, j)
                v = scheme.weight_now * joint.engine_velocity + scheme.weight_last * joint.last_engine_velocity
                if kind.controllers:
                    remember_positions(joint, link, kind, scheme)
                if kind.stages:
                    begin_stages(joint, v, jumped, substep == 0)
                if jumped:
                    _clear_means(joint)
                total = torque = applied = push = drag = stiffness = energy = 0.0
                since, until = first_moment, -first_moment
                # A split kick is evaluated once more at the time of the substep, with h = 0: values are recorded, and nothing
                # moves.
                for turn in range(begin, end + 1 if jumped else end):
                    at, h, noted, on_row = turn, scheme.step, True, jumped and turn == on_time
                    whole = (watched and asked) or link.damping_ratio != 0.0 or kind.dynamic < kind.placed
                    if on_row:
                        at, h, since, until = step, 0.0, 0.0, 0.0
                    elif jumped:
                        at = turn - 1 if turn > on_time else turn
                        h, noted, whole = float(own_lengths[at]) * scheme.step, False, link.damping_ratio != 0.0
                        until = since + float(own_lengths[at])
                    u = row(u_all[at], j)
                    if kind.controllers:
                        read_sensors(joint, link, kind, scheme, u, since, until)
                    since = until
                    advance(joint, link, kind, scheme, u, h, noted, whole)
                    joint.brake = limit(joint, link, v)
                    joint.now.push = push_of(joint, link, u[EXTERNAL])
                    joint.drag = damping_of(joint, link)
                    load = joint.now.applied + joint.now.push
                    total += load
                    if on_row:
                        joint.free = 1.0 if joint.brake != 0.0 else 0.0
                        torque, applied, push, drag = joint.now.torque, joint.now.applied, joint.now.push, joint.drag
                        stiffness, energy = joint.stiffness, joint.law_energy
                        continue
                    exchange[at - begin, j, E_TORQUE] = load
                    exchange[at - begin, j, E_DAMPING] = joint.drag + joint.brake
                    exchange[at - begin, j, E_FRICTION] = friction_of(joint, link, v)
                    if jumped:
                        _add_piece(joint, link, 2.0 * float(own_lengths[at]), turn > on_time)
                if jumped:
                    joint.now.torque, joint.now.applied, joint.now.push, joint.drag = torque, applied, push, drag
                    joint.stiffness, joint.law_energy, joint.brake = stiffness, energy, link.brake
                exchange[end - begin - 1, j, E_MIDDLE] = nan
                if not abs(total) < ENDLESS:
                    fault[w, 0], fault[w, 1] = NO_VALUE, j
                    break
            if fault[w, 0] != HEALTHY:
                break
            engine_step(engine, record, x, exchange, pushes[begin:end], own_lengths[begin:end], end - begin)
            for j in range(len(kinds)):
                joint, link, kind = joint_of(s_all, j), link_of(p_all, j), kind_of(kinds, j)
                velocity = exchange[end - begin - 1, j, E_VELOCITY]
                now = exchange[end - begin - 1, j, E_MIDDLE]
                if substep == 0 or scheme.staggered == 0.0:
                    now = joint.engine_velocity
                elif not isfinite(now):
                    now = 0.5 * (joint.engine_velocity + velocity)
                read_engine(joint, link, scheme, velocity, now, jumped)
                if kind.stages:
                    remember_stages(joint, link, kind, scheme)
                if watched:
                    update_ledger(joint, link, kind, scheme, substep == 0, jumped, asked)
                if asked:
                    for c in range(len(columns)):
                        out[place, kept, j, c] = value_of(joint, columns[c])
                    for c in range(len(goals)):
                        out[place, kept, j, len(columns) + c] = r_all[step][j][goals[c]]
                # The first kick of a staggered run is half a kick: the velocity before the kick is extrapolated to the velocity
                # before a full kick.
                joint.last_engine_velocity = (
                    2.0 * joint.engine_velocity - velocity
                    if substep == 0 and scheme.staggered != 0.0
                    else joint.engine_velocity
                )
                joint.engine_velocity, joint.position = velocity, exchange[end - begin - 1, j, E_POSITION]
                if not abs(velocity) <= FASTEST:
                    fault[w, 0], fault[w, 1] = RAN_AWAY, j
            if asked:
                kept += 1
            done[w] = substep + 1
        for j in range(len(kinds) if kept else 0):
            for c in range(len(columns) + len(goals)):
                last_rows[w, j, c] = out[place, kept - 1, j, c]


def observe(
    s_all: Any, kinds: Any, scheme: Scheme, x: Any, measured: Any, step: int, gains: Any, coordinates: Any
) -> None:  # fmt: skip
    """Move positions and velocities towards measured positions, and replace these by the errors before the correction.

    measured: positions (steps, joints, 1 + motors) of links and motors at whole steps; NaN: not measured. gains: change of the
    position and of the velocity (1/s) per error. coordinates: indices (3, joints) of position, velocity and previous velocity
    of each link in the engine's state x.
    """
    for j in range(len(kinds)):
        joint = joint_of(s_all, j)
        for c in range(measured.shape[2]):
            motor = motor_of(joint, max(c - 1, 0))
            place = joint.position if c == 0 else motor.position + scheme.first_drift * scheme.step * motor.velocity
            error = measured[step, j, c] - place
            measured[step, j, c] = error
            if not abs(error) < ENDLESS:
                continue
            near, fast = gains[0] * error, gains[1] * error
            if c > 0:
                motor.position += near
                motor.velocity += fast
                motor.anchor += near
                continue
            joint.position += near
            joint.engine_velocity += fast
            joint.last_engine_velocity += fast
            x[coordinates[0, j]] += near
            x[coordinates[1, j]] += fast
            x[coordinates[2, j]] += fast


def _clear(pushes: Pushes) -> None:
    pushes.applied = pushes.torque = pushes.damping = pushes.push = 0.0


def _clear_means(joint: JointState) -> None:
    """Set the mean torques over the half kicks before and after the time of the substep to 0."""
    _clear(joint.before)
    _clear(joint.following)
    joint.free_before = joint.free_after = 0.0


def _add_piece(joint: JointState, link: JointConstants, share: float, late: bool) -> None:
    """Add the torques in a piece of a kick to the means over half kicks. share: length of the piece as a fraction of a half
    kick; late: whether the piece follows the time of the substep."""
    side = joint.following if late else joint.before
    side.applied += share * joint.now.applied
    side.torque += share * joint.now.torque
    side.push += share * joint.now.push
    if joint.brake == link.brake:
        if late:
            joint.free_after += share
        else:
            joint.free_before += share


def read_engine(joint: JointState, link: JointConstants, scheme: Scheme, velocity: float, now: float, jumped: bool) -> None:
    """Compute damping torque, applied torque and link velocity at the time of the substep. Damping and derivative action act on
    the mean velocity over the kick; if an input jumps, the values at the time of the substep are different.

    velocity: of the link in the engine after the kick; now: of the link at the time of the substep.
    """
    mean = joint.engine_velocity + scheme.link_implicitness * (velocity - joint.engine_velocity)
    brake = -joint.brake * mean
    joint.now.damping = -joint.drag * mean
    joint.velocity = now
    if jumped:
        joint.before.applied += brake * joint.free_before
        joint.following.applied += brake * joint.free_after
        joint.before.damping = joint.following.damping = joint.now.damping
        joint.now.damping = -joint.drag * now
        applied = joint.now.applied - joint.free * link.brake * now
        joint.now.applied = min(max(applied, -link.effort), link.effort)
    else:
        joint.now.applied += brake


# -- substep of a joint -------------------------------------------------------------------------------------------------


def remember_positions(joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme) -> None:
    """Store the present positions and velocities in the memory of the sensors.

    A ring buffer stores positions at the times of the substeps, and velocities at the times to which they belong. The buffer is
    followed by the index of its newest entry and by the last sample.
    """
    memory, size = memory_of(joint, kind), _ring_size(link)
    for i in range(kind.controllers):
        motor, ring = motor_of(joint, i), i * kind.ring
        newest = (int(memory[ring + 2 * size]) + 1) % size
        memory[ring + 2 * size] = float(newest)
        if kind.on_link:
            memory[ring + 2 * newest], memory[ring + 2 * newest + 1] = joint.position, joint.engine_velocity
        else:
            # The position of a motor is known at the beginning of the substep.
            ahead = scheme.first_drift * scheme.step * motor.velocity
            memory[ring + 2 * newest], memory[ring + 2 * newest + 1] = motor.position + ahead, motor.velocity


def _ring_size(link: JointConstants) -> int:
    """Number of entries of a sensor's ring buffer; see `asrsim.simulation.effects.Sensor.memory`."""
    return int(link.delay + 0.5) + 3


def read_sensors(
    joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme, u: Any, since: float, until: float
) -> None:
    """Compute the errors of the measured positions and velocities in a piece of a kick. Measurements are late; positions are
    also noisy and quantised.

    since, until: times at which the piece begins and ends, in substeps after the time of the substep. Sensors with ticks take
    samples at the beginning of a piece and hold them. Measurements of other sensors are those in the middle of the piece; the
    mean over the piece if they are quantised.
    """
    middle, size, delay, memory = 0.5 * (since + until), _ring_size(link), link.delay, memory_of(joint, kind)
    for i in range(kind.controllers):
        motor, ring, samples = motor_of(joint, i), i * kind.ring, GOALS + kind.positions + 2 * i
        sample, noise = ring + 2 * size + 1, u[samples + 1]
        lag = 0.5 * scheme.staggered if kind.on_link else scheme.first_drift
        gain = link.derivative if kind.on_link else drive_of(link, i).derivative
        if link.sampled != 0.0:
            if u[samples] != 0.0:
                place = _position_at(memory, scheme, ring, size, since - delay) + noise
                memory[sample] = _quantised(place, place, link.quantum)
                memory[sample + 1] = _velocity_at(memory, ring, size, lag, since - delay)
            place, speed = memory[sample], memory[sample + 1]
        else:
            place = _position_at(memory, scheme, ring, size, middle - delay) + noise
            speed = _velocity_at(memory, ring, size, lag, middle - delay)
            if link.quantum > 0.0:
                before = _position_at(memory, scheme, ring, size, since - delay) + noise
                place = _quantised(before, _position_at(memory, scheme, ring, size, until - delay) + noise, link.quantum)
        motor.read_error = place - (joint.position if kind.on_link else _position_at(memory, scheme, ring, size, middle))
        motor.read_push = -gain * (speed - _velocity_at(memory, ring, size, lag, middle))


def _position_at(memory: Any, scheme: Scheme, ring: int, size: int, time: float) -> float:
    """Position in rad at a time in substeps after the present one, on straight lines between the stored positions."""
    newest = int(memory[ring + 2 * size])
    if time >= 0.0:
        return float(memory[ring + 2 * newest] + time * scheme.step * memory[ring + 2 * newest + 1])
    back = int(-time)
    later, earlier = ring + 2 * ((newest + size - back) % size), ring + 2 * ((newest + size - back - 1) % size)
    return float(memory[later] + (-time - back) * (memory[earlier] - memory[later]))


def _velocity_at(memory: Any, ring: int, size: int, lag: float, time: float) -> float:
    """Velocity in rad/s at a time in substeps after the present one, on straight lines through the stored velocities, which
    belong to times `lag` substeps before those of the positions."""
    newest = int(memory[ring + 2 * size])
    back = int(max(-time - lag, 0.0))
    later, earlier = ring + 2 * ((newest + size - back) % size), ring + 2 * ((newest + size - back - 1) % size)
    return float(memory[later + 1] + (-time - lag - back) * (memory[earlier + 1] - memory[later + 1]))


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


def advance(
    joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme, u: Any, h: float, noted: bool, whole: bool
) -> None:
    """Advance motors and controllers by h s under the inputs u, with the link at its present position, and set the torque
    on the link (`now.torque`).

    noted: whether the recorded values of the motors are stored; with motor substeps, these are the values of the middle motor
    substep. With h = 0 nothing moves. whole: whether stiffness and energy of the springs are computed too.
    """
    if kind.joint_step:
        joint_step(kind.joint_step, joint, link, kind, u, h, int(noted))
        if whole and kind.kind == SPRUNG:
            find_state(joint, link, kind)
    elif kind.kind == SPRUNG:
        _advance_springs(joint, link, kind, scheme, u, h, noted, whole)
    elif kind.kind == CONTROLLED:
        # A PID controller on the rigid link (paper eq. 11); its derivative action acts as damping: see `limit`.
        error = u[GOALS] - motor_of(joint, 0).read_error - joint.position
        more = link.integral * h * error
        joint.now.torque = link.proportional * error + joint.integral + motor_of(joint, 0).read_push + 0.5 * more
        joint.integral += more
    elif kind.kind == DIRECT:
        joint.now.torque = u[GOALS]
    else:
        joint.now.torque = 0.0


def _advance_springs(
    joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme, u: Any, h: float, noted: bool, whole: bool
) -> None:
    """Advance motors and springs by drift, kick, drift; second order if half of the drift precedes the kick.

    During motor substeps the link does not move. The mean spring torque of the motor substeps acts on the link, which keeps the
    torque bounded.
    """
    motors, dynamic = kind.positions, kind.dynamic
    turns, step = 1, h
    if link.substeps > 1.0:
        turns = ceil(link.substeps * h / scheme.step)
        # The number of motor substeps is odd, also in a piece of a kick, so that there is a middle substep.
        turns += 1 - turns % 2
        step = h / turns
    before = scheme.first_drift * step
    q, total = joint.position, 0.0
    for turn in range(turns):
        for i in range(motors):
            motor = motor_of(joint, i)
            if i < dynamic:
                drive = drive_of(link, i)
                motor.theta = _between(motor.position + before * motor.velocity, drive.low, drive.high)
            else:
                motor.theta = u[GOALS + i]
        now = noted and turn == turns // 2
        if kind.stages:
            lead_stages(joint, kind, scheme, step)
        spring_law(kind.spring_law, joint, link, kind, q, int(whole and turn == turns // 2))
        for i in range(motors):
            total += motor_of(joint, i).pull
        for i in range(dynamic):
            motor, drive = motor_of(joint, i), drive_of(link, i)
            most = motor.limit if kind.stages else drive.limit
            _kick(motor, drive, scheme, u[GOALS + i], most, step, before, now)
        if kind.stages:
            note_kick(joint, kind, step, now)
        if now:
            for i in range(motors):
                motor = motor_of(joint, i)
                motor.load, motor.kick_position = motor.pull, motor.theta
    joint.now.torque = total / turns


def _between(value: float, low: float, high: float) -> float:
    return high if value > high else low if value < low else value


def _kick(
    motor: MotorState, drive: MotorConstants, scheme: Scheme, goal: float, most: float, step: float, before: float, noted: bool
) -> None:
    """Compute the kick of a motor and the drift that follows, and add the works of the torques on the motor. most: largest
    torque of the motor, N m.

    The torques act for half a step with the velocity before the kick, and for half a step with the velocity after the kick.
    """
    x, speed, load, pushed = motor.theta, motor.velocity, motor.pull, motor.read_push
    slowest, fastest = velocity_bounds(x, drive.low, drive.high, drive.most, step)
    velocity, mean, anchor, integral, torque, friction = motor_kick(
        x, speed, motor.anchor, motor.integral + pushed, goal - motor.read_error,
        load, slowest, fastest, most, step, scheme.implicitness, drive,
    )  # fmt: skip
    motor.position = _between(x + (step - before) * velocity, drive.low, drive.high)
    motor.velocity, motor.last_velocity, motor.anchor, motor.integral = velocity, speed, anchor, integral - pushed
    if step > 0.0 and (velocity >= fastest or velocity <= slowest):
        motor.at_limit = 2.0
    resistance = friction + drive.damping * (speed + scheme.implicitness * (velocity - speed))
    _add_works(motor.work, 0.5 * step * speed, torque, resistance, load)
    if noted:
        motor.row_work.drive, motor.work.drive = motor.work.drive, 0.0
        motor.row_work.loss, motor.work.loss = motor.work.loss, 0.0
        motor.row_work.spring, motor.work.spring = motor.work.spring, 0.0
        constant = drive.torque_constant
        motor.torque, motor.friction, motor.mean_velocity = torque, friction, mean
        if constant > 0.0:
            motor.current = torque / constant
            motor.voltage = drive.resistance * motor.current + constant * mean
    _add_works(motor.work, 0.5 * step * velocity, torque, resistance, load)


def _add_works(work: Works, way: float, torque: float, resistance: float, load: float) -> None:
    """Add the works of the torques (N m) on a motor that moves by `way` rad."""
    work.drive += torque * way
    work.loss += resistance * way
    work.spring += load * way


def remember_stages(joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme) -> None:
    """Advance the memories of the stages to the recorded kick, once per substep."""
    end_stages(joint, kind, scheme)
    spring_law(kind.spring_law, joint, link, kind, joint.position, REMEMBER)


def limit(joint: JointState, link: JointConstants, v: float) -> float:
    """Derivative gain of the link's controller that acts at the velocity v; also stores the limited torque in
    `now.applied`.

    The effort limit applies to the sum of torque and derivative action (mode 1). Within the limit the derivative action acts
    as damping; beyond the limit the derivative action is 0, and the torque equals the limit.
    """
    torque = joint.now.torque
    if link.cutoff != 0.0 and abs(joint.engine_velocity) >= link.fastest and torque * joint.engine_velocity > 0.0:
        torque = 0.0
    braked = torque - link.brake * v
    if abs(braked) > link.effort:
        joint.now.applied = link.effort if braked > 0.0 else -link.effort
        return 0.0
    joint.now.applied = torque
    return link.brake


def push_of(joint: JointState, link: JointConstants, external: float) -> float:
    """Sum of the external torque and the torque of the passive spring on the link, in N m."""
    return external + link.spring * (link.rest - joint.position)


def damping_of(joint: JointState, link: JointConstants) -> float:
    """Viscous damping of the link in N m s/rad. A damping that varies with the stiffness k is c + 2 D sqrt(I k), with constant
    part c, damping ratio D and inertia I (paper section 4.2.2)."""
    if link.damping_ratio == 0.0:
        return link.damping
    return link.damping + 2.0 * link.damping_ratio * sqrt(max(link.damping_inertia * joint.stiffness, 0.0))


def find_state(joint: JointState, link: JointConstants, kind: JointKind) -> None:
    """Compute stiffness and energy of the springs at the recorded kick."""
    for i in range(kind.positions):
        motor_of(joint, i).theta = motor_of(joint, i).kick_position
    spring_law(kind.spring_law, joint, link, kind, joint.position, WHOLE)


def friction_of(joint: JointState, link: JointConstants, v: float) -> float:
    """Largest friction of the joint in N m: tau_c + c |tau| + tau_x exp(-(v / v_x)^2), with Coulomb friction tau_c, load
    coefficient c, actuator torque on the link tau, Stribeck excess tau_x and Stribeck velocity v_x. Friction dissipates energy
    at any level."""
    bound: float = link.coulomb + link.share * abs(joint.now.applied - joint.brake * v)
    if link.stribeck > 0.0:
        ratio = v * link.fade
        bound += link.stribeck * exp(-ratio * ratio)
    return bound


# -- energy balance and limits ------------------------------------------------------------------------------------------


def update_ledger(
    joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme, first: bool, jumped: bool, recorded: bool
) -> None:
    """Add the energy flows since the last substep to the energies of the joint, count the limits that act in this substep, and
    store values for the next substep.

    first: whether this is the first substep of the run. jumped: whether an input jumps in this kick, so that
    the means over the half kicks differ from the present values. recorded: whether the row is recorded, so that the energies
    of the present state are needed.
    """
    before = joint.before if jumped else joint.now
    following = joint.following if jumped else joint.now
    half = 0.0 if first else 0.5 * (joint.position - joint.last_position)
    given = (joint.last.applied + before.applied) * half
    damped = -(joint.last.damping + before.damping) * half
    push = (joint.last.push + before.push) * half
    work = given
    if kind.kind == SPRUNG:
        work = _update_springs(joint, link, kind, scheme.step, first, jumped, recorded, before)
        joint.limit_loss += (joint.last.torque + before.torque) * half - given
    joint.link_work += given
    joint.damping_loss += damped
    joint.net_link_work += given + push - damped
    joint.motor_work += work
    joint.turnover += abs(given) + abs(push) + abs(work)
    if kind.kind == SPRUNG and (recorded or first):
        _balance(joint, first)
    joint.last_position = joint.position
    joint.jumped = 1.0 if jumped else 0.0
    joint.last.applied, joint.last.torque = following.applied, following.torque
    joint.last.damping, joint.last.push = following.damping, following.push
    if abs(joint.now.torque) > link.effort:
        joint.effort_count += 1.0
    if abs(joint.velocity) > link.fastest:
        joint.velocity_count += 1.0
    if joint.position <= link.lowest or joint.position >= link.highest:
        joint.stop_count += 1.0


def _update_springs(
    joint: JointState,
    link: JointConstants,
    kind: JointKind,
    step: float,
    first: bool,
    jumped: bool,
    recorded: bool,
    before: Pushes,
) -> float:
    """Update energies and counts of the springs and motors, and return the work in J of the motors since the last substep.

    step: length of a substep in s. first, jumped, recorded: as in `update_ledger`. before: the torques on the
    link, or their means over the half kick before the substep if an input jumps.
    """
    kinematic, energy_before, lost = kind.dynamic < kind.placed, joint.spring_energy, 0.0
    if recorded or first or kinematic:
        if kind.stages:
            spring_law(kind.spring_law, joint, link, kind, joint.position, STORE)
        joint.spring_energy = joint.law_energy + joint.stage_energy
        joint.stiffest = max(joint.stiffest, abs(joint.stiffness))
    if kind.stages and not first:
        spring_law(kind.spring_law, joint, link, kind, joint.position, LOSE)
        lost = joint.stage_lost
        joint.stage_loss += lost
    work = _update_motors(joint, link, kind, step, first)
    if kinematic:
        absorbed = joint.spring_energy - energy_before + lost
        work += 0.0 if first else _kinematic(joint, link, kind, before, absorbed, jumped or joint.jumped != 0.0)
        for i in range(kind.positions):
            motor = motor_of(joint, i)
            motor.last_kick_position, motor.last_kick_parallel = motor.kick_position, motor.kick_parallel
    return work


def _update_motors(joint: JointState, link: JointConstants, kind: JointKind, step: float, first: bool) -> float:
    """Update energies and counts of the motors, and return their work in J since the last substep."""
    work = lost = kinetic = 0.0
    saturated = bent = False
    for i in range(kind.positions):
        motor, drive = motor_of(joint, i), drive_of(link, i)
        theta, speed = motor.kick_position, motor.mean_velocity
        if i < kind.springs and abs(theta - joint.position) > link.max_deflection:
            bent = True
        if i >= kind.dynamic:
            continue
        energy = 0.5 * drive.inertia * speed * speed
        kinetic += energy
        if not first:
            work += motor.row_work.drive
            # A limit dissipates the rest of the balance: the energy of the impact, and the work of the torque at the limit.
            limited = motor.row_work.drive - motor.row_work.spring - (energy - motor.kinetic)
            lost += limited if motor.at_limit > 0.0 else motor.row_work.loss
        motor.kinetic = energy
        if motor.at_limit > 0.0:
            motor.at_limit -= 1.0
        if drive.resistance != 0.0:
            heat = drive.resistance * motor.current * motor.current
            joint.winding_loss += 0.0 if first else 0.5 * step * (heat + motor.last_power)
            motor.last_power = heat
        if abs(motor.torque) >= (motor.limit if kind.stages and motor.limit < drive.limit else drive.max_torque):
            saturated = True
        if theta <= drive.low + AT_STOP or theta >= drive.high - AT_STOP:
            joint.motor_stop_count += 1.0
        if abs(speed) >= FULL * drive.most:
            joint.motor_speed_count += 1.0
    joint.motor_energy = kinetic
    joint.friction_loss += lost
    if saturated:
        joint.saturation_count += 1.0
    if bent:
        joint.deflection_count += 1.0
    return work


def _kinematic(joint: JointState, link: JointConstants, kind: JointKind, before: Pushes, absorbed: float, jump: bool) -> float:
    """Work in J of motors and adjusters without dynamics: the change of the springs' energy by their motion, with all other
    positions at their means. If an input jumps, the work is the energy that the springs absorbed (J) plus their work on the
    link."""
    half = 0.5 * (joint.position - joint.last_position)
    if jump:
        work: float = absorbed + (joint.last.torque + before.torque) * half
        for i in range(kind.dynamic):
            work -= motor_of(joint, i).row_work.spring
        return work
    middle = 0.5 * (joint.position + joint.last_position)
    now = _energy_at(joint, link, kind, middle, False)
    work = now - _energy_at(joint, link, kind, middle, True)
    for i in range(kind.dynamic, kind.springs):
        motor = motor_of(joint, i)
        way = motor.kick_position - motor.last_kick_position
        work += 0.5 * (motor.kick_parallel + motor.last_kick_parallel) * way
    return work


def _energy_at(joint: JointState, link: JointConstants, kind: JointKind, q: float, last: bool) -> float:
    """Energy of the springs in J for a link at q rad. Motors with dynamics are at their mean positions, the others at their
    present positions, or at those of the last kick."""
    for i in range(kind.positions):
        motor = motor_of(joint, i)
        half_way = 0.5 * (motor.kick_position + motor.last_kick_position)
        own = motor.last_kick_position if last else motor.kick_position
        motor.theta = half_way if i < kind.dynamic else own
    stiffness, energy = joint.stiffness, joint.law_energy
    spring_law(kind.spring_law, joint, link, kind, q, WHOLE)
    energy_there = joint.law_energy
    joint.stiffness, joint.law_energy = stiffness, energy
    return energy_there


def _balance(joint: JointState, first: bool) -> None:
    """Compute the residual of the energy balance since the start."""
    stored = joint.spring_energy + joint.motor_energy
    if first:
        joint.start_energy = stored
    joint.residual = (
        joint.motor_work
        - joint.friction_loss
        - joint.link_work
        - joint.limit_loss
        - joint.stage_loss
        - (stored - joint.start_energy)
    )
    joint.excess = max(joint.excess, abs(joint.residual) - SHARE * joint.turnover)
