"""What a joint does in one step, as pure functions: state and numbers in, torque, new state and record out.

One source serves the plain and the compiled loop: floats, tuples and :mod:`math` only. All have the form

    advance(state, constants, q, v, r_1, r_2) -> (link torque, new state, record)

with q in rad at the whole step, v in rad/s extrapolated to it, references r_1, r_2 after the reference map. A step of a joint
with motors is drift - kick - drift: with the default stepping's constants the motors' part of a Strang splitting (second
order); with a first drift of 0 the semi-implicit Euler rule. `record` is what :data:`RECORD` names.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from asrsim.actuators.motor import motor_kick

Advance = Callable[[Any, Any, float, float, float, float], tuple[float, Any, tuple[float, ...]]]

MOTOR_STATE = 4
"""Numbers of a motor's state: position (rad), velocity (rad/s), where Dahl's bristles stick (rad), the controller's integral
(N m)."""
RECORD = (
    "torque_1", "torque_2",
    "position_1", "velocity_1", "drive_1", "friction_1",
    "position_2", "velocity_2", "drive_2", "friction_2",
)  # fmt: skip
"""Names of a record's entries: torques of springs 1 and 2; position at the kick, mean velocity over it, motor torque and
friction of motors 1 and 2. Entries that a kind of joint does not have are 0."""


def advance_passive(
    state: tuple[float, ...], constants: tuple[float, ...], q: float, v: float, r_1: float, r_2: float
) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
    """A joint without actuator."""
    return 0.0, state, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def advance_torque(
    state: tuple[float, ...], constants: tuple[float, ...], q: float, v: float, r_1: float, r_2: float
) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
    """Mode 0: the reference is the link's torque."""
    return r_1, state, (0.0, 0.0, 0.0, 0.0, r_1, 0.0, 0.0, 0.0, 0.0, 0.0)


def advance_link_controller(
    state: tuple[float, ...], constants: tuple[float, ...], q: float, v: float, r_1: float, r_2: float
) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
    """Mode 1: a PID controller on the rigid link (paper eq. 11) but its derivative action, which the loop has.

    State: the integral; constants: P, I times step.
    """
    p, i_step = constants
    error = r_1 - q
    more = i_step * error
    torque = p * error + state[0] + 0.5 * more
    return torque, (state[0] + more,), (0.0, 0.0, 0.0, 0.0, torque, 0.0, 0.0, 0.0, 0.0, 0.0)


def make_advance_ideal(elastic_torques: Any) -> Advance:
    """Modes 2 and 3: the motors stand at the references."""

    def advance_ideal(
        state: tuple[float, ...], constants: Any, q: float, v: float, r_1: float, r_2: float
    ) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        torque_1, torque_2 = elastic_torques(q, r_1, r_2, constants)
        return torque_1 + torque_2, state, (torque_1, torque_2, r_1, 0.0, 0.0, 0.0, r_2, 0.0, 0.0, 0.0)

    return advance_ideal


def make_advance_one_motor(elastic_torques: Any) -> Advance:
    """Modes 4 to 6 with one motor; the second reference, if any, is the adjuster's position."""

    def advance_one_motor(
        state: tuple[float, ...], constants: Any, q: float, v: float, r_1: float, r_2: float
    ) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        before, after, elastic, motor, low, high = constants
        x, v_0, anchor, integral = state
        x = x + before * v_0
        torque, rest = elastic_torques(q, x, r_2, elastic)
        v_1, mean, anchor, integral, drive, friction = motor_kick(x, v_0, anchor, integral, r_1, torque, motor)
        x_1 = x + after * v_1
        v_2 = v_1
        if x_1 > high:
            x_1, v_2 = high, 0.0
        elif x_1 < low:
            x_1, v_2 = low, 0.0
        record = (torque, rest, x, mean, drive, friction, r_2, 0.0, 0.0, 0.0)
        return torque + rest, (x_1, v_2, anchor, integral), record

    return advance_one_motor


def make_advance_two_motors(elastic_torques: Any) -> Advance:
    """Modes 4 to 6 with two motors against each other."""

    def advance_two_motors(
        state: tuple[float, ...], constants: Any, q: float, v: float, r_1: float, r_2: float
    ) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        before, after, elastic, motor_1, low_1, high_1, motor_2, low_2, high_2 = constants
        x, v_x, anchor_x, integral_x, y, v_y, anchor_y, integral_y = state
        x = x + before * v_x
        y = y + before * v_y
        torque_x, torque_y = elastic_torques(q, x, y, elastic)
        u_x, mean_x, anchor_x, integral_x, drive_x, friction_x = motor_kick(
            x, v_x, anchor_x, integral_x, r_1, torque_x, motor_1
        )
        u_y, mean_y, anchor_y, integral_y, drive_y, friction_y = motor_kick(
            y, v_y, anchor_y, integral_y, r_2, torque_y, motor_2
        )
        record = (torque_x, torque_y, x, mean_x, drive_x, friction_x, y, mean_y, drive_y, friction_y)
        x = x + after * u_x
        y = y + after * u_y
        if x > high_1:
            x, u_x = high_1, 0.0
        elif x < low_1:
            x, u_x = low_1, 0.0
        if y > high_2:
            y, u_y = high_2, 0.0
        elif y < low_2:
            y, u_y = low_2, 0.0
        return torque_x + torque_y, (x, u_x, anchor_x, integral_x, y, u_y, anchor_y, integral_y), record

    return advance_two_motors


def make_substepped(advance: Advance, substeps: int) -> Advance:
    """`advance` as an odd number of equal motor-and-spring steps with q frozen: mean torque, record of the middle one.

    Frozen q with the mean torque stays bounded; q extrapolated would diverge or add damping.
    """
    middle = substeps // 2

    def advance_substepped(
        state: Any, constants: Any, q: float, v: float, r_1: float, r_2: float
    ) -> tuple[float, Any, tuple[float, ...]]:
        total, state, record = advance(state, constants, q, v, r_1, r_2)
        for index in range(1, substeps):
            torque, state, latest = advance(state, constants, q, v, r_1, r_2)
            total += torque
            if index == middle:
                record = latest
        return total / substeps, state, record

    return advance_substepped


def damp(
    torque: float,
    v: float,
    change: float,
    limit: float,
    damping: float,
    brake: float,
    response: float,
    lean: float,
    last_torque: float,
    last_mean: float,
) -> tuple[float, float]:
    """The link's torque in N m with its damping, and the mean velocity over the kick that it acts on, in rad/s.

    torque: the actuator's in N m, within `limit`; v: rad/s extrapolated to the whole step, `change` of it over the last
    one; damping: N m s/rad, of which `brake` is the controller's (mode 1), within the limit; response, lean: see
    :func:`asrsim.simulation.damping.mean_response`.
    """
    drag = response * damping
    mean = (v + lean * change + response * (torque - last_torque) + drag * last_mean) / (1.0 + drag)
    if brake != 0.0:
        torque -= brake * mean
        if torque > limit:
            torque = limit
        elif torque < -limit:
            torque = -limit
    return torque - (damping - brake) * mean, mean
