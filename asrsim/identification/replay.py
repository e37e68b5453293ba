"""Data for repeating a fit. A run repeats a recording as the fit simulated it, and `asrsim plot` reads the recording as the fit
read it. The data contain zero offsets, scales and delays of sensors and commands, the clock offset, and the initial state.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from asrsim.identification.data import PlayedCommand
from asrsim.identification.parameters import CLOCK, JUMP
from asrsim.identification.track import Playing, Track
from asrsim.metrics.values import root_mean_square
from asrsim.plain import PlainShape
from asrsim.recordings.data import Column
from asrsim.recordings.reading import ColumnMap, parse_meaning
from asrsim.recordings.units import find_unit


@dataclass(frozen=True, kw_only=True)
class SeriesReading:
    """Corrections of a recorded series. The true value is gain * (recorded - offset), at a time `late` s before the recorded
    time.
    """

    key: str
    """`joint.quantity` of the series."""
    column: str
    meaning: str
    """Meaning of the column without the corrections, as in an item of `--map`."""
    gain: float = 1.0
    offset: float = 0.0
    late: float = 0.0
    """Delay of the recorded values, s. For a command, it is the time from the recorded time until the command acts."""
    reference: str = ""
    """Name of a command's reference in the mode of its joint; empty for measured quantities."""
    interpolation: str = ""
    """Interpolation between a command's samples: a value of the key `interpolation` of a playback."""
    early: Mapping[str, float] = field(default_factory=dict)
    """Time from each jump of the command until the first sample after the jump, s, by the time of this sample as text, s."""
    error: float = 0.0
    """RMS of simulated minus recorded values after the corrections; 0 for commands."""

    @property
    def joint(self) -> str:
        """Joint of the series."""
        return self.key.rpartition(".")[0]

    @property
    def corrected(self) -> bool:
        """Whether the values of the played command differ from the recorded values."""
        return (self.gain, self.offset) != (1.0, 0.0) or any(self.early.values())

    def item(self, late: float) -> str:
        """Item of `--map` that reads the series with its corrections, shifted to times `late` s earlier."""
        meaning = parse_meaning(self.column, self.meaning).corrected(gain=self.gain, offset=self.offset, late=late)
        return f"{self.column}={meaning.text}"


@dataclass(frozen=True, kw_only=True)
class FitReplay:
    """Settings with which the fit read and simulated a recording."""

    recording: str
    """Path of the recording."""
    lag: float
    """Time of the recording's clock at time 0 of the simulation, s."""
    rate: float | None
    channels: tuple[SeriesReading, ...]
    commands: tuple[SeriesReading, ...]
    initial: Mapping[str, Mapping[str, Any]]
    """Initial state of each joint that does not start as in the scenario, with the keys of `initial:` of a scenario."""


_SERIES: PlainShape = {
    "key": str, "column": str, "meaning": str, "gain": float, "offset": float, "late": float, "reference": str,
    "interpolation": str, "early": {"*": float}, "error": float,
}  # fmt: skip
SHAPE: PlainShape = {
    "recording": str,
    "lag": float,
    "rate": (float, None),
    "channels": [_SERIES],
    "commands": [_SERIES],
    "initial": {"*": object},
}
"""Structure of the data that `as_plain` returns."""


