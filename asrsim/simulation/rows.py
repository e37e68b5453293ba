"""The row of numbers of a joint, as a run begins with it: see :data:`asrsim.simulation.substep.PLACES`."""

from __future__ import annotations

from typing import Any

from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.kernels import MOTOR_STATE
from asrsim.simulation.memory import STATE_NUMBERS
from asrsim.simulation.substep import (
    BASE,
    BOUND,
    BRAKE,
    COULOMB,
    DAMPING,
    EFFORT,
    FADE,
    FASTEST,
    GAIN_1,
    GAIN_2,
    INERTIA,
    LAG,
    PLACES,
    PREVIOUS,
    RATIO,
    REST,
    SHARE,
    SPRING,
    STATE,
    STRIBECK,
    WEIGHT,
    Sensing,
)  # fmt: skip


def joint_row(
    drive: SteppedJoint,
    sensing: Sensing | None,
    constants: Any,
    position: float,
    velocity: float,
    substep: float,
    *,
    compiled: bool,
) -> list[Any]:
    """The row without its response; position (rad) and velocity (rad/s) of the link at the start, substep in s. constants: of
    the law, as plain Python takes them; compiled: in a row."""
    row: list[Any] = [0.0] * len(PLACES)
    gains, law = drive.derivative_gains, drive.link_damping
    given = {
        PREVIOUS: velocity, EFFORT: drive.joint.most_effort,
        FASTEST: drive.joint.velocity or float("inf"), DAMPING: drive.constant_damping, BRAKE: drive.link_brake,
        SPRING: drive.joint.spring_stiffness, REST: drive.joint.spring_reference, WEIGHT: 0.5,
        LAG: drive.stepping.first_drift * substep, BASE: drive.constant_damping, RATIO: law.ratio if law else 0.0,
        INERTIA: law.inertia if law else 0.0, GAIN_1: gains[0], GAIN_2: gains[1],
        BOUND: drive.joint.friction, COULOMB: drive.joint.friction, STRIBECK: drive.joint.stribeck_friction,
        FADE: 1.0 / drive.joint.stribeck_velocity, SHARE: drive.joint.load_friction,
    }  # fmt: skip
    for column, value in given.items():
        row[column] = float(value)
    rings = [_ring(drive, sensing, i, position, velocity) for i in range(2)]
    if compiled:
        state = [float(number) for number in drive.initial_state]
        room = [0.0] * (STATE_NUMBERS - len(state))
        row[STATE:] = [*state, *room, *constants, *rings[0], *rings[1]]
    else:
        row[STATE:] = [drive.initial_state, constants, *rings]
    return row


def _ring(drive: SteppedJoint, sensing: Sensing | None, i: int, position: float, velocity: float) -> list[float]:
    """What sensor `i` saw before the start: the start."""
    if sensing is None:
        return []
    state = drive.initial_state
    x, v = (position, velocity) if sensing.on_link or len(state) < MOTOR_STATE * (i + 1) else state[MOTOR_STATE * i :][:2]
    return [x, v] * (sensing.delay + 2) + [0.0, x, v]
