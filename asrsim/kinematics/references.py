"""Compute the joints' references from a scenario's Cartesian task, or from its desired link motions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators import MODES
from asrsim.errors import Problem, ScenarioError
from asrsim.kinematics.plan import PlannedReferences, plan
from asrsim.robot import drive_of
from asrsim.scenario.data import for_joint
from asrsim.signals.sampled import Sampled

if TYPE_CHECKING:
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario
    from asrsim.signals.base import Signal


def plan_references(scenario: Scenario, robot: Robot) -> Scenario:
    """Scenario in which references replace the task and the desired motions; unchanged if the scenario has no task and no
    desired motions.

    robot: the robot with the scenario's modes and parameters. Presets in the scenario's references are kept, and gravity
    compensation accounts for them. Raises ScenarioError for poses that cannot be reached and loads that cannot be held.
    """
    if scenario.task is None:
        planned = inputs_for_motions(scenario, robot) if any(scenario.inverse_dynamics.values()) else {}
        desired: dict[str, Signal] = {
            joint: scenario.references_of(joint)[name] for joint, signals in planned.items() for name in signals
        }
    else:
        try:
            task = plan_task(scenario, robot)
        except ScenarioError as error:
            raise ScenarioError([scenario.placed(problem) for problem in error.problems]) from None
        planned = task.signals()
        path = zip([joint.name for joint in robot.moving_joints], task.path.positions.T, strict=True)
        desired = {name: Sampled(times=task.time, samples=np.ascontiguousarray(column)) for name, column in path}
    if not planned:
        return scenario
    references = dict(scenario.references)
    for joint, signals in planned.items():
        references[joint] = {**scenario.references_of(joint), **signals}
    # The references replace the plan, so that preparing the scenario again does not plan the task again.
    return replace(scenario, references=references, inverse_dynamics={}, desired={**desired, **scenario.desired})


def inputs_for_motions(scenario: Scenario, robot: Robot) -> dict[str, dict[str, Signal]]:
    """First references, by joint, that move the links as the scenario's `inverse_dynamics` requires.

    Raises ScenarioError for modes without positions, and for torques that a spring cannot give.
    """
    from asrsim.kinematics.engine_model import model_of
    from asrsim.kinematics.inverse import INVERTED_MODES, SoftArm

    chosen = [block for block in robot.actuators if for_joint(scenario.inverse_dynamics, block.joint, False)]
    problems = [
        Problem(
            f"mode {block.mode} has no position as its first reference",
            key=f"inverse_dynamics.{block.joint}",
            choices=tuple(f"{mode} {MODES[mode].name}" for mode in INVERTED_MODES),
            code="mode-not-inverted",
        )
        for block in chosen
        if block.mode not in INVERTED_MODES
    ]
    names = {block.joint: MODES[block.mode].references[0] for block in chosen}
    problems += [
        Problem(f"needs the desired motion of the link under {name}", key=f"references.{joint}", code="no-motion")
        for joint, name in names.items()
        if name not in scenario.references_of(joint)
    ]
    if problems:
        raise ScenarioError([scenario.placed(problem) for problem in problems])
    joints = tuple(names)
    time = scenario.step_times()
    wanted = np.column_stack([scenario.references_of(joint)[name].values(time) for joint, name in names.items()])
    with model_of(scenario, robot) as model:
        arm = SoftArm(scenario=scenario, robot=robot, model=model)
        inverse = arm.inverse(time, joints, wanted)
    unheld = [demand for demand in inverse.out_of_reach if demand.what == "spring torque"]
    if unheld:
        raise ScenarioError(
            [
                Problem(
                    f"the motion is out of reach: {demand}", key=f"references.{demand.joint}", code="spring-too-weak",
                    hint="a stiffer spring or preset, or a slower motion",
                )
                for demand in unheld
            ]
        )  # fmt: skip
    inputs = inverse.inputs_at(time, [arm.delay(joint) for joint in joints])
    return {
        joint: {names[joint]: Sampled(times=time, samples=np.ascontiguousarray(column))}
        for joint, column in zip(joints, inputs.T, strict=True)
    }


def plan_task(scenario: Scenario, robot: Robot) -> PlannedReferences:
    """References and joint path for the task of a scenario. Raises ScenarioError as `plan_references` does."""
    from asrsim.kinematics.engine_model import model_of

    if scenario.task is None:
        raise ScenarioError("the scenario has no Cartesian task", key="task", code="no-task")
    drives = [drive_of(block) for block in robot.actuators]
    presets: dict[str, Signal] = {}
    for drive in drives:
        names = drive.mode.references
        given = scenario.references_of(drive.joint)
        if drive.mode.mapped and names[1] in given:
            presets[drive.joint] = given[names[1]]
    initial = {joint.name: for_joint(scenario.initial_positions, joint.name, 0.0) for joint in robot.moving_joints}
    with model_of(scenario, robot) as model:
        return plan(scenario.task, model, drives, initial, scenario.duration, presets=presets)
