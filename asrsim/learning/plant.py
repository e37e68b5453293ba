"""The simulated robot as a plant for learning: inputs in, link positions out, and the problem that a scenario states."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.actuators import MODES
from asrsim.errors import DivergenceError, Problem, ScenarioError
from asrsim.kinematics.compensation import JointDrive, LoadError, drive_of, equilibrium_for_load
from asrsim.kinematics.engine_model import EngineModel, model_of
from asrsim.learning.folder import origin_of
from asrsim.learning.iterate import LearningProblem, Predict
from asrsim.learning.linear import JointDynamics, choose_gains
from asrsim.learning.prediction import postures, predictor
from asrsim.learning.settings import LearningSettings, parse_settings, wants_model_gains
from asrsim.samples import Array
from asrsim.scenario.data import Scenario, for_joint
from asrsim.signals.sampled import Sampled

if TYPE_CHECKING:
    from asrsim.robot.model import Robot
    from asrsim.simulation.run import Run, Sink

LEARNED_MODES = (1, 3, 6)
"""Modes whose first reference is a position of the link or of its equilibrium."""
GUESS_KNOTS = 201
"""Samples of the trajectory at which gravity is compensated for the first guess; between, straight lines."""


@dataclass(frozen=True, kw_only=True)
class Plant:
    """A robot in a scenario whose `ilc:` block says what it is to learn."""

    scenario: Scenario
    robot: Robot = field(repr=False)
    """As its file says; the scenario's modes and parameters are applied at each run."""
    joints: tuple[str, ...]
    time: Array = field(repr=False)
    """(n,) s, the steps of the simulation."""
    reference: Array = field(repr=False)
    """(n, joints) rad."""
    drives: tuple[JointDrive, ...] = field(repr=False)
    presets: tuple[float, ...]
    """Second references at the start."""
    damping: Mapping[str, float] = field(repr=False)
    """N m s/rad of the links by joint."""

    def with_inputs(self, inputs: Array, log_every: int = 1) -> Scenario:
        """The scenario that plays `inputs` (n, joints)."""
        references = dict(self.scenario.references)
        for column, (joint, drive) in enumerate(zip(self.joints, self.drives, strict=True)):
            name = MODES[drive.mode].references[0]
            signal = Sampled(times=self.time, samples=np.ascontiguousarray(inputs[:, column]))
            references[joint] = {**self.scenario.references_of(joint), name: signal}
        trajectory = self.scenario.learning["trajectory"]
        # What the scenario claims is about its own references.
        return replace(self.scenario, references=references, desired=trajectory, expect=(), log_every=log_every)

    def run(self, inputs: Array, sinks: Sequence[Sink] | Callable[[Any], Sequence[Sink]] = ()) -> Run:
        """One run with these inputs; every sample kept."""
        from asrsim.simulation.run import simulate

        return simulate(self.with_inputs(inputs), self.robot, sinks=sinks)

    def outputs(self, inputs: Array, sinks: Sequence[Sink] | Callable[[Any], Sequence[Sink]] = ()) -> Array:
        """(n, joints) rad, link positions with these inputs; NaN after a divergence."""
        found = np.full_like(self.reference, np.nan)
        try:
            run = self.run(inputs, sinks)
        except DivergenceError:
            return found
        if run.samples is not None:
            columns = [run.samples.joints.index(joint) for joint in self.joints]
            positions = run.samples.values["link_position"][:, columns]
            found[: len(positions)] = positions
        return found

    def identity(self) -> str:
        """A hash of robot and scenario, without what learning may change between resumptions."""
        kept = {key: value for key, value in self.scenario.resolved.items() if key not in ("ilc", "expect", "log_rate")}
        text = json.dumps([kept, self.scenario.variant], sort_keys=True, default=str) + self.robot.text
        return hashlib.sha256(text.encode()).hexdigest()


