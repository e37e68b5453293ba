"""Consequences of a time step for a robot: natural frequencies, and damping and gains near their limits of stability.

These are estimates with the inertia at the zero pose and a fixed base. The simulation uses exact mass matrices, implicit
damping of links, and substeps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.electric import electric_of
from asrsim.errors import Problem
from asrsim.robot.dynamics import RobotModel
from asrsim.robot.inertia import effective_inertia
from asrsim.robot.model import ActuatorBlock, Joint, Robot

UNSTABLE = 2.0
"""Limit of explicit damping: if decay rate times time step exceeds this number, the motion changes sign and grows."""


@dataclass(frozen=True, kw_only=True)
class StepFigures:
    """Stability figures of one joint at one time step; dimensionless unless stated."""

    joint: str
    inertia: float
    """Effective inertia at the zero pose, with all other joints free, kg m^2."""
    natural: float
    """Natural frequency of the link on its unloaded spring with locked motors, Hz; 0 without a spring. A stiffness adjuster
    has its typical value.
    """
    damping: float
    """Time step times damping of the URDF, divided by inertia; above 2, the toolbox's explicit damping diverges."""
    link_gain: float
    """Time step times sum of `ctrl_D` and link damping, divided by link inertia, in mode 1; above 2, the toolbox diverges."""
    motor_gain: float
    """Time step times sum of `ctrl_D` and motor damping, divided by motor inertia, in modes 5 and 6: the largest value of all
    motors. Above 2, the controllers diverge.
    """


def step_figures(robot: Robot, *, step: float) -> tuple[StepFigures, ...]:
    """Figures of all moving joints at a step in s, in file order."""
    effective = effective_inertia(RobotModel(robot).mass_matrix(np.zeros(len(robot.moving_joints)))).tolist()
    blocks = {block.joint: block for block in robot.actuators}
    joints = zip(robot.moving_joints, effective, strict=True)
    return tuple(_figures(joint, blocks.get(joint.name), inertia, step) for joint, inertia in joints)


def step_findings(robot: Robot, figures: Sequence[StepFigures], *, step: float) -> tuple[Problem, ...]:
    """Warnings about motor controllers that diverge at a step in s."""
    lines = {block.joint: block.line for block in robot.actuators}
    message = f"the motors' controllers diverge at a step of {step * 1e3:g} ms: h (ctrl_D + mot_D) / mot_J is above 2"
    return tuple(
        Problem(
            message, file=robot.path, line=lines[entry.joint], key=entry.joint, code="motor-gains",
            value=f"h (ctrl_D + mot_D) / mot_J = {entry.motor_gain:.3g}",
        )
        for entry in figures
        if entry.motor_gain > UNSTABLE
    )  # fmt: skip


def _figures(joint: Joint, block: ActuatorBlock | None, inertia: float, step: float) -> StepFigures:
    natural = motor_gain = link_gain = 0.0
    mobility = 1.0 / inertia if inertia > 0.0 else math.inf
    if block is not None:
        mode, values, actuator = MODES[block.mode], block.values(), ACTUATORS.get(block.actuator)
        if mode.spring:
            unloaded = actuator.motor_references(0.0, actuator.typical_preset)
            try:
                stiffness = actuator.stiffness(0.0, *unloaded, actuator.law_values(values))
            except ArithmeticError:  # impossible parameters, which `law_fault` reports
                stiffness = math.inf
            natural = math.sqrt(max(stiffness, 0.0) * mobility) / math.tau
        elif mode.controller:
            link_gain = step * (values["controller_1_derivative"] + joint.damping) * mobility
        for i in range(1, actuator.motors + 1) if mode.motor and mode.controller else ():
            electric = electric_of(values, i, mode)
            brake = electric.gain * values[f"controller_{i}_derivative"] + electric.lag + values[f"motor_{i}_damping"]
            motor_gain = max(motor_gain, step * brake / values[f"motor_{i}_inertia"])
    damping = joint.damping * step * mobility if joint.damping else 0.0
    return StepFigures(
        joint=joint.name, inertia=inertia, natural=natural, damping=damping, link_gain=link_gain, motor_gain=motor_gain
    )
