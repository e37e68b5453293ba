"""A scenario's robot as a soft arm: the inputs that move its joints as wanted, under the scenario's losses and loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.rest import resting_integrals, resting_motors
from asrsim.errors import Problem, ScenarioError
from asrsim.kinematics.desired import DesiredMotion, model_time, smooth_motion
from asrsim.kinematics.drive_forward import Start
from asrsim.kinematics.inverse import InverseDynamics, Losses, invert
from asrsim.kinematics.model import DynamicModel
from asrsim.robot import check_two_motors, drive_of
from asrsim.samples import Array
from asrsim.scenario.data import Scenario, for_joint

if TYPE_CHECKING:
    from asrsim.robot.model import Robot

INVERTED_MODES = (1, 3, 6)
"""Modes whose first reference is a position: of the link or of its equilibrium."""


@dataclass(frozen=True, kw_only=True)
class SoftArm:
    """The robot with the scenario's modes and parameters, and its rigid model. Raises RobotError for actuators with more than
    two motors."""

    scenario: Scenario
    robot: Robot
    model: DynamicModel

    def __post_init__(self) -> None:
        check_two_motors(self.robot, "inverse dynamics")

    @cached_property
    def drives(self) -> dict[str, Drive]:
        """Joint -> drive, for the joints whose first reference is a position."""
        return {block.joint: drive_of(block) for block in self.robot.actuators if block.mode in INVERTED_MODES}

    def losses(self, joint: str) -> Losses:
        """Damping and friction of the joint."""
        return Losses.of(self.robot, joint, for_joint(self.scenario.link_damping, joint))

    def preset(self, joint: str, time: Array) -> Array:
        """(n,) second reference; zeros in modes without one."""
        names = self.drives[joint].mode.references
        given = self.scenario.references_of(joint)
        return given[names[1]].values(time) if len(names) > 1 and names[1] in given else np.zeros(len(time))

    def external(self, joints: Sequence[str], time: Array) -> dict[str, Array]:
        """Joint -> (n,) N m, the scenario's external torques on the links at `time` (n,)."""
        signals = {joint: for_joint(self.scenario.external_torques, joint) for joint in joints}
        return {joint: signal.values(time) for joint, signal in signals.items() if signal is not None}

    def delay(self, joint: str) -> float:
        """s, delay of the joint's commands."""
        effects = for_joint(self.scenario.command_effects, joint)
        return 0.0 if effects is None else effects.delay

    def motors_at_start(self, joint: str, position: float, reference: float, preset: float) -> Start:
        """The joint's motors at the start of a run, with its link at `position` and these first references."""
        if self.scenario.initial_equilibrium:
            drive = self.drives[joint]
            resting = resting_motors(drive, position, drive.actuator.motor_references(reference, preset))
            return Start(resting, integrals=resting_integrals(drive, position, resting))
        positions = for_joint(self.scenario.initial_motor_positions, joint, (position,))
        velocities = for_joint(self.scenario.initial_motor_velocities, joint, (0.0,))
        # With one motor the second number is not used.
        return Start((positions[0], positions[-1]), (velocities[0], velocities[-1]))

    def motion(self, time: Array, joints: Sequence[str], positions: Array) -> DesiredMotion:
        """The motion of all joints of the model when `joints` move along `positions` (n, joints) at `time` (n,).

        Another driven joint follows its desired motion, else its reference. A joint without drive stays where it is.
        """
        grid = model_time(float(time[-1] - time[0]), float(time[1] - time[0])) + time[0]
        columns = []
        for joint in self.model.joints:
            if joint in joints:
                columns.append(np.interp(grid, time, positions[:, list(joints).index(joint)]))
                continue
            resting = for_joint(self.scenario.initial_positions, joint, 0.0)
            # With a learned input, the reference differs from the desired motion of the link.
            signal = for_joint(self.scenario.desired, joint)
            if signal is None and joint in self.drives:
                signal = self.scenario.references_of(joint).get(self.drives[joint].mode.references[0])
            columns.append(np.full(len(grid), resting) if signal is None else signal.values(grid))
        return smooth_motion(grid, np.column_stack(columns))

    def inverse(self, time: Array, joints: Sequence[str], positions: Array) -> InverseDynamics:
        """The inputs that move `joints` along `positions` (n, joints) at `time` (n,), and their demands on the drives.

        Raises ScenarioError for controllers without proportional gain.
        """
        chosen = [self.drives[joint] for joint in joints]
        idle = [drive.joint for drive in chosen if any(gain <= 0.0 for gain in drive.proportional)]
        if idle:
            message = "its controller has no proportional gain: no reference can move the joint"
            raise ScenarioError([Problem(message, key=f"parameters.{joint}", code="no-gain") for joint in idle])
        motion = self.motion(time, joints, positions)
        return invert(
            self.model,
            chosen,
            motion,
            {joint: self.preset(joint, motion.time) for joint in joints},
            {joint: self.losses(joint) for joint in joints},
            self.external(joints, motion.time),
        )
