"""One recording beside its simulation: from numbers by key to predicted channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from asrsim.engines import ENGINES
from asrsim.errors import DivergenceError, RobotError
from asrsim.identification.data import Channel, Data
from asrsim.identification.keys import CLOCK, JUMP
from asrsim.identification.played import Draw, Played, drawn, noise_of_command
from asrsim.identification.series import SOON, at_rest, first_samples, interpolate
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.signals.base import Signal
from asrsim.simulation.evaluation import EXTERNAL, Evaluation
from asrsim.simulation.prepare import prepare, resolution_of
from asrsim.simulation.prepared import Prepared

NOT_THE_ROBOTS = ("offset", "gain", "delay", "initial_position", "initial_velocity")
"""Last parts of keys that are of recordings."""
DIGITS = 3
"""Of rad or m, in which people write where a joint begins."""
STILL = 4.5
"""Deviations of the mean within which a recording begins where the scenario does."""


class Track:
    """A recording with the simulation that is fitted to it."""

    def __init__(self, scenario: Scenario, robot: Robot, data: Data) -> None:
        self.data, self._robot = data, robot
        self.scenario = _scenario(scenario, data)
        self.given_substeps = scenario.substeps is not None
        """Whether the user has chosen them."""
        self.prepared = prepare(self.scenario, robot)
        self.evaluation = Evaluation(self.prepared)
        self._other: tuple[Prepared, Evaluation] | None = None
        """Those of the substeps before: fits go to and fro between two."""
        joints = self.evaluation.joints
        self.wanted = [(joints.index(channel.joint), channel.quantity) for channel in data.channels]
        self._commands: tuple[object, Mapping[str, Mapping[str, Signal]]] | None = None
        self.held: frozenset[str] = frozenset()
        """Keys of commands that are played as stairs: what gave them held each sample until the next."""
        self.early: dict[str, float] = {}
        """Key of a command's large jump -> s by which it comes before its sample, where no value is given."""
        self.uncertain: list[str] = []
        """Keys of starts that are not the scenario's: joints that begin elsewhere, or in motion."""
        self.positions, self.velocities, self.motors = self._start()
        self._forget_what_commands_explain()
        self.onset = min(self._onset(channel) for channel in data.channels)
        """s at which something begins to move."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What is compared."""
        return self.data.channels

    def trust_scenario(self, joint: str, quantity: str) -> None:
        """The link, or the joint's motors, begin where the scenario says: what the recording shows is an offset."""
        if quantity != "link_position":
            self.motors.pop(joint, None)
            return
        j = self.evaluation.joints.index(joint)
        self.positions[j] = self.prepared.initial_positions[j]
        self.uncertain = [key for key in self.uncertain if key != f"{joint}.initial_position"]

    def _onset(self, channel: Channel) -> float:
        away = np.abs(channel.values - np.median(channel.values[:5])) > 8.0 * max(channel.noise, channel.quantum)
        return float(channel.time[int(np.argmax(away))]) if away.any() else float(channel.time[-1])

    def _start(self) -> tuple[list[float], list[float], dict[str, list[float]]]:
        """Where links and motors are at 0: the scenario's start where the recording does not contradict it."""
        positions, velocities = [*self.prepared.initial_positions], [*self.prepared.initial_velocities]
        motors: dict[str, list[float]] = {}
        for j, joint in enumerate(self.evaluation.joints):
            channel = self._channel(joint, "link_position")
            found = None if channel is None else first_samples(channel)
            if channel is None or found is None:
                continue
            place, speed, place_error, speed_error = found
            moving = abs(speed) > STILL * speed_error
            if not moving:
                place, place_error = min((place, place_error), at_rest(channel), key=lambda told: told[1])
            # A start that is no round number was read off a recording, with its noise.
            measured = positions[j] != round(positions[j], DIGITS) and not self.scenario.initial_equilibrium
            if abs(place - positions[j]) > STILL * place_error or moving or measured:
                positions[j] = place
                self.uncertain.append(f"{joint}.initial_position")
                if moving:
                    velocities[j] = speed
                    self.uncertain.append(f"{joint}.initial_velocity")
        for j, drive in enumerate(self.prepared.drives):
            first = [self._channel(drive.name, f"motor_{i}_position") for i in range(1, drive.dynamic_motors + 1)]
            told = [at_rest(channel) for channel in first if channel is not None and channel.time[0] <= SOON]
            if not told or len(told) < len(first):
                continue
            home = drive.motor_positions or (positions[j],) * len(told)
            if any(abs(place - was) > STILL * error for (place, error), was in zip(told, home, strict=True)):
                motors[drive.name] = [place for place, _ in told]
                if self._channel(drive.name, "link_position") is None:
                    # What rests on its motors begins with them.
                    positions[j] += float(np.mean(motors[drive.name]) - np.mean(home))
        return positions, velocities, motors

    def _forget_what_commands_explain(self) -> None:
        """A link that only seems to be in motion at 0, because its commands move it at once, begins as the scenario says."""
        moving = [key for key in self.uncertain if key.endswith(".initial_velocity")]
        if not moving:
            return
        # A track of another kind is not made yet.
        found = Track.predict(self, dict(zip(self._starts(), self._home(), strict=True)), SOON)
        if found is None:
            return
        channels = {channel.key: (channel, predicted) for channel, predicted in zip(self.channels, found, strict=True)}
        for joint in [key.rpartition(".")[0] for key in moving]:
            channel, predicted = channels[f"{joint}.link_position"]
            n = len(predicted)
            first = first_samples(replace(channel, time=channel.time[:n], values=channel.values[:n] - predicted))
            if first is not None and abs(first[0]) < STILL * first[2] and abs(first[1]) < STILL * first[3]:
                j = self.evaluation.joints.index(joint)
                self.positions[j], self.velocities[j] = self.prepared.initial_positions[j], self.prepared.initial_velocities[j]
                self.uncertain = [one for one in self.uncertain if one.rpartition(".")[0] != joint]

    def _starts(self) -> list[str]:
        names = self.evaluation.joints
        return [*(f"{one}.initial_position" for one in names), *(f"{one}.initial_velocity" for one in names)]

    def _home(self) -> list[float]:
        return [*self.prepared.initial_positions, *self.prepared.initial_velocities]

    def _channel(self, joint: str, quantity: str) -> Channel | None:
        return next((one for one in self.channels if (one.joint, one.quantity) == (joint, quantity)), None)

    def references(self, values: Mapping[str, float], draw: Draw | None = None) -> Mapping[str, Mapping[str, Signal]]:
        """Commands with the gains, offsets and delays among `values`; the same object while nothing of it changes."""
        numbers = tuple(
            values.get(f"{command.key}.{what}", 1.0 if what == "gain" else 0.0)
            for command in self.data.commands
            for what in ("gain", "offset", "delay")
        )
        early = {key: value for key, value in {**self.early, **values}.items() if f".{JUMP}" in key}
        if self._commands is None or self._commands[0] != (self.held, numbers, early, draw):
            table: dict[str, dict[str, Signal]] = {}
            for i, command in enumerate(drawn(self.data.commands, draw)):
                gain, offset, delay = numbers[3 * i : 3 * i + 3]
                played = command.as_stairs if command.key in self.held else command
                moves = {n: early.get(f"{command.key}.{JUMP}{n + 1}", 0.0) for n in range(len(played.curve.large)) if early}
                signal = Played(
                    command=played, step=self.prepared.substep, gain=gain, offset=offset, delay=delay, early=moves
                )  # fmt: skip
                table.setdefault(command.joint, {})[command.name] = signal
            self._commands = (self.held, numbers, early, draw), table
        return self._commands[1]

    def predict(self, values: Mapping[str, float], until: float | None = None, draw: Draw | None = None) -> list[Array] | None:
        """Each channel at its recorded times up to `until` s, shorter then; None where the motion is not sane.

        draw: noise that is added to the recorded inputs.
        """
        robot, positions, velocities = self._split(values)
        steps = None if until is None else max(4, int(np.ceil((until + 0.3) / self.scenario.step)))
        try:
            found = self.simulated(robot, positions, velocities, self.references(values, draw), steps)
        except (DivergenceError, RobotError):
            return None
        clock = values.get(CLOCK, 0.0)
        predicted = []
        for channel, series in zip(self.channels, found, strict=True):
            time = channel.time if until is None else channel.time[channel.time <= until + 1e-9]
            shift = clock + values.get(f"{channel.key}.delay", 0.0)
            exact = interpolate(series, (time - shift) / self.scenario.step)
            gain, offset = values.get(f"{channel.key}.gain", 1.0), values.get(f"{channel.key}.offset", 0.0)
            predicted.append(exact / gain + offset)
        return predicted

    def series(self, values: Mapping[str, float], wanted: Sequence[tuple[int, str]]) -> Array | None:
        """Quantities (joint's number, name) at whole steps, whether they were recorded or not; None as :meth:`predict`."""
        robot, positions, velocities = self._split(values)
        try:
            return self.evaluation.run(
                robot,
                wanted,
                references=self.references(values),
                positions=positions,
                velocities=velocities,
                motors=self.motors,
            )
        except (DivergenceError, RobotError):
            return None

    @property
    def has_noisy_inputs(self) -> bool:
        """Whether the recorded commands have noise that moves anything."""
        return any(noise_of_command(one) > 2e-6 * np.ptp(one.values) for one in self.data.commands)

    def shaken(self, values: Mapping[str, float], draw: int = 0) -> list[Array] | None:
        """By how much noise as the recorded inputs have it moves each channel (n,): one draw; None where it moves nothing."""
        if not self.has_noisy_inputs:
            return None
        before, after = self.predict(values), self.predict(values, None, Draw(draw))
        return None if before is None or after is None else [a - b for a, b in zip(after, before, strict=True)]

    def simulated(
        self, robot: Mapping[str, Mapping[str, float]], positions: Sequence[float], velocities: Sequence[float],
        references: Mapping[str, Mapping[str, Signal]], steps: int | None,
    ) -> Array:  # fmt: skip
        """(channels, samples) at whole steps, at least as many as `steps`; raises DivergenceError, RobotError."""
        return self.evaluation.run(
            robot, self.wanted, steps=steps, references=references, positions=positions, velocities=velocities,
            motors=self.motors,
        )  # fmt: skip

    def resolution(self, values: Mapping[str, float]) -> tuple[int, int]:
        """Substeps, and the motors' in each, that a run with these numbers takes. Raises RobotError, UnresolvedSpringError."""
        found = resolution_of(replace(self.prepared.vary(self._split(values)[0]), scenario=self.scenario))
        return found.substeps, found.motor_substeps

    def resolve(self, substeps: int, motor_substeps: int) -> None:
        """Run with so many substeps from now on."""
        wanted = substeps, motor_substeps
        if wanted == _substeps(self.prepared):
            return
        other, self._other = self._other, (self.prepared, self.evaluation)
        if other is not None and wanted == _substeps(other[0]):
            self.prepared, self.evaluation = other
        else:
            if other is not None:
                other[1].close()
            scenario = replace(self.scenario, substeps=substeps, motor_substeps=motor_substeps)
            self.prepared = prepare(scenario, self._robot)
            self.evaluation = Evaluation(self.prepared)
        self._commands = None

    def _split(self, values: Mapping[str, float]) -> tuple[dict[str, dict[str, float]], list[float], list[float]]:
        """Numbers of the robot, by joint or link, and the start."""
        positions, velocities = [*self.positions], [*self.velocities]
        for key, value in values.items():
            owner, _, name = key.rpartition(".")
            if name == "initial_position":
                positions[self.evaluation.joints.index(owner)] = value
            elif name == "initial_velocity":
                velocities[self.evaluation.joints.index(owner)] = value
        return numbers_of(values), positions, velocities

    def close(self) -> None:
        """Release the engines."""
        self.evaluation.close()
        if self._other is not None:
            self._other[1].close()


