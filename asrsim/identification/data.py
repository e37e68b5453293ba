"""Recordings that are prepared for a fit: commands that the simulation plays, and channels that are compared with it, with
their noise.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import InputError, Problem, RecordingError
from asrsim.identification.door import EXTERNAL, comparable, stage_of
from asrsim.identification.noise import MOVES, fine_noise, quantum_of
from asrsim.identification.payload import fault_of
from asrsim.identification.task import Experiment, Payload, Task
from asrsim.joint_units import reference_unit
from asrsim.quantities import PRISMATIC_UNITS, unit_of
from asrsim.recordings import read_recording
from asrsim.recordings.data import Column
from asrsim.recordings.suspicions import gear_between
from asrsim.robot.model import Robot
from asrsim.robot.mounting import reference_names
from asrsim.robot.values import stage_acts
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.scenario.recording_plan import RecordingPlan, make_plan
from asrsim.signals.curve import CubicCurve, curve_through

PLAYED = 2
"""Operation mode in which motors follow their references exactly."""
APART = 3.0
"""The zero offset of a motor's position sensor becomes a free parameter if it exceeds this number of standard deviations. The
zero offset is the median of motor position minus link position minus deflection. Noise alone exceeds three standard deviations
once in 400 times.
"""
COMPUTED = 1e-3
"""A column counts as computed from another column if the relative residual of a linear regression on the other column is below
this value. The rounding of a file leaves a smaller residual, and a second sensor leaves a larger one.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedSignal:
    """A recorded series of a joint."""

    joint: str
    quantity: str
    """Name of the measured quantity. The name of a command is reference_1, reference_2 or external_torque."""
    unit: str
    time: Array
    """Times (n,) on the simulation's clock, s."""
    values: Array
    """Finite values (n,) in SI units."""

    @property
    def key(self) -> str:
        """Key of the series: `joint.quantity`."""
        return f"{self.joint}.{self.quantity}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel(RecordedSignal):
    """A measured quantity of a joint."""

    noise: float
    """Standard deviation of the channel's noise. The user states it, or it is estimated from differences of its samples."""
    quantum: float
    """Quantisation step of the sensor; 0: the channel is not quantised."""
    column: Column | None = None
    """Recorded column; None for values without a file."""

    def until(self, end: float) -> int:
        """Number of samples up to a time, s."""
        return int(np.searchsorted(self.time, end + 1e-9, side="right"))

    @property
    def floor(self) -> float:
        """Smallest standard deviation of residuals that the channel's noise and quantisation allow."""
        return max(self.noise, self.quantum / float(np.sqrt(12.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class PlayedCommand(RecordedSignal):
    """A recorded command, which the simulation plays as its input."""

    name: str
    """Name of the reference in the joint's operation mode, or `external_torque`."""
    hold: bool
    column: Column | None = None
    """Recorded column; None for values without a file."""

    @property
    def is_motion(self) -> bool:
        """Whether the command is a recorded motion of a motor, which is smooth, and not what a controller sent."""
        return self.column is not None and str(self.column.quantity).startswith("motor")

    @cached_property
    def curve(self) -> CubicCurve:
        """Curve of the command through the recorded samples."""
        return curve_through(self.time, self.values, hold=self.hold)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the command's noise; 0 if the noise is negligible."""
        noise = fine_noise(self.values, time=self.time) if not self.hold and len(self.values) > 8 else 0.0
        return noise if noise > 2e-6 * np.ptp(self.values) else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Data:
    """A recording that is prepared for a fit."""

    name: str
    path: Path
    duration: float
    """Length of the recording, s."""
    lag: float = 0.0
    """Time of the recording's clock at time 0 of the simulation, s."""
    rate: float | None = None
    """Sampling rate of a recording without time, Hz."""
    channels: tuple[Channel, ...]
    commands: tuple[PlayedCommand, ...]
    modes: Mapping[str, int]
    """Operation modes, by joint, that replace the robot's modes to suit the commands."""
    torques: Mapping[str, str]
    """Names of the columns with the torque of each joint's drive, by joint."""
    remarks: tuple[str, ...] = ()
    zeros: Mapping[str, float] = field(default_factory=dict)
    """Zero offsets of motor position sensors relative to the joint's other sensors, rad, by key. Only offsets that exceed the
    noise are included.
    """
    payload: Payload | None = None
    """Known body that the robot carries in this recording."""
    predicted_only: bool = False
    """Whether the recording only validates the fit: it is predicted but not fitted."""


def read_data(task: Task, scenario: Scenario, robot: Robot) -> list[Data]:
    """Read all recordings; the fitted recordings come first. Raises InputError with the problems of all recordings."""
    found: list[Data] = []
    problems: list[Problem] = []
    for number, experiment in enumerate((*task.experiments, *task.validate)):
        try:
            if experiment.payload and (fault := fault_of(robot, experiment.payload)):
                raise InputError(replace(fault, file=task.file))
            data = _read(task, experiment, scenario, robot)
            found.append(replace(data, predicted_only=number >= len(task.experiments)))
        except InputError as error:
            problems += error.problems
    if task.experiments[0].payload:
        message = "the first recording has a payload, but the scenario that the fit writes repeats this recording without it"
        hint = "List a recording without payload first, or add the payload to the robot file"
        problems.append(Problem(message, file=task.file, key="experiments.0.payload", hint=hint, code="payload"))
    if problems:
        raise InputError(problems)
    return found


def _read(task: Task, experiment: Experiment, scenario: Scenario, robot: Robot) -> Data:
    joints = [joint.name for joint in robot.moving_joints]
    recording = read_recording(experiment.file, mapping=list(experiment.mapping) or None, joints=joints, rate=experiment.rate)
    # Joints whose references the recording may replace. Mode 2 is included, since `init` writes recorded motor positions as
    # references of mode 2.
    idle = [block.joint for block in robot.actuators if block.mode == PLAYED or not scenario.references_of(block.joint)]
    plan = make_plan(robot, recording, step=scenario.step, idle=idle)
    commanded, recorded = {one.joint for one in plan.played if one.slot == 0}, {joint for joint, _ in plan.compared}
    missing = [joint for joint in idle if joint in recorded - commanded and not scenario.references_of(joint)]
    if missing:
        raise RecordingError(
            f"the commands of {', '.join(missing)} are missing in the recording and in the scenario; "
            f"the columns of the recording are {', '.join(list(recording.channels)[:30])}",
            file=recording.path,
            code="no-command",
            hint=f"Name the column: --map COLUMN={missing[0]}.reference_1, or write references into the scenario",
        )
    exceeded = [one for one in plan.exceeded if f"{one.joint}.{one.parameter}" not in task.free]
    remarks = [*recording.doubts, *plan.remarks, *map(str, exceeded)]
    channels = tuple(_channels(task, plan, remarks))
    if not channels:
        known = ", ".join(f"{joint}.{column.quantity}" for joint, column in plan.compared) or "no channel"
        message = f"no channel of the recording is compared; its channels are {known}"
        hint = "; ".join(remarks) or None
        raise RecordingError(message, file=recording.path, hint=hint, code="nothing-compared")
    if not any(np.ptp(channel.values) > MOVES * max(channel.noise, channel.quantum) for channel in channels):
        message = "no channel moves by more than its noise, so no parameter can be identified"
        raise RecordingError(message, file=recording.path, code="nothing-moves")
    end, step = max(float(channel.time[-1]) for channel in channels), scenario.step
    zeros = dict(_zeros({channel.key: channel for channel in channels}, robot))
    remarks += [
        f"{key} is estimated, too: the motor's position differs from link position plus deflection by {value:.3g} rad, so "
        "their sensors have different zero offsets"
        for key, value in zeros.items()
    ]
    return Data(
        name=experiment.file.name, path=recording.path, lag=float(plan.lag), rate=experiment.rate,
        duration=round(max(4.0, np.floor(end / step + 1e-6)) * step, 12),
        channels=channels, commands=tuple(_commands(plan)), modes=plan.modes, remarks=tuple(remarks), zeros=zeros,
        payload=experiment.payload,
        torques={joint: column.source for joint, column in plan.compared if column.quantity == "link_torque"},
    )  # fmt: skip


def _commands(plan: RecordingPlan) -> Iterator[PlayedCommand]:
    blocks = {block.joint: block for block in plan.robot.actuators}
    for one in plan.played:
        column, good = one.column, np.isfinite(one.column.values)
        # A mapped command without a unit has the unit of the reference in the joint's mode.
        unit, block = column.unit, blocks.get(one.joint)
        if not unit and block is not None and one.slot is not None:
            unit = reference_unit(ACTUATORS.get(block.actuator), MODES[block.mode], one.slot + 1)
        prismatic = plan.robot.joint(one.joint).kind == "prismatic"
        yield PlayedCommand(
            joint=one.joint, quantity=EXTERNAL if one.slot is None else f"reference_{one.slot + 1}",
            name=EXTERNAL if one.slot is None else reference_names(blocks[one.joint])[one.slot],
            time=column.time[good] - plan.lag, values=column.values[good],
            hold=one.hold and not str(column.quantity).startswith("motor"), column=column,
            unit=PRISMATIC_UNITS.get(unit, unit) if prismatic else unit,
        )  # fmt: skip


def _channels(task: Task, plan: RecordingPlan, remarks: list[str]) -> Iterator[Channel]:
    """Channels that are compared with the simulation: all measured quantities that the simulation computes."""
    known = comparable()
    possible = {f"{joint}.{column.quantity}": (joint, column) for joint, column in plan.compared if column.quantity in known}
    computed = computed_columns(list(plan.recording.channels.values()), {column.source for _, column in possible.values()})
    blocks, left_out = {block.joint: block for block in plan.robot.actuators}, dict[str, list[str]]()
    for key, (joint, column) in possible.items():
        quantity, block = str(column.quantity), blocks.get(joint)
        mode = MODES[block.mode] if block else None
        good = np.isfinite(column.values) & (column.time - plan.lag >= -1e-9)
        time, values = column.time[good] - plan.lag, column.values[good]
        reason, stage = "", stage_of(quantity)
        if stage is not None and not (block and stage_acts(stage, block)):
            names = ", ".join(one.name for one in stage.parameters)
            reason = (
                f"the stage '{stage.title}' is off at the start of the fit; to compare this quantity, state in the "
                f"scenario values of its parameters ({names}) that switch the stage on"
            )
        elif block and ACTUATORS.get(block.actuator).adjuster and quantity == "motor_2_position":
            reason = "an adjuster follows its reference exactly"
        elif quantity.endswith("velocity") and key.replace("velocity", "position") in possible:
            reason = "drives compute velocities from positions, and the positions are compared"
        elif mode and not mode.motor and quantity.startswith(("motor", "friction", "equilibrium")):
            reason = f"motors follow their references exactly in mode {mode.number} ({mode.name})"
        elif mode and not mode.spring and quantity.startswith(("elastic", "deflection")):
            reason = f"mode {mode.number} ({mode.name}) has no spring"
        elif quantity.endswith("position") and (
            gear := gear_between(column, possible.get(f"{joint}.link_position", (joint, None))[1])
        ):
            reason = (
                f"it moves {abs(gear):.4g} times as far as the link; if it was measured before the gear, convert it: --map "
                f"'{column.source}={1.0 / gear:.4g}*{key}'"
            )
        elif column.source in computed:
            reason = f"it was computed from '{computed[column.source]}', not measured: a fit to it would be circular"
        elif len(values) < 3 or not np.ptp(values) > 0.0:
            reason = "it never changes"
        if reason:
            left_out.setdefault(reason, []).append(key)
        else:
            quantum, prismatic = quantum_of(values), plan.robot.joint(joint).kind == "prismatic"
            yield Channel(
                joint=joint, quantity=quantity, unit=unit_of(quantity, prismatic=prismatic) or column.unit, time=time,
                values=values, noise=task.noise.get(key) or fine_noise(values, quantum, time), quantum=quantum, column=column,
            )  # fmt: skip
    remarks += [f"not compared, since {reason}: {', '.join(keys)}" for reason, keys in left_out.items()]


def _zeros(channels: Mapping[str, Channel], robot: Robot) -> Iterator[tuple[str, float]]:
    """Keys and values of the zero offsets of motor position sensors. Only joints with one motor have such keys, if link
    position and spring deflection are also measured.
    """
    for joint in (block.joint for block in robot.actuators if ACTUATORS.get(block.actuator).motors == 1):
        motor, *others = (channels.get(f"{joint}.{what}") for what in ("motor_1_position", "link_position", "deflection"))
        known = [one for one in others if one is not None]
        if motor is None or len(known) < 2:
            continue
        inside = (motor.time >= max(one.time[0] for one in known)) & (motor.time <= min(one.time[-1] for one in known))
        apart = motor.values[inside] - sum(np.interp(motor.time[inside], one.time, one.values) for one in known)
        zero = float(np.median(apart)) if inside.any() else 0.0
        if abs(zero) > APART * max(float(np.std(apart)), motor.floor):
            yield f"{motor.key}.offset", zero


MEASURED = ("position", "deflection")
"""Endings of quantities that count as measured if two columns depend linearly on each other. Drives compute spring torques from
measured deflections, for example.
"""


def computed_columns(columns: Sequence[Column], mapped: Collection[str]) -> dict[str, str]:
    """Mapped columns that are linear functions of another column, each with the name of the other column. If both columns are
    mapped, the column with the position or deflection counts as measured, and the other column as computed.
    """
    found: dict[str, str] = {}
    moving = [c for c in columns if np.isfinite(c.values).all() and np.ptp(c.values) > 0.0]
    for pair in combinations(moving, 2):
        early, late = sorted(pair, key=lambda c: (c.source in mapped, not str(c.quantity).endswith(MEASURED)))
        if len(late.time) != len(early.time) or late.source not in mapped or {late.source, early.source} & found.keys():
            continue
        # Accept a position that depends on an unmapped column, since the position may have been converted from the counts of
        # its encoder. Accept an exact copy of an unmapped column, since a log may contain the same values in two topics.
        converted = str(late.quantity).endswith("position") or np.array_equal(early.values, late.values)
        if early.source not in mapped and converted:
            continue
        if 1.0 - np.corrcoef(early.values, late.values)[0, 1] ** 2 < COMPUTED**2:
            found[late.source] = early.source
    return found
