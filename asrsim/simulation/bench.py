"""Actuators on a test bench, row by row: prescribed link motion and references in, torques and motor states out.

A row is a step, at the row's time. In leapfrog the motors rest at the first row's time, as in a simulation; in the other
steppings, and with a first step given, the first row is a whole step, as long as the second's. So a recorded experiment's
motion can be played into the model, and the released code's outputs be reproduced to the last digits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.errors import SimulationError
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint, make_drives
from asrsim.simulation.joint import advance, remember_springs
from asrsim.simulation.laws import plain_law
from asrsim.simulation.layout import (
    DRIVE_TORQUE,
    ENGINE_VELOCITY,
    FIRST_MOTOR,
    JOINT_STEP,
    KICK_POSITION,
    LOAD,
    MEAN_VELOCITY,
    MOTOR_POSITION,
    P_LEVEL,
    PER_MOTOR,
    POSITION,
    SPRING_LAW,
    TORQUE,
)  # fmt: skip
from asrsim.simulation.rows import positions_of, shape_of, start_of, tables
from asrsim.simulation.steppings import STEPPINGS

OUTPUTS = (
    "position", "velocity", "reference_1", "reference_2", "link_torque", "elastic_torque_1", "elastic_torque_2", "stiffness",
    "motor_1_position", "motor_1_velocity", "motor_1_effort", "motor_2_position", "motor_2_velocity", "motor_2_effort",
)  # fmt: skip
"""Output columns of a joint, in SI units. `motor_i_effort` is the toolbox's name for `motor_i_torque`. In modes without a
spring (0, 1), torques and stiffness are NaN and motor values 0. In the released order, values of ideal motors (modes 2, 3) are
0 too; in other steppings, values that an actuator with one motor and no adjuster lacks are NaN."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Prescribed motion and references of one joint, each (n,): rad, rad/s, references in the units of the mode."""

    position: Array
    velocity: Array
    reference_1: Array
    reference_2: Array


def run_bench(
    robot: Robot,
    time: Array,
    motions: Mapping[str, Motion],
    *,
    stepping: str = "leapfrog",
    first_step: float | None = None,
) -> dict[str, dict[str, Array]]:
    """Joint -> column of `OUTPUTS` -> values (n,). time: (n,) s, ascending.

    first_step: length of the first row's step in s; None: as long as the second, and in leapfrog none: the motors rest there.
    """
    steps = step_lengths(time, first_step)
    # The motors rest at the time of the first row. In staggered steppings, a half step brings velocities to the first half
    # step.
    resting = first_step is None and STEPPINGS.get(stepping).staggered
    initial = {name: float(motion.position[0]) for name, motion in motions.items()} if stepping != "toolbox" else {}
    drives = make_drives(robot, STEPPINGS.get(stepping), initial_positions=initial, link_damping={})
    return {
        drive.name: _run_joint(drive, steps, motions[drive.name], resting=resting) for drive in drives if drive.name in motions
    }


def step_lengths(time: Array, first_step: float | None = None) -> list[float]:
    """Length of each row's step in s, without the rounding errors of the times: 0.001 instead of 0.0010000000000000009."""
    if len(time) < 2:
        return [first_step if first_step is not None else (float(time[0]) or 1e-3)]
    steps = np.diff(time)
    rounding = 4.0 * float(np.spacing(np.max(np.abs(time))))
    mean = float(time[-1] - time[0]) / len(steps)
    if np.all(np.abs(steps - mean) <= rounding):
        lengths = [_simplest(mean, rounding / len(steps) + np.spacing(mean))] * len(steps)
    else:
        lengths = [_simplest(step, rounding) for step in steps.tolist()]
    return [lengths[0] if first_step is None else first_step, *lengths]


def _simplest(step: float, rounding: float) -> float:
    """The decimal number with the fewest digits within `rounding` of `step`."""
    for digits in range(1, 17):
        candidate = float(f"{step:.{digits}g}")
        if abs(candidate - step) <= rounding:
            return candidate
    return step