def _substeps(prepared: Prepared) -> tuple[int, int]:
    return prepared.resolution.substeps, prepared.resolution.motor_substeps


def _scenario(scenario: Scenario, data: Data) -> Scenario:
    """Of the recording's length and modes, in the fast engine where it does the same."""
    engine = scenario.engine
    faster = ENGINES.get(engine).faster
    if faster and scenario.world.empty and ENGINES.get(faster).available:
        engine = faster
    modes = {**scenario.modes, **data.modes}
    # References of another mode would be unknown there; what is played replaces them all.
    references = {joint: dict(signals) for joint, signals in scenario.references.items() if joint not in data.modes}
    step = scenario.step
    for command in data.commands:
        if command.name != EXTERNAL:
            references[command.joint] = {
                **references.get(command.joint, {}), command.name: Played(command=command, step=step)
            }  # fmt: skip
    return replace(
        scenario, duration=data.duration, modes=modes, engine=engine, references=references, expect=(), desired={}, log_every=1
    )  # fmt: skip


def numbers_of(values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Those of the robot, by joint or link."""
    robot: dict[str, dict[str, float]] = {}
    for key, value in values.items():
        owner, _, name = key.rpartition(".")
        if owner and name not in NOT_THE_ROBOTS and not name.startswith(JUMP):
            robot.setdefault(owner, {})[name] = value
    return robot
