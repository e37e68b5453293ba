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

from asrsim.actuators.hysteresis import dahl
from asrsim.actuators.motor import velocity_bounds

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


def _drift(position: float, way: float, low: float, high: float) -> float:
    """A motor's position after part of its way, between its stops."""
    moved = position + way
    return high if moved > high else low if moved < low else moved


def make_advance_one_motor(elastic_torques: Any, kick: Any) -> Advance:
    """Modes 4 to 8 with one motor; the second reference, if any, is the adjuster's position."""

    def advance_one_motor(
        state: tuple[float, ...], constants: Any, q: float, v: float, r_1: float, r_2: float
    ) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        before, after, elastic, motor, low, high, most = constants
        x, v_0, anchor, integral = state
        x = _drift(x, before * v_0, low, high)
        torque, rest = elastic_torques(q, x, r_2, elastic)
        slowest, fastest = velocity_bounds(x, low, high, most, before + after)
        v_1, mean, anchor, integral, drive, friction = kick(x, v_0, anchor, integral, r_1, torque, slowest, fastest, motor)
        record = (torque, rest, x, mean, drive, friction, r_2, 0.0, 0.0, 0.0)
        return torque + rest, (_drift(x, after * v_1, low, high), v_1, anchor, integral), record

    return advance_one_motor


def make_advance_two_motors(elastic_torques: Any, kick: Any) -> Advance:
    """Modes 4 to 8 with two motors against each other."""

    def advance_two_motors(
        state: tuple[float, ...], constants: Any, q: float, v: float, r_1: float, r_2: float
    ) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        before, after, elastic, motor_1, low_1, high_1, most_1, motor_2, low_2, high_2, most_2 = constants
        x, v_x, anchor_x, integral_x, y, v_y, anchor_y, integral_y = state
        x = _drift(x, before * v_x, low_1, high_1)
        y = _drift(y, before * v_y, low_2, high_2)
        torque_x, torque_y = elastic_torques(q, x, y, elastic)
        slow_x, fast_x = velocity_bounds(x, low_1, high_1, most_1, before + after)
        slow_y, fast_y = velocity_bounds(y, low_2, high_2, most_2, before + after)
        u_x, mean_x, anchor_x, integral_x, drive_x, friction_x = kick(
            x, v_x, anchor_x, integral_x, r_1, torque_x, slow_x, fast_x, motor_1
        )
        u_y, mean_y, anchor_y, integral_y, drive_y, friction_y = kick(
            y, v_y, anchor_y, integral_y, r_2, torque_y, slow_y, fast_y, motor_2
        )
        record = (torque_x, torque_y, x, mean_x, drive_x, friction_x, y, mean_y, drive_y, friction_y)
        x = _drift(x, after * u_x, low_1, high_1)
        y = _drift(y, after * u_y, low_2, high_2)
        return torque_x + torque_y, (x, u_x, anchor_x, integral_x, y, u_y, anchor_y, integral_y), record

    return advance_two_motors


BRISTLE_STATE = 2
"""Numbers of a spring's hysteresis: its torque (N m), and the deflection at the last kick (rad; NaN before the first)."""


def make_hysteretic_torques(elastic_torques: Any, springs: int) -> Any:
    """The springs' law with hysteresis added. It takes for parameters those of the law, the state of the hysteresis, and its
    level (N m) and length (rad)."""

    def torques(q: float, theta_1: float, theta_2: float, parameters: Any) -> tuple[float, float]:
        elastic, bristles, level, length = parameters
        torque_1, torque_2 = elastic_torques(q, theta_1, theta_2, elastic)
        torque_1 = torque_1 + dahl(bristles[0], _change(theta_1 - q, bristles[1]), level, length)
        if springs == 2:
            torque_2 = torque_2 + dahl(bristles[2], _change(theta_2 - q, bristles[3]), level, length)
        return torque_1, torque_2

    return torques


def _change(deflection: float, before: float) -> float:
    """Of the deflection since the last kick; before the first kick, where `before` is NaN, there is none."""
    return deflection - before if before == before else 0.0


