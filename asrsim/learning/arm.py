"""The learner's model of a plant: its inverse dynamics and its linearisation."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.rest import resting_motors
from asrsim.kinematics.desired import DesiredMotion
from asrsim.kinematics.engine_model import model_of
from asrsim.kinematics.inverse import InverseDynamics, SoftArm
from asrsim.learning.linear import Linearised, linearise_along, spring_slopes
from asrsim.samples import Array
from asrsim.scenario.data import for_joint

if TYPE_CHECKING:
    from asrsim.learning.plant import Plant


@dataclass(frozen=True, kw_only=True)
class ArmModel:
    """A plant and the soft arm of its scenario.

    Joints that are driven and do not learn follow their own references, but are as soft: they stand behind the learned ones
    wherever the arm is linearised.
    """

    plant: Plant
    arm: SoftArm

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """The learned joints' drives, then the followers'."""
        followers = [
            drive for joint, drive in self.arm.drives.items() if joint not in self.plant.joints and all(drive.proportional)
        ]
        return (*self.plant.drives, *followers)

    def of(self, plant: Plant) -> ArmModel:
        """The model of the plant with other references."""
        return ArmModel(plant=plant, arm=replace(self.arm, scenario=plant.scenario))

    @property
    def delays(self) -> tuple[float, ...]:
        """s by which each joint's commands arrive late."""
        return tuple(self.arm.delay(joint) for joint in self.plant.joints)

    def inverse(self, outputs: Array) -> InverseDynamics:
        """Of link positions (n, joints)."""
        return self.arm.inverse(self.plant.time, self.plant.joints, outputs)

    def linear(self, inverse: InverseDynamics) -> Linearised:
        """The joints along a motion."""
        motion, positions = inverse.motion, inverse.motion.positions[:, self._columns]
        motors = [drive.motors for drive in inverse.drives]
        motors += [self._motors(motion, j, positions[:, j]) for j in range(len(motors), len(self.drives))]
        springs = np.zeros((len(positions), len(self.drives), 2))
        for j, drive in enumerate(self.drives):
            if drive.mode.spring:
                springs[:, j] = spring_slopes(drive, positions[:, j], motors[j])
        damping = [self.arm.robot.joint(drive.joint).damping for drive in self.drives]
        return linearise_along(self.arm.model, self.drives, motion, springs, damping)

    def start_error(self, inverse: InverseDynamics, linear: Linearised) -> Array:
        """(n, joints) rad by which a run that starts as the scenario says is off the motion, if nothing is done about it."""
        motion, scenario, columns = inverse.motion, self.plant.scenario, self._columns[: len(self.plant.joints)]
        motors = np.nan_to_num(np.stack([drive.motors[:2] for drive in inverse.drives], axis=1))
        wanted = motion.positions[0, columns], motion.velocities[0, columns], motors[0], (motors[1] - motors[0]) / motion.step
        if scenario.initial_equilibrium:
            # The first inputs hold the links where the motion begins.
            begun: tuple[Array, ...] = wanted[0], np.zeros(len(columns)), wanted[2], np.zeros((len(columns), 2))
        else:
            positions, velocities = (
                np.array([for_joint(values, joint, 0.0) for joint in self.plant.joints])
                for values in (scenario.initial_positions, scenario.initial_velocities)
            )
            starts = zip(self.plant.joints, positions, strict=True)
            # With one motor the second number is not used.
            states = [
                (for_joint(scenario.initial_motor_positions, joint, (position,)),
                 for_joint(scenario.initial_motor_velocities, joint, (0.0,)))
                for joint, position in starts
            ]  # fmt: skip
            begun = (
                positions,
                velocities,
                *(np.array([(one[0], one[-1]) for one in each]) for each in zip(*states, strict=True)),
            )
        moved = linear.released(*(self._among(is_ - should) for is_, should in zip(begun, wanted, strict=True)))
        return self._learned(linear.time, moved)

    @property
    def _columns(self) -> list[int]:
        """Places of the drives' joints among the model's."""
        return [self.arm.model.joints.index(drive.joint) for drive in self.drives]

    def _among(self, values: Array) -> Array:
        """Values of the learned joints (joints, ...) among those of all drives: nothing of the followers."""
        return np.concatenate([values, np.zeros((len(self.drives) - len(values), *values.shape[1:]))])

    def _learned(self, time: Array, values: Array) -> Array:
        """(n, joints) at the plant's times, of values (k, drives) at `time` (k,)."""
        return np.column_stack([np.interp(self.plant.time, time, column) for column in values.T[: len(self.plant.joints)]])

    def _motors(self, motion: DesiredMotion, j: int, position: Array) -> Array:
        """(n, 2) rad: positions of rest of the motors of drive `j`, whose link follows its first reference, `position` (n,)."""
        drive = self.drives[j]
        goals = drive.goals(np.stack([position, self.arm.preset(drive.joint, motion.time)]))
        return resting_motors(drive, position, goals)[:2].T


@contextmanager
def learning_model(plant: Plant) -> Iterator[ArmModel]:
    """The plant's model, with the scenario's parameters; released at the end."""
    from asrsim.scenario import apply_to_robot

    robot = apply_to_robot(plant.scenario, plant.robot)
    with model_of(plant.scenario, robot) as model:
        yield ArmModel(plant=plant, arm=SoftArm(scenario=plant.scenario, robot=robot, model=model))
