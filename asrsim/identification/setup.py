"""Preparation of a fit: scenario, robot, recordings with their simulations, and the least-squares problem."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass

from asrsim.errors import InputError
from asrsim.identification.data import guided, read_data
from asrsim.identification.door import load_plugin_file
from asrsim.identification.keys import free_parameters, parameters_of
from asrsim.identification.layout import make_layout
from asrsim.identification.problem import Meter, Problem
from asrsim.identification.task import Task
from asrsim.identification.track import Track
from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario


@dataclass(frozen=True, eq=False)
class Setup:
    """A task with its scenario, robot, recordings and problem."""

    task: Task
    scenario: Scenario
    robot: Robot
    freed: frozenset[str]
    """Keys of the parameters that the task frees."""
    problem: Problem


def read_scenario(task: Task) -> tuple[Scenario, Robot, Robot]:
    """Scenario of a task, robot of the robot file, and robot with the scenario's changes. Loads the plugins. Raises
    InputError.
    """
    from asrsim.scenario import apply_to_robot, checked_robot, load_scenario, only_variant

    for plugin in task.plugins:
        load_plugin_file(plugin)
    scenario = only_variant(load_scenario(task.scenario, variant=task.variant, overrides=task.overrides))
    given, _ = checked_robot(scenario)
    return scenario, given, apply_to_robot(scenario, given)


def set_up(task: Task, stack: ExitStack) -> Setup:
    """Prepared fit of a task. Raises InputError with every problem."""
    scenario, given, robot = read_scenario(task)
    data = read_data(task, scenario, robot)
    commands = {command.key: command.unit for one in data for command in one.commands}
    known = parameters_of(robot, tuple(commands), commands | {c.key: c.unit for one in data for c in one.channels})
    free, ties = free_parameters(task, known)
    freed = frozenset(parameter.key for parameter in free)
    trusted = {key.removesuffix(".offset") for key in freed if key.endswith("_position.offset")}
    tracks = []
    for one in data:
        tracks.append(Track(scenario, given, guided(one, robot, freed), trusted))
        stack.callback(tracks[-1].close)
    # Initial states are free for links that start in motion, or at other positions than in the scenario.
    starts = dict.fromkeys(key for track in tracks if not track.data.predicted_only for key in track.uncertain)
    free += [known[key] for key in starts if key not in freed]
    # Recordings that are not fitted keep the start values of their separate parameters.
    layout = make_layout(
        free, ties, [one.name for one in data], [track.initial for track in tracks if not track.data.predicted_only]
    )
    share = 0.0 if task.validate else task.hold_out
    ends = tuple(0.0 if t.data.predicted_only else t.onset + (t.data.duration - t.onset) * (1.0 - share) for t in tracks)
    weights = tuple(tuple(channel.floor for channel in track.channels) for track in tracks)
    problem = Problem(
        tuple(tracks), layout, max((track.playing for track in tracks), key=lambda one: one.substeps), weights, ends, Meter()
    )
    count = problem.parts[-1].rows.stop
    if count <= len(layout):
        message = f"{count} samples are too few for {len(layout)} parameters"
        raise InputError(message, file=data[0].path, key="experiments", code="few-samples")
    return Setup(task, scenario, robot, freed, problem)
