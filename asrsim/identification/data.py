"""Recordings prepared for a fit: played commands, compared channels and their noise."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import InputError, Problem, RecordingError
from asrsim.identification.door import COMPARABLE, EXTERNAL
from asrsim.identification.noise import bandwidth, fine_noise, quantum_of, smoothed
from asrsim.identification.task import Experiment, Task
from asrsim.quantities import unit_of
from asrsim.recordings import read_recording
from asrsim.recordings.data import Column
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.scenario.recording_plan import RecordingPlan, make_plan
from asrsim.signals.curve import Curve, curve_through

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
class Recorded:
    """A recorded series of a joint."""

    joint: str
    quantity: str
    """Measured quantity; of a command: reference_1, reference_2 or external_torque."""
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
class Channel(Recorded):
    """A measured quantity of a joint."""

    noise: float
    """Standard deviation of the channel's noise, given or estimated from third differences."""
    quantum: float
    """Step of a quantised encoder; 0: not quantised."""
    column: Column | None = None
    """Recorded column; None for a compared torque of a controller."""
    guide: Guide | None = None
    """Controller whose torque is compared, if a recorded torque drives the joint."""

    def until(self, end: float) -> int:
        """Number of samples up to a time, s."""
        return int(np.sum(self.time <= end + 1e-9))

    @property
    def floor(self) -> float:
        """Smallest standard deviation that noise and quantisation allow."""
        return max(self.noise, self.quantum / float(np.sqrt(12.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class PlayedCommand(Recorded):
    """A recorded input, which the simulation plays."""

    name: str
    """Name of the reference in the joint's mode, or `external_torque`."""
    hold: bool
    source: str
    """Column of the recording that contains the command."""
    scale: float = 1.0
    """Factor between the recorded quantity and the reference."""
    guide: Curve | None = None
    """Curve that is added to the reference."""

    @cached_property
    def curve(self) -> Curve:
        """Curve of the command through the recorded samples."""
        return curve_through(self.time, self.values, hold=self.hold)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the command's noise; 0 if it is negligible."""
        noise = fine_noise(self.values) if not self.hold and len(self.values) > 8 else 0.0
        return noise if noise > 2e-6 * np.ptp(self.values) else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Data:
    """A recording that is prepared for a fit."""

    name: str
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
    predicted_only: bool = False
    """Whether the recording only validates the fit: it is predicted but not fitted."""


def read_data(task: Task, scenario: Scenario, robot: Robot) -> list[Data]:
    """Read all recordings; the fitted recordings come first. Raises InputError with the problems of all recordings."""
    found: list[Data] = []
    problems: list[Problem] = []
    for number, experiment in enumerate((*task.experiments, *task.validate)):
        try:
            data = _read(task, experiment, scenario, robot)
            found.append(replace(data, predicted_only=number >= len(task.experiments)))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return found


def _read(task: Task, experiment: Experiment, scenario: Scenario, robot: Robot) -> Data:
    joints = [joint.name for joint in robot.moving_joints]
    recording = read_recording(experiment.file, mapping=list(experiment.mapping) or None, joints=joints, rate=experiment.rate)
    # `init` writes recorded motor positions as references of mode 2.
    idle = [block.joint for block in robot.actuators if block.mode == PLAYED or not scenario.references_of(block.joint)]
    plan = make_plan(robot, recording, step=scenario.step, idle=idle)
    commanded, recorded = {one.joint for one in plan.played if one.slot == 0}, {joint for joint, _ in plan.compared}
    missing = [joint for joint in idle if joint in recorded - commanded and not scenario.references_of(joint)]
    if missing:
        raise RecordingError(
            f"the commands of {', '.join(missing)} are missing in the recording and in the scenario; "
            f"the columns of the recording are {', '.join(list(recording.channels)[:30])}",
            file=recording.path, code="no-command",
            hint=f"Name the column: --map COLUMN={missing[0]}.reference_1, or write references into the scenario",
        )  # fmt: skip
    remarks = [*plan.remarks]
    channels = tuple(_channels(task, plan, remarks))
    if not channels:
        known = ", ".join(f"{joint}.{column.quantity}" for joint, column in plan.compared) or "no channel"
        message = f"no channel of the recording is compared; its channels are {known}"
        hint = "; ".join(remarks) or None
        raise RecordingError(message, file=recording.path, hint=hint, code="nothing-compared")
    if not any(np.ptp(channel.values) > 8.0 * max(channel.noise, channel.quantum) for channel in channels):
        message = "no channel moves by more than its noise, so no parameter can be identified"
        raise RecordingError(message, file=recording.path, code="nothing-moves")
    end, step = max(float(channel.time[-1]) for channel in channels), scenario.step
    return Data(
        name=experiment.file.name, duration=round(max(4.0, np.floor(end / step + 1e-6)) * step, 12),
        channels=channels, commands=tuple(_commands(plan)), modes=plan.modes, remarks=tuple(remarks),
    )  # fmt: skip


def _commands(plan: RecordingPlan) -> Iterator[PlayedCommand]:
    modes = {block.joint: MODES[block.mode] for block in plan.robot.actuators}
    for one in plan.played:
        column, good = one.column, np.isfinite(one.column.values)
        yield PlayedCommand(
            joint=one.joint, quantity=EXTERNAL if one.slot is None else f"reference_{one.slot + 1}",
            name=EXTERNAL if one.slot is None else modes[one.joint].references[one.slot],
            time=column.time[good] - plan.lag, values=column.values[good],
            hold=one.hold and not str(column.quantity).startswith("motor"), source=column.source, unit=column.unit,
        )  # fmt: skip


def _channels(task: Task, plan: RecordingPlan, remarks: list[str]) -> Iterator[Channel]:
    """Compared channels: all measured quantities that the simulation computes."""
    possible = {
        f"{joint}.{column.quantity}": (joint, column) for joint, column in plan.compared if column.quantity in COMPARABLE
    }
    computed = computed_columns(list(plan.recording.channels.values()), {column.source for _, column in possible.values()})
    blocks, left_out = {block.joint: block for block in plan.robot.actuators}, dict[str, list[str]]()
    for key, (joint, column) in possible.items():
        quantity, block = str(column.quantity), blocks.get(joint)
        mode = MODES[block.mode] if block else None
        good = np.isfinite(column.values) & (column.time - plan.lag >= -1e-9)
        time, values = column.time[good] - plan.lag, column.values[good]
        reason = ""
        if block and ACTUATORS.get(block.actuator).adjuster and quantity == "motor_2_position":
            reason = "an adjuster stands at its reference"
        elif quantity.endswith("velocity") and key.replace("velocity", "position") in possible:
            reason = "drives compute velocities from their positions, which are compared"
        elif mode and not mode.motor and quantity.startswith(("motor", "friction", "equilibrium")):
            reason = f"motors stand at their references in mode {mode.number} ({mode.name})"
        elif mode and not mode.spring and quantity.startswith(("elastic", "deflection")):
            reason = f"mode {mode.number} ({mode.name}) has no spring"
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
                values=values, noise=task.noise.get(key) or fine_noise(values, quantum), quantum=quantum, column=column,
            )  # fmt: skip
    remarks += [f"not compared, since {reason}: {', '.join(keys)}" for reason, keys in left_out.items()]


def computed_columns(columns: Sequence[Column], mapped: Collection[str]) -> dict[str, str]:
    """Mapped columns that are linear functions of another column, each with the name of the other column. If both columns are
    mapped, the column with the position counts as measured.
    """
    found: dict[str, str] = {}
    moving = [c for c in columns if np.isfinite(c.values).all() and np.ptp(c.values) > 0.0]
    for pair in combinations(moving, 2):
        early, late = sorted(pair, key=lambda c: (c.source in mapped, not str(c.quantity).endswith("position")))
        if len(late.time) != len(early.time) or late.source not in mapped or {late.source, early.source} & found.keys():
            continue
        # A position may be converted from counts of its encoder, and a column may copy another topic of a log.
        converted = str(late.quantity).endswith("position") or np.array_equal(early.values, late.values)
        if early.source not in mapped and converted:
            continue
        if 1.0 - np.corrcoef(early.values, late.values)[0, 1] ** 2 < COMPUTED**2:
            found[late.source] = early.source
    return found


# -- joints that a recorded torque drives ------------------------------------------------------------------------------------
#
# In a simulation of such a joint, errors of the torque accumulate. Therefore a stiff controller brings the simulated joint back
# to the recorded position, and the additional torque of the controller is the error that is compared. The controller is that
# of mode 1. Its reference r combines the recorded torque u, position q and velocity v; x is the simulated position:
# P (r - x) - D x' = u + P (q - x) + D (v - x').

HIGHEST = 20.0
"""Highest bandwidth of the controller, Hz."""
EDGE = 2.0
"""Duration that is not compared at both ends of a recording, in periods of the controller's bandwidth."""
POSITION_SHARE, TORQUE_SHARE, ABOVE_SHARE = 0.54, 0.785, 0.85
"""Integrals over the frequency, in units of the bandwidth: of the squared response of the compared torque to noise of the
position, of its squared response to noise of the torque, and over the band in which the noise of the position is measured.
"""
FEWEST = 50
"""Smallest number of compared torques; with fewer, a recording is too short for the controller."""
PID = 1
"""Operation mode in which a PID controller acts on the link."""


def guided(data: Data, robot: Robot, free: Collection[str]) -> Data:
    """Recording in which joints that only a recorded torque drives (mode 0, without a spring) follow their recorded positions,
    unless the recording is too short, or a coarse encoder would shake these joints.
    """
    commands, channels = {one.key: one for one in data.commands}, {one.key: one for one in data.channels}
    for block in robot.actuators:
        joint, name = robot.joint(block.joint), block.joint
        sprung = joint.spring_stiffness != 0.0 or f"{name}.passive_stiffness" in free
        command, place = commands.get(f"{name}.reference_1"), channels.get(f"{name}.link_position")
        if data.modes.get(name, block.mode) == 0 and not sprung and command and place and not place.quantum:
            data = _guided(data, command, place, "N" if joint.kind == "prismatic" else "N m")
    return data


def _guided(data: Data, command: PlayedCommand, place: Channel, unit: str) -> Data:
    from scipy.interpolate import CubicSpline

    name, step = place.joint, float(np.median(np.diff(place.time)))
    time = np.arange(place.time[0], place.time[-1], step)
    raw = np.interp(time, place.time, place.values)
    band = min(1.5 * bandwidth(step, raw, place.floor) or 1.0, HIGHEST, 0.15 / step)
    cutoff = 4.0 * band * step
    recorded = smoothed(np.interp(time, command.time, command.values), min(4.0 * cutoff, 0.9))
    position, torque = smoothed(raw, cutoff), smoothed(recorded, 2.0 * band * step)
    velocity = CubicSpline(time, position)(time, 1)
    # The inertia is estimated as if all of the torque accelerated it, so no parameter of the robot is needed.
    inertia = float(np.std(torque) / max(np.std(np.gradient(velocity, time)), 1e-300))
    omega = 2.0 * np.pi * band
    gain, brake = inertia * omega**2, 2.0 * inertia * omega
    guide = curve_through(time, position + brake / gain * velocity)
    inside = (time > time[0] + EDGE / band) & (time < time[-1] - EDGE / band)
    # The samples are so far apart that the controller does not correlate their errors.
    rows = np.flatnonzero(inside)[:: max(1, round(0.5 / (band * step)))]
    if len(rows) < FEWEST:
        return data
    # Noise of the position enters the compared torque as gain s^2 / (1 + s^2), noise of the torque as 1 / (1 + s^2), with the
    # frequency s in units of the bandwidth. The shares are integrals of the squares of these responses: for noise of the
    # position up to the cutoff s = 2. Noise of the position is measured between s = 1 and 2, where the motion has ended. Jumps
    # of friction need the torque far beyond s = 2.
    above = position - smoothed(raw, 0.5 * cutoff)
    of_position = gain * float(np.median(np.abs(above[inside]))) / 0.6745 * np.sqrt(POSITION_SHARE / ABOVE_SHARE)
    noise = float(np.hypot(fine_noise(command.values) * np.sqrt(2.0 * band * step * TORQUE_SHARE), of_position))
    channel = Channel(
        joint=name, quantity="link_torque", unit=unit, time=time[rows], values=torque[rows], noise=noise, quantum=0.0,
        guide=Guide(command=command.key, positions=position[rows], stiffness=gain),
    )  # fmt: skip
    remark = f"{name}: driven by the recorded torque; torques are compared up to {band:.3g} Hz"
    played = replace(command, name="link_position", time=time, values=recorded, scale=1.0 / gain, guide=guide)
    numbers = {"controller_1_proportional": gain, "controller_1_derivative": brake, "controller_1_integral": 0.0}
    return replace(
        data, modes={**data.modes, name: PID}, parameters={**data.parameters, name: numbers},
        commands=tuple(played if one is command else one for one in data.commands),
        channels=tuple(channel if one is place else one for one in data.channels), guides=(*data.guides, place),
        remarks=(*data.remarks, remark),
    )  # fmt: skip
