"""One substep of the joints: from what they do to the torques on their links. Ordinary code, run as it is or compiled.

A joint's numbers stand in a row, by the places below: a list for plain Python, a row of an array for compiled code. What
differs between the two is in :class:`Memory`; everything that is physics is here and in the laws of
:mod:`asrsim.simulation.kernels`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp, floor
from typing import Any

from asrsim.simulation.kernels import MOTOR_STATE, RECORD, Advance

PLACES = (
    "previous", "speed", "torque", "last_force", "force", "drag", "effort", "fastest", "damping", "brake", "spring", "rest",
    "weight", "lag", "base", "ratio", "inertia", "read_1", "push_1", "read_2", "push_2", "gain_1", "gain_2", "bound", "coulomb",
    "stribeck", "fade", "share", "state",
)  # fmt: skip
(
    PREVIOUS, SPEED, TORQUE, LAST_FORCE, FORCE, DRAG, EFFORT, FASTEST, DAMPING, BRAKE, SPRING, REST,
    WEIGHT, LAG, BASE, RATIO, INERTIA, READ_1, PUSH_1, READ_2, PUSH_2, GAIN_1, GAIN_2, BOUND, COULOMB,
    STRIBECK, FADE, SHARE, STATE,
) = range(len(PLACES))  # fmt: skip
"""Columns of a joint's row.

Changed by every substep: PREVIOUS, the velocity one substep ago; SPEED, the velocity that damping acts on but for this kick's
torques (rad/s); TORQUE of the actuator, LAST_FORCE and FORCE on the link over the last kick and this one, DRAG of damping and
brake (N m).

Constants: the limits EFFORT (N m) and FASTEST (rad/s); DAMPING of the link and BRAKE, the derivative gain of its controller
(N m s/rad); SPRING and REST of a passive spring (N m/rad, rad); WEIGHT of a kick's change in the mean velocity; LAG, the time
by which motors' positions are behind (s); BASE, RATIO and INERTIA of a damping that follows the stiffness (N m s/rad, 1,
kg m^2).

Of sensor 1 and 2: READ, by how much its position differs from the truth (rad); PUSH, the torque that the error of its velocity
makes (N m); GAIN, the controller's derivative gain (N m s/rad).

BOUND, friction of the joint over this kick (N m), and what it follows from where it varies: COULOMB and STRIBECK (N m), FADE,
one over the Stribeck velocity (s/rad), and SHARE of the load. STATE: where the state of the joint's law begins."""

RAW = ("link_position", "engine_velocity", "actuator_torque", "link_torque", "damping_torque", *RECORD)
"""Raw record of a joint and substep: rad, rad/s as the engine has it, N m before the limits, after them, of damping, and the
record of the joint's law."""
LINK_TORQUE, DAMPING_TORQUE, LAWS = 3, 4, 5
"""Columns of a row of the record: torque on the link, of damping, and where the law's own begin."""

GOAL_1, GOAL_2, EXTERNAL, READINGS = 0, 1, 2, 3
"""Inputs of a joint and substep: references, external torque (N m), and for each sensor whether it samples, and its noise."""

Step = Callable[..., None]
"""step(k, states, joints, inputs, rows): k in the block; states of the engine; rows: the record, (n, joints, RAW)."""


@dataclass(frozen=True)
class Memory:
    """How a joint's row is read and written."""

    load: Callable[[Any], Any]
    """Row -> the state, a tuple."""
    save: Callable[[Any, Any], None]
    constants: Callable[[Any], Any]
    """Row -> constants of the joint's law, nested tuples."""
    note: Callable[..., None]
    """note(rows, k, j, q, lagging, torque, applied, record)."""
    ring: Callable[[Any, int], Any]
    """Row and sensor -> what it saw, positions and velocities in turns."""


@dataclass(frozen=True)
class Sensing:
    """Sensors of a joint's controllers."""

    delay: int
    """Substeps."""
    quantum: float
    on_link: bool
    count: int
    """Controllers: 1 or 2."""
    ahead: float
    """Part of a substep by which what is read of a velocity lies before its position."""


