"""What one sees of a simulation between steps, and what brings it back there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.kernels import MOTOR_STATE
from asrsim.simulation.loop import Loop


@dataclass(frozen=True, kw_only=True)
class Observation:
    """The state at a whole step; arrays are (n,) in the order of the joints, NaN where a joint has no such thing."""

    time: float
    """s."""
    link_position: Array
    """rad (m)."""
    link_velocity: Array
    """rad/s (m/s)."""
    motor_1_position: Array
    """rad; of ideal motors: nan, they stand at their references."""
    motor_1_velocity: Array
    motor_2_position: Array
    motor_2_velocity: Array


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """Everything that decides how a simulation goes on."""

    owner: object
    """Of the simulation and its parameters; it goes on from no other."""
    substep: int
    engine: Any
    joints: Any
    held: Mapping[tuple[int, int], float]
    record: Any


def observe(time: float, drives: Sequence[SteppedJoint], loop: Loop, substep: float) -> Observation:
    """The state of a loop at a whole step, at `time` s; substep in s."""
    positions, velocities = loop.joint_states()
    motors = np.full((4, len(drives)), np.nan)
    for j, (drive, state) in enumerate(zip(drives, loop.motor_states(), strict=True)):
        lag = drive.stepping.first_drift * substep
        for i in range(drive.dynamic_motors):
            position, velocity = state[MOTOR_STATE * i :][:2]
            motors[2 * i : 2 * i + 2, j] = position + lag * velocity, velocity
    return Observation(
        time=time,
        link_position=np.array(positions),
        link_velocity=np.array(velocities),
        motor_1_position=motors[0],
        motor_1_velocity=motors[1],
        motor_2_position=motors[2],
        motor_2_velocity=motors[3],
    )
