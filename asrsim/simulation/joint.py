"""The substep of a joint. Sensors are read, motors move, springs load the link, and the link's motion is read from the engine.

If an input jumps, the kick is split into pieces with separate inputs, which act on the link one after the other.
"""

from __future__ import annotations

import math
from typing import Any

from asrsim.actuators.motor import MotorConstants, motor_kick, velocity_bounds
from asrsim.simulation.fields import JointConstants, JointKind, JointState, MotorState, Pushes, Scheme
from asrsim.simulation.laws import drive_of, inputs_of, joint_step, motor_of, put_load, spring_law
from asrsim.simulation.layout import EXTERNAL, GOALS, TASK
from asrsim.simulation.sensing import read_sensors, remember_positions
from asrsim.simulation.staged import begin_stages, end_stages, lead_stages, note_kick

FULL = 1.0 - 1e-9
"""Fraction of its largest voltage or speed above which a motor counts as being at this limit."""


def load_joint(
    joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme, inputs: Any, lengths: Any, exchange: Any, j: int,
    step: int, begin: int, end: int, on_time: int, first: bool, recorded: bool,
) -> float:  # fmt: skip
    """Advance motors and springs of joint j by a kick, with the link at its present position, and put the loads of the joint
    into the exchange. Returns the sum of the torques on the link in N m, which is finite in a healthy world.

    inputs, lengths: tables of `asrsim.simulation.inputs.Given`; step: row of the substep in the two tables; begin, end: rows of
    the first piece of the kick and after the last piece; on_time: row of the piece that begins at the time of the substep, or
    -1 if the kick is not split; first: whether the run begins; recorded: whether stiffness and energy of the springs are
    needed.
    """
    v = scheme.weight_now * joint.engine_velocity + scheme.weight_last * joint.last_engine_velocity
    jumped = on_time >= 0
    if kind.controllers:
        remember_positions(joint, link, kind, scheme)
    if kind.stages:
        begin_stages(joint, v, jumped, first)
    if jumped:
        _clear_means(joint)
    total = torque = applied = push = drag = stiffness = energy = 0.0
    # Begin and end of a piece, in substeps after the time of the substep.
    since = 0.0 if first else -0.5 * scheme.staggered
    until = -since
    # Evaluate a split kick once more at the time of the substep, with h = 0. Then values are recorded, but nothing moves.
    for turn in range(begin, end + 1 if jumped else end):
        at, h, noted, on_row = turn, scheme.step, True, jumped and turn == on_time
        whole = recorded or link.damping_ratio != 0.0 or kind.dynamic < kind.placed
        if on_row:
            at, h, since, until = step, 0.0, 0.0, 0.0
        elif jumped:
            at = turn - 1 if turn > on_time else turn
            h, noted, whole = float(lengths[at]) * scheme.step, False, link.damping_ratio != 0.0
            until = since + float(lengths[at])
        u = inputs_of(inputs, at, j)
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
        put_load(exchange, at - begin, j, load, joint.drag + joint.brake, friction_of(joint, link, v))
        if jumped:
            _add_piece(joint, link, 2.0 * float(lengths[at]), turn > on_time)
    if jumped:
        joint.now.torque, joint.now.applied, joint.now.push, joint.drag = torque, applied, push, drag
        joint.stiffness, joint.law_energy, joint.brake = stiffness, energy, link.brake
    return total


def settle(
    joint: JointState,
    link: JointConstants,
    kind: JointKind,
    scheme: Scheme,
    velocity: float,
    at_time: float,
    first: bool,
    jumped: bool,
) -> None:
    """Compute the values at the time of the substep, after the engine has moved the link. velocity: velocity of the link after
    the kick, rad/s; at_time: velocity of the link at the time of the substep, rad/s, or NaN if the engine has not computed this
    velocity; first: whether the run begins; jumped: whether an input jumps in the kick.
    """
    now = 0.5 * (joint.engine_velocity + velocity)
    if first or scheme.staggered == 0.0:
        now = joint.engine_velocity
    elif math.isfinite(at_time):
        now = at_time
    read_engine(joint, link, scheme, velocity, now, jumped)
    if kind.stages:
        end_stages(joint, kind, scheme, first)
        spring_law(kind.spring_law, joint, link, kind, joint.position, TASK.remember)