def replay_of(track: Track, values: Mapping[str, float], playing: Playing) -> FitReplay:
    """Replay of the recording of a track. values: values of the free parameters for this recording, by key."""

    def corrections(key: str) -> dict[str, float]:
        return {name: value for name in ("gain", "offset") if (value := values.get(f"{key}.{name}")) is not None}

    early = {time: values.get(f"{JUMP}{number}", 0.0) for number, time in enumerate(track.jumps, start=1)}
    predicted = track.predict(values, playing, track.data.duration)
    channels, commands = list[SeriesReading](), list[SeriesReading]()
    for one, simulated in zip(track.channels, predicted, strict=True):
        left, gain = simulated - one.values[: len(simulated)], values.get(f"{one.key}.gain", 1.0)
        late = values.get(CLOCK, 0.0) + values.get(f"{one.key}.delay", 0.0)
        if one.column is not None and np.isfinite(left).all():
            error = abs(gain) * root_mean_square(left)
            channels.append(_series(one.column, one.joint, one.key, late=late, error=error, **corrections(one.key)))
    for command in track.data.commands:
        if command.column is not None:
            held = command.hold or command.key in playing.staircases
            own = {time: early[time] for time in command.curve.jumps.tolist() if time in early}
            commands.append(
                _series(
                    command.column, command.joint, command.key, late=values.get(f"{command.key}.delay", 0.0),
                    reference=command.name, interpolation="hold" if held else "smooth",
                    early={repr(time): value for time, value in own.items()}, **corrections(command.key),
                )
            )  # fmt: skip
    data = track.data
    return FitReplay(
        recording=str(data.path.absolute()), lag=data.lag, rate=data.rate, channels=tuple(channels), commands=tuple(commands),
        initial=dict(_starts(track, values)),
    )  # fmt: skip


def _series(column: Column, joint: str, key: str, **corrections: Any) -> SeriesReading:
    read_as = replace(column.read_as or ColumnMap(quantity=column.quantity), joint=joint)
    if not column.stated and column.unit:
        read_as = replace(read_as, unit=find_unit(column.unit))
    return SeriesReading(key=key, column=column.source, meaning=read_as.corrected().text, **corrections)


def played_table(command: PlayedCommand, reading: SeriesReading, late: float) -> str:
    """Text of a CSV file with the times and values of a command as the fit played it. The times are on the clock of the
    simulation, and `late` s later than recorded.
    """
    time, values = command.time, command.values
    for jump, early in ((float(key), value) for key, value in reading.early.items()):
        # Add a sample with the value after the jump, at the instant of the jump.
        place = int(np.searchsorted(command.time, jump - 1e-12))
        size = dict(zip(command.curve.jumps.tolist(), command.curve.sizes.tolist(), strict=True))[jump]
        before = float(command.curve.values(np.array([jump - early]))[0])
        value = command.values[place] if reading.interpolation == "hold" else before + size
        if early > 1e-9 and command.time[place] - early > command.time[place - 1] + 1e-9:
            at = int(np.searchsorted(time, jump - early))
            time, values = np.insert(time, at, jump - early), np.insert(values, at, value)
        elif early > 1e-9:
            values = np.where(time == command.time[place - 1], value, values)
    rows = zip((time + late).tolist(), (reading.gain * (values - reading.offset)).tolist(), strict=True)
    head = f"# Command as `asrsim identify` played it\ntime,{command.key}" + (f" [{command.unit}]" if command.unit else "")
    return "\n".join([head, *(f"{at:.12g},{value:.12g}" for at, value in rows)]) + "\n"


def _starts(track: Track, values: Mapping[str, float]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the initial state of each joint that does not start as in the scenario. It includes the initial states of the
    joint's motors if the scenario or the recording states them.
    """
    door = track.door
    for drive, position, velocity in zip(door.drives, door.positions, door.velocities, strict=True):
        joint = drive.name
        place, speed = track.start(joint, values)
        places, speeds = track.motor_starts(drive, values)
        if (place, speed) != (position, velocity) or places or speeds:
            motors = {"motor_positions": places or drive.motor_positions, "motor_velocities": speeds or drive.motor_velocities}
            yield joint, {"position": place, "velocity": speed, **{key: [*own] for key, own in motors.items() if own}}


def as_plain(replay: FitReplay) -> dict[str, Any]:
    """Plain data of a replay."""
    return asdict(replay)


def from_plain(data: Mapping[str, Any]) -> FitReplay:
    """Replay from the data of `as_plain`."""
    series = {name: tuple(SeriesReading(**one) for one in data[name]) for name in ("channels", "commands")}
    return FitReplay(**{**data, **series})
