"""The simulated robot as a plant for learning: inputs are joint references, outputs are link positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators import MODES
from asrsim.errors import DivergenceError, Problem, ScenarioError
from asrsim.kinematics.inverse import INVERTED_MODES
from asrsim.samples import Array
from asrsim.scenario.data import Learning, Scenario, for_joint
from asrsim.signals.pieces import Constant
from asrsim.signals.sampled import Sampled

if TYPE_CHECKING:
    from asrsim.robot.model import Robot
    from asrsim.simulation.drives import SteppedJoint
    from asrsim.simulation.examine import Plan
    from asrsim.simulation.prepared import Prepared
    from asrsim.simulation.run import Run

TRIALS = 10
"""Typical number of simulations that learning needs. It is used to decide whether to compile the simulation."""


@dataclass(frozen=True, kw_only=True)
class Plant:
    """Robot in a scenario. The scenario's block `ilc` states the motion to learn."""

    scenario: Scenario
    robot: Robot = field(repr=False)
    """Robot of the robot file, without the scenario's changes."""
    learning: Learning = field(repr=False)
    """The scenario's block `ilc`."""
    prepared: Prepared = field(repr=False)
    """Prepared simulation with the scenario's modes and parameters. Its references are the desired motion. Each trial replaces
    the references.
    """
    joints: tuple[str, ...]
    time: Array = field(repr=False)
    """Times (n,) of the simulation steps, s."""
    reference: Array = field(repr=False)
    """Desired link positions (n, joints), rad."""
    delay: float = 0.0
    """Delay of commands in addition to the scenario's delay, s."""

    @property
    def drives(self) -> tuple[SteppedJoint, ...]:
        """Drives of the learned joints."""
        drives = {drive.name: drive for drive in self.prepared.drives}
        return tuple(drives[joint] for joint in self.joints)

    def names(self) -> tuple[str, ...]:
        """Name of the first reference of each joint. Learning changes this reference."""
        return tuple(drive.mode.references[0] for drive in self.drives if drive.mode)

    def headings(self) -> list[str]:
        """Headings of the joints' columns in files of inputs."""
        return [f"{joint} [{self.unit(joint)}]" for joint in self.joints]

    def unit(self, joint: str) -> str:
        """Unit of a joint's position."""
        return "m" if self.robot.joint(joint).kind == "prismatic" else "rad"

    def varied(self, numbers: Mapping[str, Mapping[str, float]], delay: float) -> Plant:
        """Plant with other parameters and another delay. numbers: as for `vary` of the prepared simulation; delay: additional
        delay of commands, s.
        """
        return replace(self, prepared=self.prepared.vary(numbers), delay=delay)

    def run(self, inputs: Array) -> Run:
        """Run with inputs (n, joints), of which every sample is kept."""
        from asrsim.simulation.run import simulate

        prepared = self.prepared.with_references(
            {
                joint: {name: Sampled(times=self.time + self.delay, samples=np.ascontiguousarray(column))}
                for joint, name, column in zip(self.joints, self.names(), inputs.T, strict=True)
            }
        )
        return simulate(prepared, alike=TRIALS)

    def outputs(self, inputs: Array) -> Array:
        """Simulated link positions (n, joints) for inputs (n, joints), rad; NaN after a divergence."""
        found = np.full_like(self.reference, np.nan)
        try:
            run = self.run(inputs)
        except DivergenceError:
            return found
        if run.samples is not None:
            positions = run.samples.values["link_position"][:, [run.samples.joints.index(joint) for joint in self.joints]]
            found[: len(positions)] = positions
        return found


def make_plant(plan: Plan) -> Plant:
    """Plant of an examined scenario with a block `ilc`.

    Raises ScenarioError if the block is missing, or a joint's mode has no position reference.
    """
    from asrsim.simulation.prepare import build

    scenario, learning = plan.scenario, plan.scenario.learning
    if learning is None:
        hint = "Write the motion: ilc: {tolerance: 0.01, trajectory: {JOINT: {minimum_jerk: {duration: 2.0, to: 0.6}}}}"
        message = "the scenario has no block `ilc`, which states the motion to learn"
        raise ScenarioError(message, file=scenario.path, hint=hint, code="no-ilc")
    trajectory, driven = learning.trajectory, plan.robot.actuators
    blocks = [block for block in driven if block.joint in trajectory or "*" in trajectory]
    choices = tuple(f"{mode} {MODES[mode].name}" for mode in INVERTED_MODES)
    problems = [
        Problem(
            f"mode {block.mode} has no position as its first reference to learn",
            key=f"ilc.trajectory.{block.joint}",
            choices=choices,
            code="mode-not-learned",
        )
        for block in blocks
        if block.mode not in INVERTED_MODES
    ]
    joints = tuple(block.joint for block in blocks)
    unknown = [joint for joint in learning.joint_gains if joint not in joints]
    problems += [
        Problem(
            "this joint is not among the joints that learn",
            key=f"ilc.joint_gains.{joint}",
            choices=joints,
            code="unknown-joint",
        )
        for joint in unknown
    ]
    if not blocks:
        problems.append(Problem("names no joint that is driven", key="ilc.trajectory", code="no-trajectory"))
    if problems:
        raise ScenarioError(problems)
    time = scenario.step_times()
    reference = np.column_stack([for_joint(trajectory, joint, Constant(value=0.0)).values(time) for joint in joints])
    # Remove the claims of the scenario, since they refer to the references of the scenario and not to learned inputs.
    played = plan.on(
        expect=(),
        log_every=1,
        desired=trajectory,
        inverse_dynamics={**scenario.inverse_dynamics, **dict.fromkeys(joints, False)},
        references={
            **scenario.references,
            **{
                block.joint: {
                    **scenario.references_of(block.joint),
                    MODES[block.mode].references[0]: Sampled(times=time, samples=np.ascontiguousarray(column)),
                }
                for block, column in zip(blocks, reference.T, strict=True)
            },
        },
    )
    return Plant(
        scenario=scenario,
        robot=plan.source,
        learning=learning,
        prepared=build(played),
        joints=joints,
        time=time,
        reference=reference,
    )
