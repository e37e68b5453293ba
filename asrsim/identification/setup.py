"""A task read and made ready: scenario, robot, recordings with their simulations, free parameters as a vector."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from asrsim.errors import InputError
from asrsim.identification.data import Data, read_data
from asrsim.identification.inverse import track_of
from asrsim.identification.keys import Parameter, free_parameters, parameters_of
from asrsim.identification.layout import Layout, make_layout
from asrsim.identification.task import Task, Tie
from asrsim.identification.track import Track
from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario


@dataclass
class Setup:
    """A task read and made ready."""

    task: Task
    scenario: Scenario
    robot: Robot
    data: list[Data]
    tracks: list[Track]
    free: list[Parameter]
    ties: list[Tie]
    layout: Layout
    ends: list[float]
    """s; of recordings that are only predicted, 0."""

    @property
    def fitted(self) -> list[Track]:
        """Recordings that are fitted."""
        return [track for track in self.tracks if not track.data.held]


def set_up(task: Task, stack: ExitStack) -> Setup:
    """Read and check everything. Raises InputError with all that is wrong."""
    from asrsim.actuators.user import load_plugin_file
    from asrsim.scenario import apply_to_robot, checked_robot, load_scenario, only_variant

    for plugin in task.plugins:
        load_plugin_file(plugin)
    scenario = only_variant(load_scenario(task.scenario, variant=task.variant, overrides=task.overrides))
    given, _ = checked_robot(scenario)
    robot = apply_to_robot(scenario, given)
    data = read_data(task, scenario, robot)
    commands = list(dict.fromkeys(command.key for one in data for command in one.commands))
    channels = {channel.key: channel.unit for one in data for channel in one.channels}
    units = {command.key: command.unit for one in data for command in one.commands}
    known = parameters_of(robot, commands, {**units, **channels})
    free, ties = free_parameters(task, known)
    tracks = []
    for one in data:
        track = track_of(scenario, given, one, robot, [parameter.key for parameter in free])
        stack.callback(track.close)
        tracks.append(track)
    for parameter in free:
        joint, _, rest = parameter.key.partition(".")
        for track in tracks if rest.endswith("_position.offset") else ():
            track.trust_scenario(joint, rest.removesuffix(".offset"))
    free += _unknown_starts(tracks, free, known)
    layout = make_layout(free, ties, [one.name for one in data], [_starts(track) for track in tracks])
    # Own values of recordings that are only predicted would be guesses: clocks and starts keep theirs.
    fitted = [i for i, one in enumerate(data) if not one.held]
    layout = Layout(tuple(e for e in layout.entries if e.track is None or e.track in fitted), layout.ties, layout.tracks)
    share = 0.0 if task.validate else task.hold_out
    ends = [0.0 if t.data.held else t.onset + (t.data.duration - t.onset) * (1.0 - share) for t in tracks]
    setup = Setup(task, scenario, robot, data, tracks, free, ties, layout, ends)
    count = sum(int(np.sum(c.time <= end)) for t, end in zip(tracks, ends, strict=True) if not t.data.held for c in t.channels)
    if count <= len(layout):
        message = f"{count} samples are fewer than the {len(layout)} parameters need"
        raise InputError(message, file=data[0].path, key="experiments", code="few-samples")
    return setup


def _unknown_starts(tracks: Sequence[Track], free: Sequence[Parameter], known: Mapping[str, Parameter]) -> list[Parameter]:
    """Starts of links that a recording finds elsewhere than the scenario, or in motion: free, each recording's own."""
    taken = {parameter.key for parameter in free}
    keys = dict.fromkeys(key for track in tracks if not track.data.held for key in track.uncertain)
    return [known[key] for key in keys if key not in taken]


def _starts(track: Track) -> dict[str, float]:
    joints = track.evaluation.joints
    places = {f"{joint}.initial_position": q for joint, q in zip(joints, track.positions, strict=True)}
    return places | {f"{joint}.initial_velocity": v for joint, v in zip(joints, track.velocities, strict=True)}
