"""A scenario's Cartesian task made into its references."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators import MODES
from asrsim.errors import Problem, ScenarioError
from asrsim.kinematics.compensation import drive_of
from asrsim.kinematics.plan import PlannedReferences, plan
from asrsim.scenario.data import for_joint
from asrsim.signals.sampled import Sampled

if TYPE_CHECKING:
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario
    from asrsim.signals.base import Signal


def plan_references(scenario: Scenario, robot: Robot) -> Scenario:
    """The scenario with its task turned into references; itself if it has none.

    robot: with the scenario's modes and parameters in it. A preset that the scenario's references give, constant or
    changing, is kept and compensated for. Raises ScenarioError for what the robot cannot reach or hold.
    """
    if scenario.task is None:
        return scenario
    planned = plan_task(scenario, robot)
    references = dict(scenario.references)
    for joint, signals in planned.signals().items():
        references[joint] = {**scenario.references_of(joint), **signals}
    names = [joint.name for joint in robot.moving_joints]
    path = zip(names, planned.path.positions.T, strict=True)
    desired = {name: Sampled(times=planned.time, samples=np.ascontiguousarray(column)) for name, column in path}
    return replace(scenario, references=references, desired={**desired, **scenario.desired})


def plan_task(scenario: Scenario, robot: Robot) -> PlannedReferences:
    """The plan of a scenario's task, with the joints' path. Raises ScenarioError as `plan_references` does."""
    from asrsim.kinematics.engine_model import model_of

    if scenario.task is None:
        raise ScenarioError(Problem(message="the scenario has no Cartesian task", key="task", code="no-task"))
    drives = [drive_of(block) for block in robot.actuators]
    presets: dict[str, Signal] = {}
    for drive in drives:
        names = MODES[drive.mode].references
        given = scenario.references_of(drive.joint)
        if MODES[drive.mode].mapped and names[1] in given:
            presets[drive.joint] = given[names[1]]
    initial = {joint.name: for_joint(scenario.initial_positions, joint.name, 0.0) for joint in robot.moving_joints}
    with model_of(scenario, robot) as model:
        return plan(scenario.task, model, drives, initial, scenario.duration, presets=presets)
