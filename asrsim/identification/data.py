"""Recordings prepared for a fit: played commands, compared channels and their noise."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path

import numpy as np

from asrsim.actuators import ACTUATORS, MODES, Mode
from asrsim.errors import InputError, Problem, RecordingError
from asrsim.identification.door import COMPARABLE, EXTERNAL
from asrsim.identification.noise import fine_noise, quantum_of
from asrsim.identification.task import Experiment, Task
from asrsim.quantities import unit_of
from asrsim.recordings import read_recording
from asrsim.recordings.data import Column
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.scenario.starter_recording import RecordingPlan, make_plan
from asrsim.signals.curve import Curve, curve_through

CIRCULAR = "they were computed from other columns, not measured: a fit to them would be circular"
PLACED = "drives compute velocities from their positions, which are compared"
ADJUSTED = "an adjuster stands at its reference"
PLAYED = 2
"""Operation mode in which motors follow their references exactly."""
COMPUTED = 1e-3
"""Relative residual of a linear regression on another column below which a column counts as computed from it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Guide:
    """Controller that brings a simulated joint back to its recorded position."""

    command: str
    """Key of the command with the recorded torque."""
    positions: Array
    """Recorded positions (n,) at the channel's times."""
    stiffness: float
    """Proportional gain of the controller, N m/rad."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """A measured quantity of a joint."""

    joint: str
    quantity: str
    unit: str
    time: Array
    """Times (n,) on the simulation's clock, s."""
    values: Array
    """Finite values (n,) in SI units."""
    noise: float
    """Standard deviation of the channel's noise, given or estimated from third differences."""
    quantum: float
    """Step of a quantised encoder; 0: not quantised."""
    guide: Guide | None = None
    """Controller whose torque is compared, if a recorded torque drives the joint."""

    @property
    def key(self) -> str:
        """Key of the channel: `joint.quantity`."""
        return f"{self.joint}.{self.quantity}"

    def until(self, end: float) -> int:
        """Number of samples up to a time, s."""
        return int(np.sum(self.time <= end + 1e-9))

    @property
    def floor(self) -> float:
        """Smallest standard deviation that noise and quantisation allow."""
        return max(self.noise, self.quantum / float(np.sqrt(12.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class PlayedCommand:
    """A recorded input, which the simulation plays."""

    joint: str
    quantity: str
    """Kind of the command: reference_1, reference_2 or external_torque."""
    name: str
    """Name of the reference in the joint's mode, or `external_torque`."""
    time: Array
    values: Array
    hold: bool
    source: str
    """Column of the recording that contains the command."""
    unit: str
    scale: float = 1.0
    """Factor between the recorded quantity and the reference."""
    guide: Curve | None = None
    """Curve that is added to the reference."""

    @property
    def key(self) -> str:
        """Key of the command, such as `joint.reference_1`."""
        return f"{self.joint}.{self.quantity}"

    @cached_property
    def curve(self) -> Curve:
        """Curve of the command through the recorded samples."""
        return curve_through(self.time, self.values, hold=self.hold)

    @cached_property
    def as_stairs(self) -> PlayedCommand:
        """Command that is constant between samples, each sample until the next."""
        return self if self.hold else replace(self, hold=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Data:
    """A recording that is prepared for a fit."""

    name: str
    path: Path
    duration: float
    """Length of the recording, s."""
    channels: tuple[Channel, ...]
    commands: tuple[PlayedCommand, ...]
    modes: Mapping[str, int]
    """Operation modes, by joint, that replace the robot's modes to suit the commands."""
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Parameters of controllers that replace the robot's parameters, by joint."""
    guides: tuple[Channel, ...] = ()
    """Recorded positions that joints follow exactly and that are therefore not compared."""
    remarks: tuple[str, ...] = ()
    held: bool
    """Whether the recording only validates the fit: it is predicted but not fitted."""


def read_data(task: Task, scenario: Scenario, robot: Robot) -> list[Data]:
    """Read all recordings; the fitted recordings come first. Raises InputError with the problems of all recordings."""
    found: list[Data] = []
    problems: list[Problem] = []
    for held, experiments in ((False, task.experiments), (True, task.validate)):
        for experiment in experiments:
            try:
                found.append(_read(task, experiment, scenario, robot, held=held))
            except InputError as error:
                problems += error.problems
    if problems:
        raise InputError(problems)
    return found


def _read(task: Task, experiment: Experiment, scenario: Scenario, robot: Robot, *, held: bool) -> Data:
    joints = [joint.name for joint in robot.moving_joints]
    recording = read_recording(experiment.file, mapping=list(experiment.mapping) or None, joints=joints, rate=experiment.rate)
    plan = make_plan(robot, recording, step=scenario.step, strict=True)
    lag = plan.lag
    remarks = [*plan.remarks]
    modes = dict(plan.modes)
    commands = [*_commands(plan, lag), *_played_motors(scenario, plan, lag, modes, remarks)]
    played = {(command.joint, command.source) for command in commands}
    channels = tuple(_channels(task, plan, lag, played, modes, remarks))
    if not channels:
        known = ", ".join(f"{joint}.{column.quantity}" for joint, column in plan.compared) or "no channel"
        message = f"no channel of the recording is compared; its channels are {known}"
        hint = "; ".join(remarks) or None
        raise RecordingError(message, file=recording.path, key="compare", hint=hint, code="nothing-compared")
    if not any(np.ptp(channel.values) > 8.0 * max(channel.noise, channel.quantum) for channel in channels):
        message = "no channel moves by more than its noise, so no parameter can be identified"
        raise RecordingError(message, file=recording.path, code="nothing-moves")
    end, step = max(float(channel.time[-1]) for channel in channels), scenario.step
    return Data(
        name=experiment.file.name, path=experiment.file, duration=round(max(1.0, np.floor(end / step + 1e-6)) * step, 12),
        channels=channels, commands=tuple(commands), modes=modes,
        remarks=tuple(remarks), held=held,
    )  # fmt: skip


def _commands(plan: RecordingPlan, lag: float) -> Iterator[PlayedCommand]:
    modes = {block.joint: MODES[block.mode] for block in plan.robot.actuators}
    for one in plan.played:
        name = EXTERNAL if one.slot is None else modes[one.joint].references[one.slot]
        quantity = EXTERNAL if one.slot is None else f"reference_{one.slot + 1}"
        yield _command(one.joint, quantity, name, one.column, lag, hold=one.hold)


def _command(joint: str, quantity: str, name: str, column: Column, lag: float, *, hold: bool) -> PlayedCommand:
    good = np.isfinite(column.values)
    return PlayedCommand(
        joint=joint, quantity=quantity, name=name, time=column.time[good] - lag, values=column.values[good], hold=hold,
        source=column.source, unit=column.unit,
    )  # fmt: skip


def _played_motors(
    scenario: Scenario, plan: RecordingPlan, lag: float, modes: dict[str, int], remarks: list[str]
) -> Iterator[PlayedCommand]:
    """Recorded motor positions that are played as commands, for joints without a recorded command or a reference in the
    scenario. Springs and links are then fitted without the motors' dynamics. Raises RecordingError if the motor positions are
    missing too.
    """
    commanded = {one.joint for one in plan.played if one.slot == 0}
    motors = {(joint, str(column.quantity)): column for joint, column in plan.compared}
    missing = []
    for block in plan.robot.actuators:
        actuator, mode = ACTUATORS.get(block.actuator), MODES[block.mode]
        # `init` writes recorded motor positions as references of mode 2.
        if block.joint in commanded or (scenario.references_of(block.joint) and block.mode != PLAYED):
            continue
        wanted = [f"motor_{i}_position" for i in range(1, (2 if actuator.motors > 1 or actuator.adjuster else 1) + 1)]
        if not mode.spring or any((block.joint, quantity) not in motors for quantity in wanted):
            if any(joint == block.joint for joint, _ in motors):
                missing.append(block.joint)
            continue
        modes[block.joint] = PLAYED
        remarks.append(f"{block.joint}: no command was recorded; its motors are played as recorded (mode {PLAYED})")
        for slot, quantity in enumerate(wanted):
            column = motors[block.joint, quantity]
            name = MODES[PLAYED].references[slot]
            yield _command(block.joint, f"reference_{slot + 1}", name, column, lag, hold=False)
    if missing:
        columns = ", ".join(list(plan.recording.channels)[:30])
        raise RecordingError(
            f"the commands of {', '.join(missing)} are missing in the columns and in the scenario; "
            f"its columns: {columns}", file=plan.recording.path, code="no-command",
            hint=f"Name it: --map COLUMN={missing[0]}.reference_1, or write references into the scenario",
        )  # fmt: skip


def _channels(
    task: Task, plan: RecordingPlan, lag: float, played: set[tuple[str, str]], modes: Mapping[str, int], remarks: list[str]
) -> Iterator[Channel]:
    wanted = set(task.compare)
    possible = {
        f"{joint}.{column.quantity}": (joint, column)
        for joint, column in plan.compared
        if column.quantity in COMPARABLE and (joint, column.source) not in played
    }
    unknown = [key for key in task.compare if key not in possible]
    if unknown:
        problem = Problem(
            "is not in the recording, or is its command", key=unknown[0], file=plan.recording.path,
            choices=tuple(possible), code="unknown-key",
        )  # fmt: skip
        raise RecordingError(problem)
    computed = computed_columns(list(plan.recording.channels.values()), {column.source for _, column in possible.values()})
    left_out: dict[str, list[str]] = {}
    acting = {block.joint: MODES[modes.get(block.joint, block.mode)] for block in plan.robot.actuators}
    adjusted = {f"{block.joint}.motor_2_position" for block in plan.robot.actuators if ACTUATORS.get(block.actuator).adjuster}
    for key, (joint, column) in possible.items():
        quantity = str(column.quantity)
        if wanted and key not in wanted:
            continue
        reason = None if key in wanted else _left_out(quantity, acting.get(joint), column.source in computed)
        if key in adjusted and not wanted:
            reason = ADJUSTED
        if quantity.endswith("velocity") and key.replace("velocity", "position") in possible and not wanted:
            reason = PLACED
        if reason is not None:
            of = f" (of {computed[column.source]})" if reason == CIRCULAR else ""
            left_out.setdefault(reason, []).append(f"{key}{of}")
            continue
        channel = _channel(task, joint, column, lag, remarks, prismatic=plan.robot.joint(joint).kind == "prismatic")
        if channel is not None:
            yield channel
    remarks += [f"not compared, since {reason}: {', '.join(keys)}" for reason, keys in left_out.items()]


def computed_columns(columns: Sequence[Column], mapped: Collection[str]) -> dict[str, str]:
    """Mapped columns that are multiples of another column, with the name of the other column. If both columns are mapped, the
    column with the position counts as measured.
    """
    found: dict[str, str] = {}
    moving = [c for c in columns if np.isfinite(c.values).all() and np.ptp(c.values) > 0.0]
    for pair in combinations(moving, 2):
        early, late = sorted(pair, key=lambda c: (c.source in mapped, not str(c.quantity).endswith("position")))
        if len(late.time) != len(early.time) or late.source not in mapped or {late.source, early.source} & found.keys():
            continue
        if early.source not in mapped and np.array_equal(early.values, late.values):
            continue  # a column that copies another measurement, such as another topic of a log
        a, b = (c.values - c.values.mean() for c in (early, late))
        if float(np.linalg.norm(b - a * float(a @ b / (a @ a)))) < COMPUTED * float(np.linalg.norm(b)):
            found[late.source] = f"'{early.source}'"
    return found


def _left_out(quantity: str, mode: Mode | None, computed: bool) -> str | None:
    """Reason why a quantity is not compared by default; None if it is compared."""
    if mode and not mode.motor and quantity.startswith(("motor", "friction", "equilibrium")):
        return f"motors stand at their references in mode {mode.number} ({mode.name})"
    if mode and not mode.spring and quantity.startswith(("elastic", "deflection")):
        return f"mode {mode.number} ({mode.name}) has no spring"
    return CIRCULAR if computed else None


def _channel(
    task: Task, joint: str, column: Column, lag: float, remarks: list[str], *, prismatic: bool
) -> Channel | None:  # fmt: skip
    quantity = str(column.quantity)
    key = f"{joint}.{quantity}"
    good = np.isfinite(column.values) & (column.time - lag >= -1e-9)
    time, values = column.time[good] - lag, column.values[good]
    if len(values) < 3 or not np.ptp(values) > 0.0:
        remarks.append(f"{key} is not compared: it never changes")
        return None
    quantum = quantum_of(values)
    noise = task.noise.get(key) or fine_noise(values, quantum)
    unit = unit_of(quantity, prismatic=prismatic) or column.unit
    return Channel(
        joint=joint, quantity=quantity, unit=unit, time=time, values=values, noise=noise, quantum=quantum,
    )  # fmt: skip