def _follow(bristles: Any, q: float, record: tuple[float, ...], level: float, length: float) -> Any:
    """State of the hysteresis after a kick, of one spring or two."""
    d_1 = record[2] - q
    h_1 = dahl(bristles[0], _change(d_1, bristles[1]), level, length)
    if len(bristles) == BRISTLE_STATE:
        return (h_1, d_1)
    d_2 = record[6] - q
    return (h_1, d_1, dahl(bristles[2], _change(d_2, bristles[3]), level, length), d_2)


def make_hysteretic_ideal(advance: Advance) -> Advance:
    """`advance` of ideal motors whose springs have hysteresis: made of :func:`make_hysteretic_torques`."""

    def advance_hysteretic_ideal(
        state: Any, constants: Any, q: float, v: float, r_1: float, r_2: float
    ) -> tuple[float, Any, tuple[float, ...]]:
        elastic, level, length = constants
        torque, _, record = advance((), (elastic, state, level, length), q, v, r_1, r_2)
        return torque, _follow(state, q, record, level, length), record

    return advance_hysteretic_ideal


def make_hysteretic_one_motor(advance: Advance) -> Advance:
    """The same of one motor with dynamics; its state comes first."""

    def advance_hysteretic_one_motor(
        state: Any, constants: Any, q: float, v: float, r_1: float, r_2: float
    ) -> tuple[float, Any, tuple[float, ...]]:
        before, after, elastic, motor, low, high, most, level, length = constants
        x, v_x, anchor, integral, h, d = state
        inner = (before, after, (elastic, (h, d), level, length), motor, low, high, most)
        torque, moved, record = advance((x, v_x, anchor, integral), inner, q, v, r_1, r_2)
        return torque, (*moved, *_follow((h, d), q, record, level, length)), record

    return advance_hysteretic_one_motor


def make_hysteretic_two_motors(advance: Advance) -> Advance:
    """The same of two motors."""

    def advance_hysteretic_two_motors(
        state: Any, constants: Any, q: float, v: float, r_1: float, r_2: float
    ) -> tuple[float, Any, tuple[float, ...]]:
        before, after, elastic, motor_1, low_1, high_1, most_1, motor_2, low_2, high_2, most_2, level, length = constants
        x, v_x, anchor_x, integral_x, y, v_y, anchor_y, integral_y, h_1, d_1, h_2, d_2 = state
        bristles = (h_1, d_1, h_2, d_2)
        law = (elastic, bristles, level, length)
        inner = (before, after, law, motor_1, low_1, high_1, most_1, motor_2, low_2, high_2, most_2)
        motors = (x, v_x, anchor_x, integral_x, y, v_y, anchor_y, integral_y)
        torque, moved, record = advance(motors, inner, q, v, r_1, r_2)
        return torque, (*moved, *_follow(bristles, q, record, level, length)), record

    return advance_hysteretic_two_motors


def with_bristles(motors: Any, springs: Any) -> Any:
    """The motors of one state with the springs' hysteresis of another. Hysteresis advances once a step, from whole step to
    whole step: within a step the motors move while q is frozen, which would
    wrongly erase part of its memory."""
    if len(motors) == 6:
        return (motors[0], motors[1], motors[2], motors[3], springs[4], springs[5])
    return (
        motors[0], motors[1], motors[2], motors[3], motors[4], motors[5], motors[6], motors[7],
        springs[8], springs[9], springs[10], springs[11],
    )  # fmt: skip


def make_substepped(advance: Advance, substeps: int, *, hysteretic: bool) -> Advance:
    """`advance` as an odd number of equal motor-and-spring steps with q frozen: mean torque, record of the middle one.

    Frozen q with the mean torque stays bounded; q extrapolated would diverge or add damping.
    """
    if substeps == 1:
        return advance
    middle = substeps // 2
    rejoin = with_bristles if hysteretic else _first_of

    def advance_substepped(
        state: Any, constants: Any, q: float, v: float, r_1: float, r_2: float
    ) -> tuple[float, Any, tuple[float, ...]]:
        begun = state
        total, state, record = advance(state, constants, q, v, r_1, r_2)
        followed = state
        for index in range(1, substeps):
            torque, state, latest = advance(rejoin(state, begun), constants, q, v, r_1, r_2)
            total += torque
            if index == middle:
                record = latest
                followed = state
        return total / substeps, rejoin(state, followed), record

    return advance_substepped


def _first_of(one: Any, other: Any) -> Any:
    return one