def move_on(joint: JointState, scheme: Scheme, position: float, velocity: float, first: bool) -> None:
    """Store the position (rad) and velocity (rad/s) of the link for the next substep. first: whether the run begins."""
    # The first kick of a staggered run is half a kick. Extrapolate the velocity before it to the velocity before a full kick.
    last = joint.engine_velocity
    if first and scheme.staggered != 0.0:
        last = 2.0 * joint.engine_velocity - velocity
    joint.last_engine_velocity, joint.engine_velocity, joint.position = last, velocity, position


def _clear(pushes: Pushes) -> None:
    pushes.applied = pushes.torque = pushes.damping = pushes.push = 0.0


def _clear_means(joint: JointState) -> None:
    """Set the mean torques over the half kicks before and after the time of the substep to 0."""
    _clear(joint.before)
    _clear(joint.following)
    joint.free_before = joint.free_after = 0.0


def _add_piece(joint: JointState, link: JointConstants, share: float, late: bool) -> None:
    """Add the torques in a piece of a kick to the means over half kicks. share: length of the piece as a fraction of a half
    kick; late: whether the piece follows the time of the substep.
    """
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
    the mean velocity over the kick. If an input jumps, their recorded values are computed from the velocity at the time of the
    substep.

    velocity: velocity of the link in the engine after the kick; now: velocity of the link at the time of the substep; jumped:
    whether an input jumps in the kick.
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


# -- motors and springs -------------------------------------------------------------------------------------------------


def advance(
    joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme, u: Any, h: float, noted: bool, whole: bool
) -> None:
    """Advance motors and controllers by h s under the inputs u, with the link at its present position, and set the torque
    on the link (`now.torque`).

    noted: whether the recorded values of the motors are stored. With motor substeps, the values of the middle motor substep are
    recorded. With h = 0 nothing moves. whole: whether the stiffness and the energy of the springs are also computed.
    """
    if kind.joint_step:
        joint_step(kind.joint_step, joint, link, kind, u, h, int(noted))
        if whole and kind.sprung:
            find_state(joint, link, kind)
    elif kind.sprung:
        _advance_springs(joint, link, kind, scheme, u, h, noted, whole)
    elif kind.controlled:
        # A PID controller acts on the rigid link (equation 11 of the paper). Its derivative action is treated as damping; see
        # `limit`.
        error = u[GOALS] - motor_of(joint, 0).read_error - joint.position
        more = link.integral * h * error
        joint.now.torque = link.proportional * error + joint.integral + motor_of(joint, 0).read_push + 0.5 * more
        joint.integral += more
    elif kind.direct:
        joint.now.torque = u[GOALS]
    else:
        joint.now.torque = 0.0


def _advance_springs(
    joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme, u: Any, h: float, noted: bool, whole: bool
) -> None:
    """Advance motors and springs by drift, kick, drift. The scheme is of second order if half of the drift precedes the kick.

    During motor substeps the link does not move. The mean spring torque of the motor substeps acts on the link. This keeps the
    torque bounded.
    """
    motors, dynamic, pulling = kind.positions, kind.dynamic, kind.pulling
    turns, step = 1, h
    if link.substeps > 1.0:
        turns = math.ceil(link.substeps * h / scheme.step)
        # Make the number of motor substeps odd, also in a piece of a kick, so that there is a middle substep.
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
            motor = motor_of(joint, i)
            if i < pulling:
                total += motor.pull
            if i < dynamic:
                drive = drive_of(link, i)
                most = motor.limit if kind.stages else drive.limit
                held = motor.pull + motor.ground if kind.stages else motor.pull
                _kick(motor, drive, scheme, u[GOALS + i], held, most, step, before, now)
            if now:
                motor.load, motor.kick_position = motor.pull, motor.theta
        if kind.stages:
            note_kick(joint, kind, step, now)
    joint.now.torque = total / turns


