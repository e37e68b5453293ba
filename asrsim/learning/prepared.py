"""Preparation of learning: model of a plant, learning problem, learning law, and demands of the motion on the joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.rest import resting_motors
from asrsim.kinematics.inverse import Demand, InverseDynamics, SoftArm
from asrsim.learning.linear import Linearised, linearise_along, spring_slopes
from asrsim.learning.optimal import Lifted, NormOptimal
from asrsim.learning.plant import Plant
from asrsim.learning.trial import FixedGain, LearningLaw, LearningProblem, LearningResult
from asrsim.samples import Array
from asrsim.scenario.goals import Learning

FIXED_GAIN_KEYS = ("gain", "gain_decay", "joint_gains", "filter")
"""Keys of `ilc:` that have no effect if the law is `auto`."""
MOST_DEMANDS = 5
"""Largest number of demands beyond their limits that are printed before the first trial."""


@dataclass(frozen=True, kw_only=True)
class ArmModel:
    """A plant, and the model of its arm with soft joints.

    Driven joints that do not learn follow the scenario's references. These joints are soft, too. In the linearised arm, they
    come after the learned joints.
    """

    plant: Plant
    arm: SoftArm

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """Drives of the learned joints, followed by the drives of the other soft joints."""
        arm, learned = self.arm.drives, self.plant.joints
        followers = [drive for joint, drive in arm.items() if joint not in learned and all(drive.proportional)]
        return (*(arm[joint] for joint in learned), *followers)

    @property
    def delays(self) -> tuple[float, ...]:
        """Command delay of each learned joint, s."""
        return tuple(self.arm.delay(joint) + self.plant.delay for joint in self.plant.joints)

    @cached_property
    def inverse(self) -> InverseDynamics:
        """Inverse dynamics of the desired motion."""
        return self.arm.inverse(self.plant.time, self.plant.joints, self.plant.reference)

    @property
    def guess(self) -> Array:
        """Inputs (n, joints) with which the model follows the desired motion."""
        return self.inverse.inputs_at(self.plant.time, self.delays)

    @cached_property
    def linear(self) -> Linearised:
        """Arm linearised along the desired motion."""
        motion = self.inverse.motion
        columns = [self.arm.model.joints.index(drive.joint) for drive in self.drives]
        positions, motors = motion.positions[:, columns], [drive.motors for drive in self.inverse.drives]
        springs = np.zeros((len(positions), len(self.drives), max(drive.actuator.positions() for drive in self.drives)))
        for j, (drive, position) in enumerate(zip(self.drives, positions.T, strict=True)):
            if j >= len(motors):
                goals = drive.goals(np.stack([position, self.arm.preset(drive.joint, motion.time)]))
                motors.append(resting_motors([drive], position[None], goals[:, None])[0][: drive.actuator.positions(), 0].T)
            if drive.mode.spring:
                springs[:, j, : drive.actuator.positions()] = spring_slopes(drive, position, motors[j])
        damping = [self.arm.robot.joint(drive.joint).damping for drive in self.drives]
        return linearise_along(self.arm.model, self.drives, motion, springs, damping)

    @property
    def lifted(self) -> Lifted:
        """Lifted models of the arm along the desired motion."""
        return Lifted(self.plant.time, self.linear, self.delays, from_rest=self.plant.scenario.initial_equilibrium)


def learning_model(plant: Plant) -> ArmModel:
    """Model of a plant."""
    return ArmModel(
        plant=plant, arm=SoftArm(scenario=plant.scenario, robot=plant.prepared.robot, own_model=plant.prepared.model)
    )


@dataclass(frozen=True, kw_only=True)
class PreparedLearning:
    """A prepared learning problem, with all data that `learn` needs."""

    plant: Plant
    problem: LearningProblem
    settings: Learning
    """Settings of the scenario, with the selected first guess."""
    law: LearningLaw = field(repr=False)
    demands: tuple[Demand, ...]
    """Demands of the motion on the joints. The demand with the highest score comes first."""

    @property
    def before(self) -> list[str]:
        """Lines that are printed before the first trial."""
        lines = ["law auto: norm-optimal learning, with three models of the robot"]
        raw = self.plant.scenario.resolved.get("ilc") or {}
        idle = [key for key in FIXED_GAIN_KEYS if key in raw]
        if self.settings.law != "auto":
            gains = ", ".join(
                f"{self.settings.joint_gains.get(joint, self.settings.gain):.3g}" for joint in self.problem.joints
            )
            cutoff = "no filter" if self.settings.filter is None else f"filter {self.settings.filter.cutoff:.3g} Hz"
            lines = [f"law paper: gains {gains}, {cutoff}"]
        elif idle:
            lines.append(f"{', '.join(idle)}: these keys have no effect with law auto")
        beyond = [f"beyond its limit: {demand}" for demand in self.demands[:MOST_DEMANDS] if demand.score > 1.0]
        most = [f"the largest demand is {100 * one.score:.0f} % of its limit: {one}" for one in self.demands[:1]]
        return [*lines, *(beyond or most)]

    def reach(self, result: LearningResult) -> str:
        """Statement whether the joints can perform the motion, from trials that were simulated with all limits. Empty with the
        law `paper`.
        """
        if self.settings.law != "auto":
            return ""
        error = f"the largest error of the best simulated trial is {self.problem.worst(result.best)}"
        beyond = [str(demand) for demand in self.demands[:MOST_DEMANDS] if demand.score > 1.0]
        if result.converged:
            return f"within reach, although limits are exceeded: {'; '.join(beyond)}" if beyond else "within reach"
        if not beyond:
            # Friction or the initial state may cause the error. More trials may reduce such errors.
            return (
                f"not reached in {len(result.trials)} trials: {error}; no limit explains it, but friction or the initial "
                "state may cause it"
            )
        return f"out of reach: {error}; {'; '.join(beyond)}"


def prepare_learning(plant: Plant) -> PreparedLearning:
    """Learning problem of a plant."""
    model, learning = learning_model(plant), plant.learning
    settings = replace(learning, first_guess=learning.first_guess or ("inverse_dynamics" if learning.law == "auto" else "zero"))
    guesses: dict[str, Callable[[], Array]] = {
        "zero": lambda: np.zeros_like(plant.reference),
        "reference": plant.reference.copy,
        "inverse_dynamics": lambda: model.guess,
    }
    problem = LearningProblem(
        joints=plant.joints,
        units=tuple(map(plant.unit, plant.joints)),
        time=plant.time,
        reference=plant.reference,
        first_guess=guesses[settings.first_guess or "zero"](),
    )
    law: LearningLaw = FixedGain(problem, settings)
    if settings.law == "auto":
        law = NormOptimal(problem, model.lifted)
    return PreparedLearning(plant=plant, problem=problem, settings=settings, law=law, demands=model.inverse.demands)
