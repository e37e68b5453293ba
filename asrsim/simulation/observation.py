"""What one sees of a simulation between steps, and what brings it back there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.layout import LAGGING, MOTOR_POSITION, MOTOR_VELOCITY, OWN, PER_MOTOR, POSITION


@dataclass(frozen=True, kw_only=True)
class Observation:
    """The state at a whole step; arrays are (n,) in the order of the joints, of several worlds (N, n), NaN where a joint has
    no such thing."""

    time: Any
    """s; of several worlds (N,)."""
    link_position: Array
    """rad (m)."""
    link_velocity: Array
    """rad/s (m/s)."""
    motor_1_position: Array
    """rad; of ideal motors: nan, they stand at their references."""
    motor_1_velocity: Array
    motor_2_position: Array
    motor_2_velocity: Array


@dataclass(frozen=True)
class Snapshot:
    """Everything that decides how a simulation goes on."""

    owner: object
    """Of the simulation and its parameters; it goes on from no other."""
    state: Any
    record: Any


def observe(time: Any, drives: Sequence[SteppedJoint], state: Array, substep: float) -> Observation:
    """States (..., joints, columns) at a whole step, at `time` s; substep in s."""
    motors = np.full((4, *state.shape[:-1]), np.nan)
    dynamic = [drive.dynamic_motors for drive in drives]
    lag = drives[0].stepping.first_drift * substep if drives else 0.0
    for i in range(min(max(dynamic, default=0), 2)):
        joints, m = [j for j, count in enumerate(dynamic) if count > i], OWN + i * PER_MOTOR
        velocity = state[..., joints, m + MOTOR_VELOCITY]
        motors[2 * i][..., joints] = state[..., joints, m + MOTOR_POSITION] + lag * velocity
        motors[2 * i + 1][..., joints] = velocity
    return Observation(
        time=time,
        link_position=state[..., POSITION].copy(),
        link_velocity=state[..., LAGGING].copy(),
        motor_1_position=motors[0],
        motor_1_velocity=motors[1],
        motor_2_position=motors[2],
        motor_2_velocity=motors[3],
    )
