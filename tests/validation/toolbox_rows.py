"""Row-by-row driver of a joint with toolbox stepping: link motion and references in, torques and motor states out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint, make_drives
from asrsim.simulation.joint import advance
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
    PER_MOTOR,
    POSITION,
    SPRING_LAW,
    TORQUE,
)  # fmt: skip
from asrsim.simulation.rows import positions_of, shape_of, start_of, tables
from asrsim.simulation.steppings import STEPPINGS

OUTPUTS = (
    "link_torque", "elastic_torque_1", "elastic_torque_2", "stiffness",
    "motor_1_position", "motor_1_velocity", "motor_1_effort", "motor_2_position", "motor_2_velocity", "motor_2_effort",
)  # fmt: skip
"""Names of the outputs. As in the released code, modes without a spring give NaN for springs and 0 for motors."""


def toolbox_rows(robot: Robot, time: Array, motion: Array, first_step: float | None) -> dict[str, Array]:
    """Values (n,) of each output of the robot's only joint. motion: (n, 4) position, velocity, first and second reference."""
    (drive,) = make_drives(robot, STEPPINGS.get("toolbox"), initial_positions={}, link_damping={})
    shape = shape_of([drive], [None])
    kinds, constants = tables([drive], [None], shape, motor_substeps=1, cutoff=False)
    k: list[Any] = kinds[0].tolist()
    p = constants[0].tolist()
    actuator: Any = drive.actuator
    if actuator is not None and drive.mode is not None and drive.mode.spring:
        k[SPRING_LAW] = plain_law(actuator, positions_of(drive))
    k[JOINT_STEP] = drive.stepping.joint_step
    s = start_of(drive, None, shape, drive.initial_position, 0.0)
    goals = drive.goals(motion[:, 2:].T[: max(shape.motors, 2)]).T.tolist()
    rows = []
    for step, (q, v, *_), goal in zip(steps_of(time, first_step), motion.tolist(), goals, strict=True):
        s[POSITION], s[ENGINE_VELOCITY] = q, v
        before = [s[FIRST_MOTOR + i * PER_MOTOR + MOTOR_POSITION] for i in range(2)]
        z = (step, 1.0, 0.0, drive.stepping.first_drift, drive.stepping.implicitness, 0.0, 0.0)
        advance(s, p, k, z, [0.0, *goal], step, True, False)
        rows.append((s[TORQUE], *_outputs(drive, q, before, s)))
    return dict(zip(OUTPUTS, np.array(rows).T, strict=True))


def _outputs(drive: SteppedJoint, q: float, before: Sequence[float], s: Sequence[float]) -> tuple[float, ...]:
    actuator, mode = drive.actuator, drive.mode
    if actuator is None or mode is None or not mode.spring:
        return (math.nan, math.nan, math.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    torques = [s[FIRST_MOTOR + i * PER_MOTOR + LOAD] for i in range(2)]
    x, v_x, drive_x, y, v_y, drive_y = (
        s[FIRST_MOTOR + i * PER_MOTOR + column] for i in range(2) for column in (KICK_POSITION, MEAN_VELOCITY, DRIVE_TORQUE)
    )
    law: Any = actuator.stiffness
    # In mode 4 the released code computes the stiffness at the motors' positions before the step.
    stiffness = law(q, *(before if mode.number == 4 else (x, y)), drive.elastic)
    x, y = (x, y) if mode.motor else (0.0, 0.0)
    return (*torques, stiffness, x, v_x, drive_x, y, v_y, drive_y)


def steps_of(time: Array, first: float | None) -> list[float]:
    """Step of each row without the rounding errors of the times, s. By default, the first step equals the second."""
    if len(time) < 2:
        return [first if first is not None else (float(time[0]) or 1e-3)]
    rounding = 4.0 * float(np.spacing(np.max(np.abs(time))))
    steps = np.diff(time)
    mean = float(steps.mean())
    if np.all(np.abs(steps - mean) <= rounding):
        lengths = [_simplest(mean, rounding / len(steps) + np.spacing(mean))] * len(steps)
    else:
        lengths = [_simplest(step, rounding) for step in steps.tolist()]
    return [lengths[0] if first is None else first, *lengths]


def _simplest(step: float, rounding: float) -> float:
    """Decimal number with the fewest digits that differs from `step` by at most `rounding`."""
    candidates = (float(f"{step:.{digits}g}") for digits in range(1, 17))
    return next((one for one in candidates if abs(one - step) <= rounding), step)
