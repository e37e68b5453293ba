"""The learner's model of a plant: its inverse dynamics, its linearisation, and what it expects of the next trial."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from asrsim.kinematics.engine_model import model_of
from asrsim.kinematics.inverse import InverseDynamics
from asrsim.kinematics.soft_arm import SoftArm
from asrsim.learning.linear import Linearised, linearise_along
from asrsim.learning.trial import Trial
from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.learning.plant import Plant


@dataclass(frozen=True, kw_only=True)
class ArmModel:
    """A plant and the soft arm of its scenario."""

    plant: Plant
    arm: SoftArm

    @property
    def delays(self) -> tuple[float, ...]:
        """s by which each joint's commands arrive late."""
        return tuple(self.arm.delay(joint) for joint in self.plant.joints)

    def inverse(self, outputs: Array) -> InverseDynamics:
        """Of link positions (n, joints)."""
        return self.arm.inverse(self.plant.time, self.plant.joints, outputs)

    def linear(self, inverse: InverseDynamics) -> Linearised:
        """The joints along a motion."""
        damping = [self.arm.losses(joint).damping for joint in self.plant.joints]
        motors = [drive.motors for drive in inverse.drives]
        return linearise_along(self.arm.model, self.plant.drives, inverse.motion, motors, damping)

    def expected(self, linear: Linearised, change: Array) -> Array:
        """(n, joints) change of the outputs for a change (n, joints) of the inputs, about a motion."""
        time = self.plant.time
        late = [np.interp(linear.time - delay, time, column, left=0.0) for column, delay in zip(change.T, self.delays, strict=True)]
        moved = linear.response(np.column_stack(late))
        return np.column_stack([np.interp(time, linear.time, column) for column in moved.T])

    def expect(self, trial: Trial, inputs: Array) -> Array:
        """(n, joints) outputs of the trial after `trial`: the change of its input through the joints linearised along it."""
        change = inputs - trial.inputs
        first = trial.outputs + self.expected(self.linear(self.inverse(trial.outputs)), change)
        # Half-way between the two motions the slopes are those of the whole change, to second order.
        half = self.linear(self.inverse(0.5 * (trial.outputs + first)))
        return np.asarray(trial.outputs + self.expected(half, change))


@contextmanager
def learning_model(plant: Plant) -> Iterator[ArmModel]:
    """The plant's model, with the scenario's parameters; released at the end."""
    from asrsim.scenario import apply_to_robot

    robot = apply_to_robot(plant.scenario, plant.robot)
    with model_of(plant.scenario, robot) as model:
        yield ArmModel(plant=plant, arm=SoftArm(scenario=plant.scenario, robot=robot, model=model))
