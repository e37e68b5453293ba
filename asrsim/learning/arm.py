"""The learner's model of a plant: its inverse dynamics, its linearisation, and what it expects of the next trial."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.kinematics.desired import DesiredMotion
from asrsim.kinematics.drive_forward import link_torque, motor_positions
from asrsim.kinematics.engine_model import model_of
from asrsim.kinematics.inverse import InverseDynamics
from asrsim.kinematics.soft_arm import SoftArm
from asrsim.learning.friction import Friction
from asrsim.learning.linear import CLIP, Linearised, chords, linearise_along, spring_slopes
from asrsim.learning.trial import Trial
from asrsim.samples import Array
from asrsim.scenario.data import for_joint

if TYPE_CHECKING:
    from asrsim.learning.plant import Plant

PASSES = 2
"""Times that a prediction is made again with the springs' mean slopes."""
FAR = 3.0
"""Factor between two guesses of a change beyond which the later one is not believed."""
LEAST = 1e-7
"""rad, change of a deflection over which a slope is taken at least."""


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
        motors += [self._motors(motion, j, positions[:, j], positions[:, j]) for j in range(len(motors), len(self.drives))]
        return self._linear(motion, self._springs(positions, np.stack(motors, axis=1)))

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
            states = [self.arm.motors_at_start(joint, position, 0.0, 0.0) for joint, position in starts]
            motors_begun = (np.array([getattr(state, name) for state in states]) for name in ("positions", "velocities"))
            begun = positions, velocities, *motors_begun
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

    def _linear(self, motion: DesiredMotion, springs: Array) -> Linearised:
        damping = [self.arm.losses(drive.joint).damping for drive in self.drives]
        return linearise_along(self.arm.model, self.drives, motion, springs, damping)

    def _springs(self, positions: Array, motors: Array, limit: float = CLIP) -> Array:
        """(n, joints, 2) slopes of the springs at motors (n, joints, 2)."""
        return self._each(
            lambda drive, column: spring_slopes(drive, positions[:, column], motors[:, column], limit), len(positions)
        )

    def _each(self, slopes: Callable[[Drive, int], Array], count: int) -> Array:
        """(n, joints, 2) something of each joint with springs; zeros for the others."""
        found = np.zeros((count, len(self.drives), 2))
        for column, drive in enumerate(self.drives):
            if drive.mode.spring:
                found[:, column] = slopes(drive, column)
        return found

    def expected(self, linear: Linearised, change: Array, friction: Friction | None = None) -> Array:
        """(n, joints) change of the outputs for a change (n, joints) of the inputs, about a motion."""
        late = self._late(linear.time, change)
        still = np.zeros((len(late), len(self.drives) - late.shape[1]))
        return self._learned(linear.time, linear.response(np.column_stack([late, still]), friction))

    def _late(self, time: Array, inputs: Array) -> Array:
        """(k, joints) inputs at `time` (k,) as they arrive, behind the commands' delays; before that the first value stands."""
        columns = zip(inputs.T, self.delays, strict=True)
        return np.column_stack([np.interp(time - delay, self.plant.time, column) for column, delay in columns])

    def expect(self, trial: Trial, inputs: Array) -> Array:
        """(n, joints) outputs of the trial after `trial`: the change of its input through the joints linearised along it.

        First with the slopes of the springs, then with their mean slopes over the change that those foretell.
        """
        base = self.state(trial.inputs, trial.outputs)
        friction = self.friction(base)
        linear = self._linear(base.motion, self._springs(base.positions, base.motors, 1.0))
        outputs = trial.outputs + self.expected(linear, inputs - trial.inputs, friction)
        for _ in range(PASSES):
            there = self.state(inputs, outputs)
            springs = self._chords(base, there)
            known = float(np.abs(outputs - trial.outputs).max())
            half = self.arm.motion(self.plant.time, self.plant.joints, 0.5 * (trial.outputs + outputs))
            change = self.expected(self._linear(half, springs), inputs - trial.inputs, friction)
            # Far beyond the first guess no linear model holds: that guess is kept.
            if not np.abs(change).max() <= FAR * known:
                break
            outputs = trial.outputs + change
        return np.asarray(outputs)

    def answers(self, trial: Trial) -> Callable[[Array], Array]:
        """Inputs (n, joints) -> the outputs expected of them, by the joints linearised along a trial, friction included."""
        base = self.state(trial.inputs, trial.outputs)
        linear, friction = self._linear(base.motion, self._springs(base.positions, base.motors, 1.0)), self.friction(base)
        return lambda inputs: np.asarray(trial.outputs + self.expected(linear, inputs - trial.inputs, friction))

    def _chords(self, base: TrialState, there: TrialState) -> Array:
        """(n, joints, 2) mean slopes of the springs between two trials."""
        one, other = (state.motors - state.positions[:, :, None] for state in (base, there))
        other = np.where(np.abs(other - one) < LEAST, one + LEAST, other)

        def of(drive: Drive, j: int) -> Array:
            return chords(drive, base.positions[:, j], base.motors[:, j], one[:, j], other[:, j])

        return self._each(of, len(base.positions))

    def _motors(self, motion: DesiredMotion, j: int, position: Array, given: Array) -> Array:
        """(n, 2) rad where the motors of drive `j` stand, its link at `position` (n,) and its first reference `given` (n,)."""
        drive = self.drives[j]
        preset = self.arm.preset(drive.joint, motion.time)
        start = self.arm.motors_at_start(drive.joint, position[0], given[0], preset[0])
        return motor_positions(drive, motion.time, position, given, preset, start)

    def state(self, inputs: Array, outputs: Array) -> TrialState:
        """Where motors stand in a trial with `inputs` and `outputs`, (n, joints) each."""
        motion = self.arm.motion(self.plant.time, self.plant.joints, outputs)
        positions = motion.positions[:, self._columns]
        arriving = np.column_stack([self._late(motion.time, inputs), positions[:, len(self.plant.joints) :]])
        motors = [self._motors(motion, j, positions[:, j], arriving[:, j]) for j in range(len(self.drives))]
        return TrialState(motion=motion, inputs=arriving, positions=positions, motors=np.stack(motors, axis=1))

    def friction(self, state: TrialState) -> Friction:
        """What friction did in a trial: what the drives gave and the links did not take."""
        motion, columns = state.motion, self._columns
        losses = [self.arm.losses(drive.joint) for drive in self.drives]
        # Followers' friction is left out: their motion was not recorded.
        level = self._among(np.array([loss.friction for loss in losses[: len(self.plant.joints)]]))
        speeds = motion.velocities[:, columns]
        torques = np.zeros_like(speeds)
        if level.any():
            rigid = self.arm.model.inverse_dynamics(motion.positions, motion.velocities, motion.accelerations)[:, columns]
            given = [
                link_torque(drive, state.positions[:, j], speeds[:, j], state.motors[:, j], state.inputs[:, j])
                for j, drive in enumerate(self.drives)
            ]
            external = self.arm.external([drive.joint for drive in self.drives], motion.time)
            given = [torque + external.get(drive.joint, 0.0) for drive, torque in zip(self.drives, given, strict=True)]
            torques = np.column_stack(given) - rigid - speeds * [loss.damping for loss in losses]
        middle = 0.5 * (torques[1:] + torques[:-1])
        return Friction(level=level, velocities=0.5 * (speeds[1:] + speeds[:-1]), torques=np.clip(middle, -level, level))


@dataclass(frozen=True, kw_only=True)
class TrialState:
    """What a trial's inputs and outputs tell of the whole arm; k samples on the model's grid."""

    motion: DesiredMotion
    inputs: Array
    """(k, drives) as they arrive; followers' references."""
    positions: Array
    """(k, drives) rad."""
    motors: Array
    """(k, drives, 2) rad."""


@contextmanager
def learning_model(plant: Plant) -> Iterator[ArmModel]:
    """The plant's model, with the scenario's parameters; released at the end."""
    from asrsim.scenario import apply_to_robot

    robot = apply_to_robot(plant.scenario, plant.robot)
    with model_of(plant.scenario, robot) as model:
        yield ArmModel(plant=plant, arm=SoftArm(scenario=plant.scenario, robot=robot, model=model))