def make_group(
    members: tuple[int, ...],
    advance: Advance,
    memory: Memory,
    unpack: Callable[[Any, int], tuple[float, float]],
    *,
    now: float,
    before: float,
    sensing: Sensing | None,
    damping: Callable[..., float] | None,
    cut: bool,
) -> Step:
    """Joints of one kind: law, limits, and what else pushes the link but damping.

    now, before: weights of the last two velocities in that of the whole step; damping: the link's, where it depends on the
    spring; cut: torque beyond the velocity limit is zeroed, as Gazebo does.
    """
    load, save, constants_of, note = memory.load, memory.save, memory.constants, memory.note
    sense = None if sensing is None else make_sense(sensing, memory)
    sensed = sense is not None
    varies = damping is not None
    measure = sense or _nothing
    law = damping or _nothing

    def group(k: int, states: Any, joints: Any, inputs: Any, rows: Any) -> None:
        # The last row says at which substep and joint the loop is, for the message where a law fails.
        where = joints[len(joints) - 1]
        where[0] = k
        for j in members:
            where[1] = j
            joint = joints[j]
            goals = inputs[k][j]
            q, lagging = unpack(states, j)
            past = joint[PREVIOUS]
            v = now * lagging + before * past
            joint[PREVIOUS] = lagging
            state = load(joint)
            if sensed:
                measure(joint, state, goals, q, v)
                state = with_integrals(state, joint[PUSH_1], joint[PUSH_2])
            torque, state, record = advance(
                state, constants_of(joint), q, v, goals[GOAL_1] - joint[READ_1], goals[GOAL_2] - joint[READ_2]
            )
            if sensed:
                state = with_integrals(state, -joint[PUSH_1], -joint[PUSH_2])
            save(joint, state)
            if varies:
                joint[DAMPING] = law(joint, constants_of(joint), q, record)
            if cut and abs(lagging) >= joint[FASTEST] and torque * lagging > 0.0:
                torque = 0.0
            applied = torque
            # A brake is part of what is limited: see make_damping.
            if joint[BRAKE] == 0.0:
                if applied > joint[EFFORT]:
                    applied = joint[EFFORT]
                elif applied < -joint[EFFORT]:
                    applied = -joint[EFFORT]
            note(rows, k, j, q, lagging, torque, applied, record)
            joint[SPEED] = lagging + joint[WEIGHT] * (lagging - past)
            joint[TORQUE] = torque
            joint[FORCE] = applied + goals[EXTERNAL] + joint[SPRING] * (joint[REST] - q)

    return group


def _nothing(*arguments: Any) -> Any:
    return 0.0


def with_integrals(state: Any, push_1: float, push_2: float) -> Any:
    """A state whose controllers' integrals hold these torques (N m) too. The number of entries tells the kind of joint: a
    link's controller (1), one motor (4; 6 with hysteresis) or two (8; 12)."""
    if len(state) == 1:
        return (state[0] + push_1,)
    if len(state) == 4:
        return (state[0], state[1], state[2], state[3] + push_1)
    if len(state) == 6:
        return (state[0], state[1], state[2], state[3] + push_1, state[4], state[5])
    if len(state) == 12:
        return (
            state[0], state[1], state[2], state[3] + push_1, state[4], state[5], state[6], state[7] + push_2,
            state[8], state[9], state[10], state[11],
        )  # fmt: skip
    return (state[0], state[1], state[2], state[3] + push_1, state[4], state[5], state[6], state[7] + push_2)


