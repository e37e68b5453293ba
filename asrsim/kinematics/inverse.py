"""Inverse dynamics of soft joints: the input for a desired motion, and the demands of the motion on the drives.

The link torques are tau = RNEA(q, dq, ddq) + c dq + F tanh(dq / 0.02) - tau_external, with damping c and friction F. The
inverse model of each joint's drive then gives the input.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.vectorised import over_arrays
from asrsim.errors import Problem, ScenarioError
from asrsim.kinematics.drive_inverse import (
    SLOW,
    DesiredMotion,
    DriveMotion,
    drive_backwards,
    knot_distance,
    model_time,
    smooth_motion,
)
from asrsim.quantities import linear_unit
from asrsim.robot import drive_of
from asrsim.robot.dynamics import RobotModel, robot_model
from asrsim.robot.model import Joint, Robot
from asrsim.samples import Array
from asrsim.scenario.data import LinkDamping, Scenario, for_joint
from asrsim.scenario.starts import start_positions

INVERTED_MODES = (1, 3, 6)
"""Modes whose first reference is a position of the link or an equilibrium position."""
START = 0.1
"""Length of the initial interval in which demands are not checked, s. Motors that start unloaded must first take up their load.
The last two knots of the splines are not checked either, since the derivatives are inaccurate there."""


@dataclass(frozen=True, kw_only=True)
class Demand:
    """Largest demand of a motion on a component of a joint (motor, spring or stop), and the limit of this component."""

    joint: str
    what: str
    """Name of the demand: `motor torque`, `motor speed`, `spring deflection`, `spring torque`, `joint effort` or `joint
    stop`."""
    needed: float
    limit: float
    unit: str
    time: float
    """Instant of the largest value, s."""
    score: float
    """Largest value divided by the limit; 2 if the motion passes a joint stop. Above 1 the drive cannot follow the motion."""
    motor: int = 0
    """Number of the motor, from 1; 0 if the demand does not concern a motor."""

    def __str__(self) -> str:
        which = f" of motor {self.motor}" if self.motor else ""
        return (
            f"{self.joint} at {self.time:.3g} s: {self.what}{which} {abs(self.needed):.3g} {self.unit}, "
            f"limit {self.limit:.3g} {self.unit}"
        )


@dataclass(frozen=True, kw_only=True)
class InverseDynamics:
    """Input for a desired motion, with its demands on motors, springs and joints."""

    motion: DesiredMotion
    """Desired motion of the model's joints."""
    drives: tuple[DriveMotion, ...] = field(repr=False)
    demands: tuple[Demand, ...]
    """Demands on all components of all joints, the highest score first."""

    def inputs_at(self, time: Array, delays: Sequence[float]) -> Array:
        """Inputs (k, joints) at `time` (k,), advanced by the delays of the commands in s; constant before the first and after
        the last sample."""
        from scipy.interpolate import CubicSpline

        own = self.motion.time
        columns = [
            CubicSpline(own, drive.inputs)(np.clip(time + delay, own[0], own[-1]))
            for drive, delay in zip(self.drives, delays, strict=True)
        ]
        return np.column_stack(columns)


