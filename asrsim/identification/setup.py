"""Preparation of a fit: scenario, robot, recordings with their simulations, and the least-squares problem."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass

from asrsim.errors import InputError
from asrsim.identification.data import guided, read_data
from asrsim.identification.door import load_plugin_file
from asrsim.identification.parameters import free_parameters, make_layout, parameters_of
from asrsim.identification.problem import Meter, Problem
from asrsim.identification.task import Task
from asrsim.identification.track import Playing, Track
from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario


@dataclass(frozen=True, eq=False)
class Setup:
    """A task with its scenario, robot, recordings and problem."""

    task: Task
    scenario: Scenario
    robot: Robot
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


def set_up(task: Task, stack: ExitStack, meter: Meter | None = None) -> Setup:
    """Prepared fit of a task. meter: counts the evaluations. Raises InputError with every problem."""
    scenario, given, robot = read_scenario(task)
    data = read_data(task, scenario, robot)
    commands = {command.key: command.unit for one in data for command in one.commands}
    known = parameters_of(robot, tuple(commands), commands | {c.key: c.unit for one in data for c in one.channels})
    free, ties = free_parameters(task, known)
    freed, tracks = {parameter.key for parameter in free}, list[Track]()
    for one in data:
        tracks.append(Track(scenario, given, guided(one, robot, freed), freed))
        stack.callback(tracks[-1].close)
    # Recordings that are not fitted keep the start values of their separate parameters.
    fitted = [track for track in tracks if not track.data.predicted_only]
    # Initial states are free for links that start in motion, or at other positions than in the scenario.
    free += [known[key] for key in dict.fromkeys(key for track in fitted for key in track.uncertain)]
    layout = make_layout(free, ties, [one.name for one in data], [track.initial for track in fitted])
    share = 0.0 if task.validate else task.hold_out
    ends = tuple(0.0 if t.data.predicted_only else t.onset + (t.data.duration - t.onset) * (1.0 - share) for t in tracks)
    weights = tuple(tuple(channel.floor for channel in track.channels) for track in tracks)
    playing = Playing(max(track.door.substeps for track in tracks))
    problem = Problem(tuple(tracks), layout, playing, weights, ends, meter or Meter())
    count = problem.parts[-1].rows.stop
    if count <= len(layout):
        message = f"{count} samples are too few for {len(layout)} parameters"
        raise InputError(message, file=data[0].path, key="experiments", code="few-samples")
    return Setup(task, scenario, robot, problem)
