"""Model of a plant for learning: inverse dynamics and linearisation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.rest import resting_motors
from asrsim.kinematics.inverse import InverseDynamics, SoftArm
from asrsim.learning.linear import Linearised, linearise_along, spring_slopes
from asrsim.learning.optimal import Lifted
from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.learning.plant import Plant


@dataclass(frozen=True, kw_only=True)
class ArmModel:
    """A plant and the model of its arm with soft joints.

    Driven joints that do not learn follow their own references. These joints are soft too, and come after the learned joints in
    the linearised arm.
    """

    plant: Plant
    arm: SoftArm

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """Drives of the learned joints, then drives of the other soft joints."""
        arm, learned = self.arm.drives, self.plant.joints
        followers = [drive for joint, drive in arm.items() if joint not in learned and all(drive.proportional)]
        return (*(arm[joint] for joint in learned), *followers)

    @property
    def delays(self) -> tuple[float, ...]:
        """Delay of each learned joint's commands, s."""
        return tuple(self.arm.delay(joint) + self.plant.delay for joint in self.plant.joints)

    @cached_property
    def inverse(self) -> InverseDynamics:
        """Inverse dynamics of the desired motion."""
        return self.arm.inverse(self.plant.time, self.plant.joints, self.plant.reference)

    @property
    def guess(self) -> Array:
        """Inputs (n, joints) that move the model along the desired motion."""
        return self.inverse.inputs_at(self.plant.time, self.delays)

    @cached_property
    def linear(self) -> Linearised:
        """Arm linearised along the desired motion."""
        motion = self.inverse.motion
        columns = [self.arm.model.joints.index(drive.joint) for drive in self.drives]
        positions, motors = motion.positions[:, columns], [drive.motors for drive in self.inverse.drives]
        springs = np.zeros((len(positions), len(self.drives), 2))
        for j, (drive, position) in enumerate(zip(self.drives, positions.T, strict=True)):
            if j >= len(motors):
                goals = drive.goals(np.stack([position, self.arm.preset(drive.joint, motion.time)]))
                motors.append(resting_motors(drive, position, goals)[0][:2].T)
            if drive.mode.spring:
                springs[:, j] = spring_slopes(drive, position, motors[j])
        damping = [self.arm.robot.joint(drive.joint).damping for drive in self.drives]
        return linearise_along(self.arm.model, self.drives, motion, springs, damping)

    @property
    def lifted(self) -> Lifted:
        """Lifted models of the arm along the desired motion."""
        return Lifted(self.plant.time, self.linear, self.delays, from_rest=self.plant.scenario.initial_equilibrium)


def learning_model(plant: Plant) -> ArmModel:
    """Model of a plant."""
    return ArmModel(plant=plant, arm=SoftArm(scenario=plant.scenario, robot=plant.prepared.robot))