def _run_joint(drive: SteppedJoint, steps: Sequence[float], motion: Motion, *, resting: bool) -> dict[str, Array]:
    shape = shape_of([drive], [None])
    kinds, constants = tables([drive], [None], shape, motor_substeps=1, cutoff=False)
    k: list[Any] = kinds[0].tolist()
    p = constants[0].tolist()
    if drive.actuator is not None and drive.mode is not None and drive.mode.spring:
        actuator: Any = drive.actuator
        k[SPRING_LAW] = plain_law(actuator, positions_of(drive))
    if drive.stepping.joint_step is not None:
        k[JOINT_STEP] = drive.stepping.joint_step
    s = start_of(drive, None, shape, drive.initial_position, 0.0)
    references = np.zeros((max(shape.motors, 2), len(motion.position)))
    references[0], references[1] = motion.reference_1, motion.reference_2
    columns = (motion.position, motion.velocity, motion.reference_1, motion.reference_2)
    goals = drive.goals(references).T.tolist()
    rows = []
    for row, (step, q, v, r_1, r_2) in enumerate(zip(steps, *(column.tolist() for column in columns), strict=True)):
        s[POSITION], s[ENGINE_VELOCITY] = q, v
        u = [0.0, *goals[row]]
        z = (step, 1.0, 0.0, drive.stepping.first_drift, drive.stepping.implicitness, 0.0, 0.0)
        before = [s[FIRST_MOTOR + i * PER_MOTOR + MOTOR_POSITION] for i in range(2)]
        if resting and row == 0:
            # The first row shows the state at rest; a half step then brings the motors' velocities to the first half step.
            advance(s, p, k, z, u, 0.0, DRIVE_TORQUE, False)
            torque, shown = s[TORQUE], list(s)
            advance(s, p, k, z, u, 0.5 * step, 0, False)
        else:
            advance(s, p, k, z, u, step, DRIVE_TORQUE, False)
            torque, shown = s[TORQUE], s
        if p[P_LEVEL] > 0.0:
            remember_springs(s, p, k)
        if not math.isfinite(torque):
            raise SimulationError(
                f"joint '{drive.name}', row {row + 1}: the law has no finite value at q = {q:g}, references {r_1:g} and {r_2:g}"
            )
        rows.append((q, v, r_1, r_2, torque - drive.link_brake * v, *_outputs(drive, q, before, shown)))
    table = np.array(rows, dtype=float).reshape(len(rows), len(OUTPUTS))
    return {name: table[:, index] for index, name in enumerate(OUTPUTS)}


def _outputs(drive: SteppedJoint, q: float, before: Sequence[float], s: Sequence[float]) -> tuple[float, ...]:
    """Torques, stiffness and motor values of one row, in the released order as the released code publishes them."""
    actuator, mode = drive.actuator, drive.mode
    if actuator is None or mode is None or not mode.spring:
        return (math.nan, math.nan, math.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    torque_1, torque_2 = (s[FIRST_MOTOR + i * PER_MOTOR + LOAD] for i in range(2))
    x, v_x, drive_x, y, v_y, drive_y = (
        s[FIRST_MOTOR + i * PER_MOTOR + column] for i in range(2) for column in (KICK_POSITION, MEAN_VELOCITY, DRIVE_TORQUE)
    )
    released = drive.stepping.released
    # In mode 4 the released code computes stiffness and torques at the motors' positions before the step.
    motors = before if released and mode.number == 4 else (x, y)
    law: Any = actuator.stiffness
    stiffness = law(q, *motors, drive.elastic)
    if released and not mode.motor:
        x = y = 0.0
    if not released and actuator.motors == 1 and not actuator.adjuster:
        torque_2 = y = v_y = drive_y = math.nan
    return (torque_1, torque_2, stiffness, x, v_x, drive_x, y, v_y, drive_y)
