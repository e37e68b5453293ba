"""One recording beside its simulation: from numbers by key to predicted channels."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from asrsim.identification.data import Channel, Data
from asrsim.identification.door import EXTERNAL, Door, Numbers, Start, Substeps
from asrsim.identification.keys import CLOCK
from asrsim.identification.noise import at_rest, first_samples
from asrsim.identification.played import Played, drawn, noise_of_command
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

NOT_THE_ROBOTS = ("offset", "gain", "delay", "initial_position", "initial_velocity")
"""Last parts of keys that belong to recordings."""
DIGITS = 3
"""Of rad or m, in which people write where a joint begins."""
STILL = 4.5
"""Deviations of the mean within which a recording begins where the scenario does."""
SOON = 0.05
"""s after 0 at which a channel must begin to tell of the start."""
KEPT = 6
"""Predictions, and ways to play commands, that a track remembers."""


Settings = tuple[tuple[str, float], ...]
"""Keys with their values."""


@dataclass(frozen=True)
class Playing:
    """How a recording's inputs are played, and how finely its simulation is stepped."""

    substeps: Substeps
    held: frozenset[str] = frozenset()
    """Keys of commands that are played as stairs: what gave them held each sample until the next."""
    draw: int | None = None
    """Number of the draw of noise that is added to the recorded inputs."""


class Track:
    """A recording with the simulation that is fitted to it; nothing of it changes."""

    def __init__(self, scenario: Scenario, robot: Robot, data: Data, trusted: Collection[str] = ()) -> None:
        """trusted: `joint.quantity` whose zero is free: there the scenario's start holds."""
        self.data = data
        self.scenario = _scenario(scenario, data)
        self.door = Door(self.scenario, robot)
        self.wanted = [(self.door.joints.index(channel.joint), channel.quantity) for channel in data.channels]
        self._references = lru_cache(KEPT)(self._play)
        self._predicted = lru_cache(KEPT)(self._predict)
        self.uncertain: tuple[str, ...] = ()
        """Keys of starts that are not the scenario's: joints that begin elsewhere, or in motion."""
        self.positions, self.velocities = tuple(self.door.positions), tuple(self.door.velocities)
        self.motors: Mapping[str, Sequence[float]] = {}
        self._begin(trusted)
        self.onset = min(map(_onset, data.channels))
        """s at which something begins to move."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What is compared."""
        return self.data.channels

    # -- where it begins -----------------------------------------------------------------------------------------------

    def _begin(self, trusted: Collection[str]) -> None:
        """Where links and motors are at 0: the scenario's start where the recording does not contradict it."""
        home = self.positions, self.velocities
        positions, velocities, motors, uncertain = [*home[0]], [*home[1]], dict[str, Sequence[float]](), list[str]()
        for j, joint in enumerate(self.door.joints):
            channel = self._channel(joint, "link_position")
            found = None if channel is None else first_samples(channel, SOON)
            if channel is None or found is None:
                continue
            place, speed, place_error, speed_error = found
            moving = abs(speed) > STILL * speed_error
            if not moving:
                place, place_error = min((place, place_error), at_rest(channel), key=lambda known: known[1])
            # A start that is no round number was read off a recording, with its noise.
            measured = positions[j] != round(positions[j], DIGITS) and not self.scenario.initial_equilibrium
            if abs(place - positions[j]) > STILL * place_error or moving or measured:
                if channel.key not in trusted:
                    positions[j] = place
                    uncertain.append(f"{joint}.initial_position")
                if moving:
                    velocities[j] = speed
                    uncertain.append(f"{joint}.initial_velocity")
        for j, drive in enumerate(self.door.drives):
            channels = [self._channel(drive.name, f"motor_{i}_position") for i in range(1, drive.dynamic_motors + 1)]
            known = [at_rest(channel) for channel in channels if channel is not None and channel.time[0] <= SOON]
            if not known or len(known) < len(channels) or any(c is not None and c.key in trusted for c in channels):
                continue
            rest = (drive.motor_positions or (positions[j],) * len(known))[: len(known)]
            if any(abs(place - was) > STILL * error for (place, error), was in zip(known, rest, strict=True)):
                motors[drive.name] = [place for place, _ in known]
                if self._channel(drive.name, "link_position") is None:
                    # What rests on its motors begins with them.
                    positions[j] += float(np.mean(motors[drive.name]) - np.mean(rest))
        self.positions, self.velocities = tuple(positions), tuple(velocities)
        self.motors, self.uncertain = motors, tuple(uncertain)

    def _channel(self, joint: str, quantity: str) -> Channel | None:
        return next((one for one in self.channels if (one.joint, one.quantity) == (joint, quantity)), None)

    # -- what is predicted ---------------------------------------------------------------------------------------------

    @property
    def playing(self) -> Playing:
        """Commands as they were recorded, with a run's own substeps."""
        return Playing(self.door.substeps)

    def predict(self, values: Mapping[str, float], playing: Playing, until: float | None = None) -> list[Array] | None:
        """Each channel at its recorded times up to `until` s, shorter then; None where the motion is not sane."""
        return self._predicted(tuple(sorted(values.items())), playing, until)

    def _predict(self, values: Settings, playing: Playing, until: float | None) -> list[Array] | None:
        return next(self.predictions([dict(values)], playing, until))

    def predictions(
        self, tables: Sequence[Mapping[str, float]], playing: Playing, until: float | None = None
    ) -> Iterator[list[Array] | None]:
        """The same of several sets of numbers: worlds of one rollout."""
        steps = None if until is None else min(max(4, int(np.ceil((until + 0.3) / self.scenario.step))), self.scenario.steps)
        worlds = [self._world(values, playing) for values in tables]
        found = self.door.rollout(self.wanted, worlds, steps=steps, substeps=playing.substeps)
        for values, series in zip(tables, found, strict=True):
            yield None if series is None else self._sensed(values, series, until)

    def series(self, values: Mapping[str, float], playing: Playing, names: Sequence[tuple[int, str]]) -> Array | None:
        """Quantities (joint's number, name) at whole steps, whether they were recorded or not; None as :meth:`predict`."""
        return next(self.door.rollout(names, [self._world(values, playing)], substeps=playing.substeps))

    def _sensed(self, values: Mapping[str, float], series: Array, until: float | None) -> list[Array]:
        """Channels as their sensors show them, of series at whole steps."""
        clock, predicted = values.get(CLOCK, 0.0), []
        for channel, exact in zip(self.channels, series, strict=True):
            time = channel.time if until is None else channel.time[channel.time <= until + 1e-9]
            shift = clock + values.get(f"{channel.key}.delay", 0.0)
            gain, offset = values.get(f"{channel.key}.gain", 1.0), values.get(f"{channel.key}.offset", 0.0)
            predicted.append(interpolate(exact, (time - shift) / self.scenario.step) / gain + offset)
        return predicted

    def _world(self, values: Mapping[str, float], playing: Playing) -> Start:
        positions, velocities = (
            {joint: values.get(f"{joint}.initial_{what}", own) for joint, own in zip(self.door.joints, start, strict=True)}
            for what, start in (("position", self.positions), ("velocity", self.velocities))
        )
        for drive in self.door.drives:
            # A recording may begin a hair beyond a stop.
            positions[drive.name] = min(max(positions[drive.name], drive.joint.stops[0]), drive.joint.stops[1])
        return Start(
            parameters=numbers_of(values), references=self.references(values, playing), positions=positions,
            velocities=velocities, motors=self.motors,
        )  # fmt: skip

    def references(self, values: Mapping[str, float], playing: Playing) -> Mapping[str, Mapping[str, Played]]:
        """Commands with the gains, offsets and delays among `values`; the same object where nothing of it changes."""
        keys = {command.key for command in self.data.commands}
        own = tuple((key, value) for key, value in values.items() if key.rpartition(".")[0] in keys)
        return self._references(own, playing)

    def _play(self, values: Settings, playing: Playing) -> Mapping[str, Mapping[str, Played]]:
        table: dict[str, dict[str, Played]] = {}
        for command in drawn(self.data.commands, playing.draw):
            one = command.as_stairs if command.key in playing.held else command
            own = {key.rpartition(".")[2]: value for key, value in values if key.rpartition(".")[0] == command.key}
            step = self.scenario.step / playing.substeps[0]
            table.setdefault(command.joint, {})[command.name] = Played(command=one, step=step, **own)
        return table

    @property
    def has_noisy_inputs(self) -> bool:
        """Whether the recorded commands have noise that moves anything."""
        return any(noise_of_command(one) > 2e-6 * np.ptp(one.values) for one in self.data.commands)

    def shaken(self, values: Mapping[str, float], playing: Playing, draw: int = 0) -> list[Array] | None:
        """By how much noise as the recorded inputs have it moves each channel (n,): one draw; None where it moves nothing."""
        if not self.has_noisy_inputs:
            return None
        before, after = (self.predict(values, one) for one in (playing, replace(playing, draw=draw)))
        return None if before is None or after is None else [a - b for a, b in zip(after, before, strict=True)]

    def close(self) -> None:
        """Release the engines."""
        self.door.close()