@dataclass(frozen=True, kw_only=True)
class SoftArm:
    """A scenario's robot with the scenario's modes and parameters, and its rigid model."""

    scenario: Scenario
    robot: Robot
    own_model: RobotModel | None = field(default=None, repr=False, compare=False)
    """Model with the masses and forces of an engine; None: a model with the masses of the robot file is made."""

    @cached_property
    def model(self) -> RobotModel:
        """Rigid-body model of the robot on its base."""
        return self.own_model or robot_model(self.scenario, self.robot)

    @cached_property
    def drives(self) -> dict[str, Drive]:
        """Drives by joint, for the joints whose first reference is a position."""
        return {block.joint: drive_of(block) for block in self.robot.actuators if block.mode in INVERTED_MODES}

    def preset(self, joint: str, time: Array) -> Array:
        """Second reference (n,) of the joint; zeros in modes without a second reference."""
        names = self.drives[joint].mode.references
        given = self.scenario.references_of(joint)
        return given[names[1]].values(time) if len(names) > 1 and names[1] in given else np.zeros(len(time))

    def delay(self, joint: str) -> float:
        """Delay of the joint's commands in s."""
        imperfections = for_joint(self.scenario.command_imperfections, joint)
        return 0.0 if imperfections is None else imperfections.delay

    def motion(self, time: Array, joints: Sequence[str], positions: Array) -> DesiredMotion:
        """Motion of all joints of the model while `joints` move along `positions` (n, joints) at `time` (n,).

        Other driven joints follow their desired motions, or their references. Joints without a drive do not move.
        """
        grid = model_time(float(time[-1] - time[0]), float(time[1] - time[0])) + time[0]
        columns = []
        starts = start_positions(self.scenario, self.robot)
        for joint in self.model.joints:
            if joint in joints:
                columns.append(np.interp(grid, time, positions[:, list(joints).index(joint)]))
                continue
            resting = starts[joint]
            # Use the desired motion if the scenario states one, since a learned reference differs from the desired motion.
            signal = for_joint(self.scenario.desired, joint)
            if signal is None and joint in self.drives:
                signal = self.scenario.references_of(joint).get(self.drives[joint].mode.references[0])
            columns.append(np.full(len(grid), resting) if signal is None else signal.values(grid))
        return smooth_motion(grid, self.model.couplings.expand(np.column_stack(columns)))

    def inverse(self, time: Array, joints: Sequence[str], positions: Array) -> InverseDynamics:
        """Inputs that move `joints` along `positions` (n, joints) at `time` (n,), and the demands of this motion on the drives.

        Raises ScenarioError for controllers without proportional gain.
        """
        chosen = [self.drives[joint] for joint in joints]
        idle = [drive.joint for drive in chosen if any(gain <= 0.0 for gain in drive.proportional)]
        if idle:
            message = "its controller has no proportional gain: no reference can move the joint"
            raise ScenarioError([Problem(message, key=f"parameters.{joint}", code="no-gain") for joint in idle])
        motion = self.motion(time, joints, positions)
        rigid = self.model.inverse_dynamics(motion.positions, motion.velocities, motion.accelerations)
        moving = [self.robot.joint(name) for name in self.model.joints]
        damping, friction = np.array([[joint.damping, joint.friction] for joint in moving]).T
        rigid = rigid + damping * motion.velocities + friction * np.tanh(motion.velocities / SLOW)
        rigid = self.model.couplings.fold(rigid, motion.positions)
        found, demands = [], []
        for drive in chosen:
            column, joint = self.model.joints.index(drive.joint), self.robot.joint(drive.joint)
            position, velocity = motion.positions[:, column], motion.velocities[:, column]
            torque = rigid[:, column]
            external = for_joint(self.scenario.external_torques, drive.joint)
            if external is not None:
                torque = torque - external.values(motion.time)
            preset = self.preset(drive.joint, motion.time)
            item = drive_backwards(drive, motion.time, position, velocity, torque, preset)
            law = for_joint(self.scenario.link_damping, drive.joint)
            if law is not None:
                # One iteration is enough, since the damping torque hardly changes the stiffness on which the damping depends.
                torque = torque + _link_damping(drive, law, position, item) * velocity
                item = drive_backwards(drive, motion.time, position, velocity, torque, preset)
            found.append(item)
            demands += demands_of(drive, motion.time, position, torque, item, joint)
        demands.sort(key=lambda demand: -demand.score)
        return InverseDynamics(motion=motion, drives=tuple(found), demands=tuple(demands))


def _link_damping(drive: Drive, law: LinkDamping, position: Array, item: DriveMotion) -> Array:
    """Viscous damping (n,) of the link at each instant, N m s/rad."""
    if not drive.mode.spring:
        return np.full(len(position), law.constant)
    stiffness = over_arrays(drive.actuator.stiffness)(position, *item.motors.T, drive.elastic)
    return np.asarray(law.constant + 2.0 * law.ratio * np.sqrt(law.inertia * np.maximum(stiffness, 0.0)))


def demands_of(drive: Drive, time: Array, position: Array, torque: Array, item: DriveMotion, joint: Joint) -> list[Demand]:
    """Largest demand of the motion on each component of a joint."""
    length = float(time[-1] - time[0])
    judged = (time >= time[0] + min(START, 0.2 * length)) & (time <= time[-1] - 2.0 * knot_distance(length))
    rows: list[tuple[str, int, str, Array, Array | float]] = [("joint effort", 0, "N m", torque, joint.most_effort)]
    for motor, most in enumerate(drive.max_torque if drive.mode.motor else ()):
        rate = np.gradient(item.motors[:, motor], time)
        rows.append(("motor torque", motor + 1, "N m", item.motor_torques[:, motor], most))
        rows.append(("motor speed", motor + 1, "rad/s", rate, drive.max_velocity[motor]))
    if drive.mode.spring:
        # Compare the smaller of the two spring deflections with the limit. While one spring is below its limit, the joint is
        # still compliant.
        deflections = np.abs(item.motors[:, : drive.actuator.motors] - position[:, None]).min(axis=1)
        rows.append(("spring torque", 0, "N m", torque, item.holdable))
        rows.append(("spring deflection", 0, "rad", deflections, drive.max_deflection))
    found: list[Demand] = []

    def add(what: str, motor: int, unit: str, needed: Array, limits: Array, scores: Array) -> None:
        worst = int(np.argmax(scores))
        found.append(
            Demand(
                joint=drive.joint,
                what=what,
                motor=motor,
                unit=linear_unit(unit) if joint.kind == "prismatic" else unit,
                needed=float(needed[worst]),
                limit=float(limits[worst]),
                time=float(time[worst]),
                score=float(scores[worst]),
            )
        )

    for what, motor, unit, needed, limit in rows:
        limits = np.broadcast_to(np.abs(limit), needed.shape)
        with np.errstate(all="ignore"):
            scores = np.nan_to_num(np.abs(needed) / limits, nan=0.0, posinf=np.inf)
        add(what, motor, unit, needed, limits, np.where(judged, scores, -1.0))
    within = np.clip(position, *joint.stops)
    beyond = np.abs(position - within)
    if beyond.max() > 1e-3:
        add("joint stop", 0, "rad", position, within, np.where(beyond == beyond.max(), 2.0, 0.0))
    return found
