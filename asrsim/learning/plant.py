"""The simulated robot as a plant for learning: inputs in, link positions out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.actuators import MODES
from asrsim.actuators.drive import Drive
from asrsim.errors import DivergenceError, Problem, ScenarioError
from asrsim.kinematics.inverse import INVERTED_MODES
from asrsim.robot import drive_of
from asrsim.samples import Array
from asrsim.scenario.data import Learning, Scenario, for_joint
from asrsim.signals.pieces import Constant
from asrsim.signals.sampled import Sampled

if TYPE_CHECKING:
    from asrsim.robot.model import Robot
    from asrsim.signals.base import Signal
    from asrsim.simulation.prepared import Prepared
    from asrsim.simulation.recording import Sink
    from asrsim.simulation.run import Run


TRIALS = 10
"""Runs of a plant that learning takes, about."""


@dataclass(frozen=True, kw_only=True)
class Plant:
    """A robot in a scenario whose `ilc:` block says what it is to learn."""

    scenario: Scenario
    robot: Robot = field(repr=False)
    """As its file says; the scenario's modes and parameters are applied at each run."""
    learning: Learning = field(repr=False)
    """The scenario's block `ilc`."""
    joints: tuple[str, ...]
    time: Array = field(repr=False)
    """(n,) s, the steps of the simulation."""
    reference: Array = field(repr=False)
    """(n, joints) rad."""
    drives: tuple[Drive, ...] = field(repr=False)
    presets: Mapping[str, float] = field(default_factory=dict, repr=False)
    """Joint -> second reference that was chosen before learning; it stands in `scenario` too."""

    def with_presets(self, presets: Mapping[str, float]) -> Plant:
        """The plant with other second references, by joint."""
        references = dict(self.scenario.references)
        for joint, drive in zip(self.joints, self.drives, strict=True):
            if joint in presets:
                signal = Constant(value=presets[joint])
                references[joint] = {**self.scenario.references_of(joint), drive.mode.references[1]: signal}
        return replace(self, scenario=replace(self.scenario, references=references), presets=presets)

    def table(self, inputs: Array) -> tuple[tuple[str, ...], Array]:
        """Headings and values (n, columns) of all that is to be played: inputs (n, joints), and presets if they were chosen."""
        headings = [f"{joint} [{self.unit(joint)}]" for joint in self.joints]
        for joint in self.presets:
            drive = self.drives[self.joints.index(joint)]
            headings.append(f"{joint}.{drive.mode.references[1]} [{drive.actuator.reference_2_unit}]")
        return tuple(headings), np.column_stack([inputs, *(np.full(len(inputs), preset) for preset in self.presets.values())])

    def __getstate__(self) -> dict[str, Any]:
        """Without the preparation, whose engine stays in its process."""
        return {name: value for name, value in self.__dict__.items() if name != "prepared"}

    def unit(self, joint: str) -> str:
        """Of a joint's position."""
        return "m" if self.robot.joint(joint).kind == "prismatic" else "rad"

    def _played(self, inputs: Array) -> dict[str, dict[str, Signal]]:
        """First references that play `inputs` (n, joints), by joint."""
        return {
            joint: {drive.mode.references[0]: Sampled(times=self.time, samples=np.ascontiguousarray(column))}
            for joint, drive, column in zip(self.joints, self.drives, inputs.T, strict=True)
        }

    @cached_property
    def prepared(self) -> Prepared:
        """What all trials share: the robot under the desired motion, ready to run."""
        from asrsim.simulation.prepare import prepare

        return prepare(self._scenario(self.reference), self.robot)

    def with_inputs(self, inputs: Array) -> Scenario:
        """The scenario that plays `inputs` (n, joints), with the substeps of all trials."""
        scenario = self._scenario(inputs)
        if self.prepared.stepping.released:
            return scenario
        resolution = self.prepared.resolution
        return replace(scenario, substeps=resolution.substeps, motor_substeps=resolution.motor_substeps)

    def _scenario(self, inputs: Array) -> Scenario:
        references = dict(self.scenario.references)
        for joint, signals in self._played(inputs).items():
            references[joint] = {**self.scenario.references_of(joint), **signals}
        computed = {**self.scenario.inverse_dynamics, **dict.fromkeys(self.joints, False)}
        # The scenario's claims are about its own references, not about learned inputs.
        return replace(
            self.scenario, references=references, inverse_dynamics=computed, desired=self.learning.trajectory, expect=(),
            log_every=1,
        )  # fmt: skip

    def run(self, inputs: Array, sinks: Sequence[Sink] | Callable[[Any], Sequence[Sink]] = ()) -> Run:
        """One run with these inputs; every sample kept."""
        from asrsim.simulation.run import simulate

        if self.scenario.initial_equilibrium:
            # Where it starts depends on the first references.
            return simulate(self.with_inputs(inputs), self.robot, sinks=sinks, alike=TRIALS)
        return simulate(self.prepared.with_references(self._played(inputs)), sinks=sinks, alike=TRIALS)

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


def trajectories(scenario: Scenario) -> dict[str, Scenario]:
    """The scenario for each of its trajectories by name, ready for :func:`make_plant`; one without a name under ""."""
    learning = scenario.learning
    if learning is None or not learning.trajectories:
        return {"": scenario}
    found = {}
    for name, one in learning.trajectories.items():
        plain = {key: value for key, value in scenario.resolved["ilc"].items() if key != "trajectories"}
        plain["trajectory"] = scenario.resolved["ilc"]["trajectories"][name]
        found[name] = replace(
            scenario, name=f"{scenario.name}_{name}", learning=replace(learning, trajectory=one, trajectories={}),
            resolved={**scenario.resolved, "ilc": plain},
        )  # fmt: skip
    return found


def make_plant(scenario: Scenario) -> Plant:
    """The plant of a scenario with an `ilc:` block.

    Raises ScenarioError where there is none, or a joint's mode takes no position.
    """
    from asrsim.scenario import apply_to_robot, checked_robot

    learning = scenario.learning
    if learning is None:
        hint = "Write the motion: ilc: {tolerance: 0.01, trajectory: {JOINT: {minimum_jerk: {duration: 2.0, to: 0.6}}}}"
        message = "the scenario has no block `ilc`: nothing says what to learn"
        raise ScenarioError(message, file=scenario.path, hint=hint, code="no-ilc")
    robot, _ = checked_robot(scenario)
    applied = apply_to_robot(scenario, robot)
    trajectory = learning.trajectory
    if not trajectory:
        names = tuple(learning.trajectories)
        message = "has several trajectories: one is learned at a time"
        raise ScenarioError(message, file=scenario.path, key="ilc.trajectories", choices=names, code="trajectories")
    blocks = [block for block in applied.actuators if block.joint in trajectory or "*" in trajectory]
    unfit = [block for block in blocks if block.mode not in INVERTED_MODES]
    if unfit:
        raise ScenarioError(
            [
                Problem(
                    f"mode {block.mode} has no position as its first reference to learn",
                    key=f"ilc.trajectory.{block.joint}",
                    choices=tuple(f"{mode} {MODES[mode].name}" for mode in INVERTED_MODES),
                    code="mode-not-learned",
                )
                for block in unfit
            ]
        )
    time = scenario.step_times()
    signals = [for_joint(trajectory, block.joint, Constant(value=0.0)) for block in blocks]
    return Plant(
        scenario=scenario,
        robot=robot,
        learning=learning,
        joints=tuple(block.joint for block in blocks),
        time=time,
        reference=np.column_stack([signal.values(time) for signal in signals]),
        drives=tuple(drive_of(block) for block in blocks),
    )