def make_sense(sensing: Sensing, memory: Memory) -> Callable[..., None]:
    """What the controllers of a joint read: position and velocity of some time ago, held until the sensor samples anew, the
    position with noise and in steps of its quantum."""
    size = sensing.delay + 2
    quantum, on_link, count, ring_of = sensing.quantum, sensing.on_link, sensing.count, memory.ring
    now, before = 1.0 + sensing.ahead, -sensing.ahead

    def measure(joint: Any, state: Any, goals: Any, q: float, v: float) -> None:
        for i in range(count):
            ring = ring_of(joint, i)
            x, lagging = q, v
            if not on_link:
                lagging = state[MOTOR_STATE * i + 1]
                x = state[MOTOR_STATE * i] + joint[LAG] * lagging
            # A ring of past positions and velocities; behind it the index of the newest, and what the sensor read last.
            present = int(ring[2 * size])
            speed = now * lagging + before * ring[2 * ((present + size - 1) % size) + 1]
            ring[2 * present] = x
            ring[2 * present + 1] = lagging
            oldest = (present + 1) % size
            ring[2 * size] = float(oldest)
            if goals[READINGS + 2 * i] != 0.0:
                late = (present + 2) % size
                reading = ring[2 * late] + goals[READINGS + 2 * i + 1]
                if quantum > 0.0:
                    reading = quantum * floor(reading / quantum + 0.5)
                ring[2 * size + 1] = reading
                ring[2 * size + 2] = now * ring[2 * late + 1] + before * ring[2 * oldest + 1]
            joint[READ_1 + 2 * i] = ring[2 * size + 1] - x
            joint[PUSH_1 + 2 * i] = -joint[GAIN_1 + i] * (ring[2 * size + 2] - speed)

    return measure


def make_damping(count: int, *, coupled: bool) -> Step:
    """Damping of the links and the controllers' brakes, implicit: on the mean velocity over the kick that they help to make.

    A joint's row ends with its row of the response (mean velocity per torque on each joint, rad/s / N m), and then of the
    spread, the share that each joint's undamped mean has in it if they are coupled: see
    :func:`asrsim.simulation.damping.mean_response`.
    """

    def damp(k: int, states: Any, joints: Any, inputs: Any, rows: Any) -> None:
        for j in range(count):
            joint = joints[j]
            damping, brake = joint[DAMPING], joint[BRAKE]
            drag = 0.0
            if damping != 0.0 or brake != 0.0:
                end = len(joint)
                own = joint[end - 2 * count + j]
                push = joint[FORCE] - joint[LAST_FORCE]
                if coupled:
                    mean = 0.0
                    for i in range(count):
                        other = joints[i]
                        mean += joint[end - count + i] * other[SPEED]
                        mean += joint[end - 2 * count + i] * (other[FORCE] - other[LAST_FORCE])
                else:
                    mean = (joint[SPEED] + own * push) / (1.0 + own * (damping + brake))
                if brake != 0.0:
                    applied = joint[TORQUE] - brake * mean
                    limit = joint[EFFORT]
                    if abs(applied) > limit:
                        applied = limit if applied > 0.0 else -limit
                        if not coupled:
                            mean = (joint[SPEED] + own * (push + applied - joint[TORQUE])) / (1.0 + own * damping)
                    rows[k][j][LINK_TORQUE] = applied
                    drag = applied - joint[TORQUE]
                rows[k][j][DAMPING_TORQUE] = -damping * mean
                drag -= damping * mean
            joint[DRAG] = drag
        for j in range(count):
            joint = joints[j]
            joint[FORCE] += joint[DRAG]
            joint[LAST_FORCE] = joint[FORCE]

    return damp


def make_friction(members: tuple[int, ...]) -> Step:
    """Level of friction of the joints where it depends on speed and load, for engines that take it as Coulomb friction.

    tau_c + c |tau| + tau_x exp(-(v / v_x)^2), with the actuator's torque tau on the link and the speed that its damping acts
    on; standing joints have all of it. Whatever the level, friction only takes energy.
    """

    def rub(k: int, states: Any, joints: Any, inputs: Any, rows: Any) -> None:
        for j in members:
            joint = joints[j]
            ratio = joint[SPEED] * joint[FADE]
            joint[BOUND] = joint[COULOMB] + joint[SHARE] * abs(rows[k][j][LINK_TORQUE]) + joint[STRIBECK] * exp(-ratio * ratio)

    return rub


def chain(steps: Sequence[Step]) -> Step:
    """Steps one after the other."""
    if len(steps) == 1:
        return steps[0]
    first, rest = steps[0], chain(steps[1:])

    def both(k: int, states: Any, joints: Any, inputs: Any, rows: Any) -> None:
        first(k, states, joints, inputs, rows)
        rest(k, states, joints, inputs, rows)

    return both
