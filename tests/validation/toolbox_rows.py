"""Row-by-row driver of a joint with toolbox stepping: link motion and references in, torques and motor states out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.simulation.drives import SteppedJoint, make_drives
from asrsim.simulation.kernel import advance
from asrsim.simulation.laws import bound_law
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
from asrsim.simulation.rows import constants_of, kind_of, shape_of, start_of
from asrsim.simulation.steppings import STEPPINGS

OUTPUTS = (
    "link_torque", "elastic_torque_1", "elastic_torque_2", "stiffness",
    "motor_1_position", "motor_1_velocity", "motor_1_effort", "motor_2_position", "motor_2_velocity", "motor_2_effort",
)  # fmt: skip
"""Names of the outputs. As in the released code, modes without a spring give NaN for springs and 0 for motors."""


def toolbox_rows(robot: Robot, motion: Array, step: float, first_step: float) -> dict[str, Array]:
    """Values (n,) of each output of the robot's only joint. motion: (n, 4) position, velocity, first and second reference."""
    (drive,) = make_drives(robot, STEPPINGS.get("toolbox"), Scenario(name="toolbox", robot=robot.path))
    shape = shape_of([drive])
    k: list[Any] = kind_of(drive, shape)
    p = constants_of(drive, shape, motor_substeps=1, cutoff=False)
    actuator: Any = drive.actuator
    if actuator is not None and drive.mode is not None and drive.mode.spring:
        k[SPRING_LAW] = bound_law(actuator, drive.positions)
    k[JOINT_STEP] = drive.stepping.joint_step
    s = start_of(drive, shape, drive.initial_position, 0.0)
    goals = drive.goals(motion[:, 2:].T[: max(shape.motors, 2)]).T.tolist()
    rows = []
    for row, ((q, v, *_), goal) in enumerate(zip(motion.tolist(), goals, strict=True)):
        h = step if row else first_step
        s[POSITION], s[ENGINE_VELOCITY] = q, v
        before = [s[FIRST_MOTOR + i * PER_MOTOR + MOTOR_POSITION] for i in range(2)]
        z = (h, 1.0, 0.0, drive.stepping.first_drift, drive.stepping.implicitness, 0.0, 0.0)
        advance(s, p, k, z, [0.0, *goal], h, True, False)
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