def _onset(channel: Channel) -> float:
    away = np.abs(channel.values - np.median(channel.values[:5])) > 8.0 * max(channel.noise, channel.quantum)
    return float(channel.time[int(np.argmax(away))]) if away.any() else float(channel.time[-1])


def _scenario(scenario: Scenario, data: Data) -> Scenario:
    """Of the recording's length and modes."""
    # References of another mode would be unknown there; what is played replaces them all.
    references = {joint: dict(signals) for joint, signals in scenario.references.items() if joint not in data.modes}
    for command in data.commands:
        if command.name != EXTERNAL:
            played = {command.name: Played(command=command, step=scenario.step)}
            references[command.joint] = {**references.get(command.joint, {}), **played}
    return replace(
        scenario, duration=data.duration, modes={**scenario.modes, **data.modes}, references=references, expect=(), desired={},
        log_every=1,
    )  # fmt: skip


def numbers_of(values: Mapping[str, float]) -> Numbers:
    """Those of the robot, by joint or link."""
    robot: dict[str, dict[str, float]] = {}
    for key, value in values.items():
        owner, _, name = key.rpartition(".")
        if owner and name not in NOT_THE_ROBOTS:
            robot.setdefault(owner, {})[name] = value
    return robot


def interpolate(series: Array, place: Array) -> Array:
    """Series (n,) at places (m,) in samples, by cubics through four samples; the ends hold."""
    last = len(series) - 1
    place = np.clip(place, 0.0, last)
    nearest = np.round(place)
    if np.abs(place - nearest).max(initial=0.0) < 1e-6:
        return np.asarray(series[nearest.astype(np.intp)])
    if last < 3:
        return np.interp(place, np.arange(last + 1), series)
    base = np.clip(np.floor(place).astype(np.intp), 1, last - 2)
    t = place - base
    a, b, c, d = (series[base + i] for i in (-1, 0, 1, 2))
    return np.asarray(
        -t * (t - 1.0) * (t - 2.0) / 6.0 * a + (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0 * b
        - (t + 1.0) * t * (t - 2.0) / 2.0 * c + (t + 1.0) * t * (t - 1.0) / 6.0 * d
    )  # fmt: skip