def _between(value: float, low: float, high: float) -> float:
    return high if value > high else low if value < low else value


def _kick(
    motor: MotorState, drive: MotorConstants, scheme: Scheme, goal: float, held: float, most: float, step: float, before: float,
    noted: bool,
) -> None:  # fmt: skip
    """Compute the kick of a motor and the drift that follows, and add the work of each torque on the motor. held: torque of
    spring and stages against the motor, N m; most: largest torque of the motor, N m.

    The torques act for half a step with the velocity before the kick, and for half a step with the velocity after the kick.
    """
    x, speed, pushed = motor.theta, motor.velocity, motor.read_push
    slowest, fastest = velocity_bounds(x, drive.low, drive.high, drive.most, step)
    velocity, mean, anchor, integral, torque, friction = motor_kick(
        x, speed, motor.anchor, motor.integral + pushed, goal - motor.read_error,
        held, motor.pull, slowest, fastest, most, step, scheme.implicitness, drive,
    )  # fmt: skip
    motor.position = _between(x + (step - before) * velocity, drive.low, drive.high)
    motor.velocity, motor.last_velocity, motor.anchor, motor.integral = velocity, speed, anchor, integral - pushed
    if step > 0.0 and (velocity >= fastest or velocity <= slowest):
        motor.at_limit = 2.0
    middle = speed + scheme.implicitness * (velocity - speed)
    resistance = friction + drive.damping * middle
    work, way = motor.work, 0.5 * step * speed
    driven, lost, sprung = work.drive + torque * way, work.loss + resistance * way, work.spring + held * way
    if noted:
        row = motor.row_work
        row.drive, row.loss, row.spring = driven, lost, sprung
        driven = lost = sprung = 0.0
        constant = drive.torque_constant
        motor.torque, motor.friction, motor.mean_velocity = torque, friction, mean
        motor.full_voltage = 1.0 if abs(torque + drive.emf * middle) >= FULL * drive.stall else 0.0
        if constant > 0.0:
            motor.current = torque / constant
            motor.voltage = drive.resistance * motor.current + constant * mean
    way = 0.5 * step * velocity
    work.drive, work.loss, work.spring = driven + torque * way, lost + resistance * way, sprung + held * way


def limit(joint: JointState, link: JointConstants, v: float) -> float:
    """Derivative gain of the link's controller that acts at the velocity v; also stores the limited torque in
    `now.applied`.

    The effort limit applies to the sum of torque and derivative action (mode 1). Within the limit, the derivative action acts
    as damping. Beyond the limit, the derivative action is 0 and the torque equals the limit.
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
    part c, damping ratio D and inertia I (paper section 4.2.2).
    """
    if link.damping_ratio == 0.0:
        return link.damping
    return link.damping + 2.0 * link.damping_ratio * math.sqrt(max(link.damping_inertia * joint.stiffness, 0.0))


def find_state(joint: JointState, link: JointConstants, kind: JointKind) -> None:
    """Compute stiffness and energy of the springs at the recorded kick."""
    for i in range(kind.positions):
        motor_of(joint, i).theta = motor_of(joint, i).kick_position
    spring_law(kind.spring_law, joint, link, kind, joint.position, TASK.whole)


def friction_of(joint: JointState, link: JointConstants, v: float) -> float:
    """Largest friction of the joint in N m: tau_c + c |tau| + tau_x exp(-(v / v_x)^2), with Coulomb friction tau_c, load
    coefficient c, actuator torque on the link tau, Stribeck excess tau_x and Stribeck velocity v_x. Friction of any size
    dissipates energy.
    """
    bound: float = link.coulomb + link.share * abs(joint.now.applied - joint.brake * v)
    if link.stribeck > 0.0:
        ratio = v * link.fade
        bound += link.stribeck * math.exp(-ratio * ratio)
    return bound