def make_plant(scenario: Scenario, robot: Robot | None = None) -> Plant:
    """The plant of a scenario with an `ilc:` block.

    Raises ScenarioError where there is none, or a joint's mode takes no position.
    """
    from asrsim.scenario import apply_to_robot, checked_robot

    if not scenario.learning:
        raise ScenarioError(
            Problem(message="the scenario has no block `ilc`: nothing says what to learn", file=scenario.path, code="no-ilc")
        )
    robot, _ = checked_robot(scenario, robot)
    applied = apply_to_robot(scenario, robot)
    trajectory = scenario.learning["trajectory"]
    blocks = [block for block in applied.actuators if block.joint in trajectory or "*" in trajectory]
    unfit = [block for block in blocks if block.mode not in LEARNED_MODES]
    if unfit:
        raise ScenarioError(
            [
                Problem(
                    message=f"mode {block.mode} has no position as its first reference to learn",
                    key=f"ilc.trajectory.{block.joint}",
                    choices=tuple(f"{mode} {MODES[mode].name}" for mode in LEARNED_MODES),
                    code="mode-not-learned",
                )
                for block in unfit
            ]
        )
    time = np.round(np.arange(round(scenario.duration / scenario.step) + 1) * scenario.step, 12)
    signals = [trajectory.get(block.joint, trajectory.get("*")) for block in blocks]
    return Plant(
        scenario=scenario,
        robot=robot,
        joints=tuple(block.joint for block in blocks),
        time=time,
        reference=np.column_stack([signal.values(time) for signal in signals]),
        drives=tuple(drive_of(block) for block in blocks),
        presets=tuple(_preset(scenario, block.joint, block.mode) for block in blocks),
        damping={joint.name: joint.damping for joint in robot.moving_joints},
    )


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """Everything that `learn` needs, and what the model says beforehand."""

    plant: Plant
    problem: LearningProblem
    settings: LearningSettings
    predict: Predict
    along: tuple[JointDynamics, ...]
    """The joints linearised along the trajectory, at the gravity-compensated input (where the learning should end)."""

    def gain_advice(self) -> tuple[float, ...]:
        """Gains that the model would choose."""
        return choose_gains(self.along)

    def learnable(self) -> float:
        """Hz below which errors shrink with the first gains, at the worst posture: a cutoff for the learning filter."""
        # Three postures tell: the ends and the middle of the motion.
        chosen = [self.along[index] for index in (0, len(self.along) // 2, -1)]
        return min(item.learnable(self.settings.gains) for item in chosen)


def prepare_learning(plant: Plant, model: EngineModel) -> Prepared:
    """The learning problem of a plant; `model` (see `learning_model`) must stay open while it is solved.

    Raises ScenarioError where gravity is to be compensated and cannot be.
    """
    block = plant.scenario.learning
    compensated = compensated_guess(plant, model, strict=block.get("first_guess") == "gravity")
    guess = {"zero": np.zeros_like(plant.reference), "reference": plant.reference, "gravity": compensated}[
        block.get("first_guess", "zero")
    ]
    along = postures(model, plant.drives, plant.presets, dict(plant.damping), compensated, plant.reference)
    gains = choose_gains(along) if wants_model_gains(block, plant.joints) else None
    problem = LearningProblem(
        joints=plant.joints,
        time=plant.time,
        reference=plant.reference,
        first_guess=guess.copy(),
        identity=plant.identity(),
        origin=origin_of(plant.scenario),
    )
    return Prepared(
        plant=plant,
        problem=problem,
        settings=parse_settings(block, plant.joints, gains),
        predict=predictor(problem, model, plant.drives, plant.presets, dict(plant.damping)),
        along=tuple(along),
    )


def learning_model(plant: Plant) -> Any:
    """Context manager of the plant's rigid-body model, with the scenario's parameters."""
    from asrsim.scenario import apply_to_robot

    return model_of(plant.scenario, apply_to_robot(plant.scenario, plant.robot))


def compensated_guess(plant: Plant, model: EngineModel, *, strict: bool) -> Array:
    """(n, joints) rad: the equilibria that hold gravity along the trajectory.

    A load that a spring cannot hold raises ScenarioError if `strict`; else the trajectory itself stands there.
    """
    rows = np.unique(np.linspace(0, len(plant.time) - 1, GUESS_KNOTS).round().astype(int))
    index = [model.joints.index(joint) for joint in plant.joints]
    initial = {name: for_joint(plant.scenario.initial_positions, name, 0.0) for name in model.joints}
    found = np.empty((len(rows), len(index)))
    guesses: list[float | None] = [None] * len(index)
    for row, sample in enumerate(rows):
        q = np.array([initial[name] for name in model.joints])
        q[index] = plant.reference[sample]
        loads = model.gravity_torques(q)[index]
        for column, (drive, load) in enumerate(zip(plant.drives, loads, strict=True)):
            position = float(plant.reference[sample, column])
            found[row, column] = position
            if not MODES[drive.mode].spring:
                continue
            try:
                value = equilibrium_for_load(
                    drive, position, float(load), plant.presets[column], droop=True, guess=guesses[column]
                )
            except LoadError as error:
                if strict:
                    raise ScenarioError(
                        [
                            replace(problem, message=f"at {plant.time[sample]:.4g} s: {problem.message}")
                            for problem in error.problems
                        ]
                    ) from error
                continue
            found[row, column] = guesses[column] = value
    return np.column_stack([np.interp(plant.time, plant.time[rows], column) for column in found.T])


def _preset(scenario: Scenario, joint: str, mode: int) -> float:
    names = MODES[mode].references
    if len(names) < 2:
        return 0.0
    given = scenario.references_of(joint)
    return float(given[names[1]].values(np.zeros(1))[0]) if names[1] in given else 0.0
