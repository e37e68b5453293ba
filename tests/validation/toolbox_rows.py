"""Row-by-row driver of a joint with toolbox stepping: link motion and references in, torques and motor states out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from asrsim.registry.steppings import STEPPINGS
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.simulation.drives import SteppedJoint, make_drives
from asrsim.simulation.fields import JointState, Scheme
from asrsim.simulation.interpreted import bound_law
from asrsim.simulation.joint import advance
from asrsim.simulation.released import released_step
from asrsim.simulation.rows import constants_of, kind_of, start_of
from asrsim.simulation.shape import shape_of

OUTPUTS = (
    "link_torque", "elastic_torque_1", "elastic_torque_2", "stiffness",
    "motor_1_position", "motor_1_velocity", "motor_1_effort", "motor_2_position", "motor_2_velocity", "motor_2_effort",
)  # fmt: skip
"""Names of the outputs. As in the released code, modes without a spring give NaN for springs and 0 for motors."""


def toolbox_rows(robot: Robot, motion: Array, step: float, first_step: float) -> dict[str, Array]:
    """Values (n,) of each output of the robot's only joint. motion: (n, 4) position, velocity, first and second reference."""
    (drive,) = make_drives(robot, STEPPINGS["toolbox"], Scenario(name="toolbox", robot=robot.path))
    shape = shape_of([drive])
    k = kind_of(drive, shape, ())
    p = constants_of(drive, shape, (), motor_substeps=1, cutoff=False)
    actuator: Any = drive.actuator
    if actuator is not None and drive.mode is not None and drive.mode.spring:
        k.spring_law = bound_law(actuator, drive.positions)
    k.joint_step = released_step
    s = start_of(drive, shape, drive.initial_position, 0.0)
    goals = drive.goals(motion[:, 2:].T[: max(shape.motors, 2)]).T.tolist()
    rows = []
    for row, ((q, v, *_), goal) in enumerate(zip(motion.tolist(), goals, strict=True)):
        h = step if row else first_step
        s.position, s.engine_velocity = q, v
        before = [motor.position for motor in s.motors[:2]]
        stepping = drive.stepping
        z = Scheme(
            step=h,
            weight_now=1.0,
            weight_last=0.0,
            first_drift=stepping.first_drift,
            implicitness=stepping.implicitness,
            link_implicitness=0.0,
            staggered=0.0,
        )
        advance(s, p, k, z, [0.0, *goal], h, True, False)
        rows.append((s.now.torque, *_outputs(drive, q, before, s)))
    return dict(zip(OUTPUTS, np.array(rows).T, strict=True))


def _outputs(drive: SteppedJoint, q: float, before: Sequence[float], s: JointState) -> tuple[float, ...]:
    actuator, mode = drive.actuator, drive.mode
    if actuator is None or mode is None or not mode.spring:
        return (math.nan, math.nan, math.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    first, second = s.motors[:2]
    x, y = first.kick_position, second.kick_position
    law: Any = actuator.stiffness
    # In mode 4 the released code computes the stiffness at the motors' positions before the step.
    stiffness = law(q, *(before if mode.number == 4 else (x, y)), drive.elastic)
    x, y = (x, y) if mode.motor else (0.0, 0.0)
    return (first.load, second.load, stiffness, x, first.mean_velocity, first.torque, y, second.mean_velocity, second.torque)
