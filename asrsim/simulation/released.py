"""The released toolbox's order of a step, reproduced bit for bit wherever the released code has a defined result, so that old
runs can be reproduced.

The semi-implicit Euler method integrates the motors. In modes 5 and 6, the spring's torque on a motor is computed from the
motors' old positions, and the torque on the link is computed from their new positions; this scheme is not passive. Actuators
with one motor also have the second motor that the released code integrates. In the SEA the second motor drives nothing; in
AwAS-II the second motor moves the adjuster, with constants of the released class.

Faults of the released code are *not* reproduced if their effect is undefined or useless. In asrsim, position references before
the first command equal the initial position, and torque references are 0; the load on AwAS-II's second motor is 0; the first
step is as long as the second; mode 4 does not overwrite its own reference; `inf` limits are infinite; constant arithmetic in
tags is evaluated.
"""

from __future__ import annotations

import math
from typing import Any

from asrsim.actuators.motor import MotorConstants
from asrsim.actuators.parameters import FRICTION_STIFFNESS
from asrsim.scenario.kinds import RELEASED_MOTORS
from asrsim.simulation.fields import JointConstants, JointKind, JointState, MotorState
from asrsim.simulation.laws import drive_of, motor_of, spring_law
from asrsim.simulation.layout import GOALS, TASK

PHANTOM = {"inertia": 0.0233, "damping": 0.2698, "limit": 6.0, "low": -math.inf, "high": math.inf}
"""Constants of the released DCMotor class, which simulates a second motor for every actuator. Units: inertia kg m^2, damping N
m s/rad, limit (torque) N m, low and high (positions) rad.
"""
PHANTOM_SEA = {"coulomb": 0.02, "proportional": 125.0, "integral": 0.0, "derivative": 4.5}
"""Constants of the second motor that the released SEA plugin updates, although it drives nothing: friction in N m, PID gains in
N m/rad, N m/(rad s) and N m s/rad.
"""
PHANTOM_AWAS_II = {"coulomb": 0.5, "proportional": 164.0, "integral": 0.0, "derivative": 41.0}
"""Constants of the second motor that the released AwAS-II plugin updates: friction in N m, PID gains in N m/rad, N m/(rad s)
and N m s/rad.
"""


def released_step(joint: JointState, link: JointConstants, kind: JointKind, u: Any, h: float, note: int) -> None:
    """Advance a joint by h s in the released order; see `asrsim.simulation.joint.advance`."""
    if kind.sprung:
        _springs(joint, link, kind, u, h)
    elif kind.controlled:
        error = u[GOALS] - joint.position
        joint.integral += link.integral * error * h
        joint.now.torque = joint.integral + link.proportional * error + link.derivative * (0.0 - joint.engine_velocity)
    elif kind.direct:
        joint.now.torque = u[GOALS]
    else:
        joint.now.torque = 0.0


def _springs(joint: JointState, link: JointConstants, kind: JointKind, u: Any, h: float) -> None:
    moving = kind.dynamic > 0
    controlled = moving and drive_of(link, 0).hold != 0.0
    for i in range(RELEASED_MOTORS):
        motor = motor_of(joint, i)
        motor.theta = motor.position if moving else u[GOALS + i]
    spring_law(kind.spring_law, joint, link, kind, joint.position, TASK.torques)
    for i in range(RELEASED_MOTORS):
        motor = motor_of(joint, i)
        if moving:
            _move(motor, drive_of(link, i), u[GOALS + i], motor.pull, controlled, h)
            motor.theta = motor.position
        motor.kick_position = motor.theta
    if controlled:
        spring_law(kind.spring_law, joint, link, kind, joint.position, TASK.torques)
    for i in range(RELEASED_MOTORS):
        motor = motor_of(joint, i)
        motor.load = motor.pull
    joint.now.torque = motor_of(joint, 0).pull + motor_of(joint, 1).pull


def _move(motor: MotorState, drive: MotorConstants, goal: float, load: float, controlled: bool, h: float) -> None:
    """Update a motor as the released DCMotor does: controller, friction at the old position, acceleration, velocity, position,
    limits. The torque that is recorded is NaN at a limit.
    """
    position, velocity, push = motor.position, motor.velocity, goal
    if controlled:
        error = goal - position
        motor.integral += drive.integral * error * h
        push = motor.integral + drive.proportional * error + drive.derivative * (0.0 - velocity)
    if push > drive.limit:
        push = drive.limit
    elif push < -drive.limit:
        push = -drive.limit
    slip = drive.coulomb / FRICTION_STIFFNESS
    if position - motor.anchor > slip:
        motor.anchor = position - slip
    elif position - motor.anchor < -slip:
        motor.anchor = position + slip
    friction = FRICTION_STIFFNESS * (position - motor.anchor)
    before = position
    velocity = velocity + (push - load - friction - drive.damping * velocity) / drive.inertia * h
    position = position + velocity * h
    if position > drive.high or position < drive.low:
        position = drive.high if position > drive.high else drive.low
        velocity, push = 0.0, math.nan
        motor.at_limit = 2.0
    way = position - before
    motor.row_work.drive = 0.5 * (motor.torque + push) * way
    motor.row_work.loss = (0.5 * (motor.friction + friction) + drive.damping * velocity) * way
    motor.position, motor.velocity, motor.mean_velocity = position, velocity, velocity
    motor.torque, motor.friction = push, friction
