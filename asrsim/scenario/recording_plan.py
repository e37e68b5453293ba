"""Plan for a recording and a robot: which columns are played as commands, and which are compared with the simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import RecordingError
from asrsim.quantities import PRISMATIC_UNITS, each_motor
from asrsim.recordings.data import Column, Recording
from asrsim.recordings.matching import match_joints, wrong_unit
from asrsim.recordings.suspicions import condense, gear_between
from asrsim.recordings.units import split_header
from asrsim.robot import ActuatorBlock, Robot
from asrsim.robot.mounting import reference_names
from asrsim.robot.values import overridden
from asrsim.samples import is_staircase
from asrsim.scenario.recorded_limits import Exceeded, exceeded_limits

UNIT_MODES = {"N m": 4, "N": 4, "V": 7, "A": 8}
"""Mode that accepts a command, by the unit of the command; for units other than units of position."""
LATEST, SOON = 1.0, 0.05
"""Latest time on a recording's clock at which the recording may begin without being shifted, s. LATEST: if the scenario
commands a joint; SOON: if the scenario commands no joint. A recording that begins later, or before 0, is shifted to 0. Samples
up to the time `SOON` show the initial state.
"""
TORQUES = {4: "motor_1_torque", 0: "link_torque", 7: "motor_1_voltage", 8: "motor_1_current"}
"""Recorded quantity that is the command in each mode if no column is called a command."""
BEYOND = 0.02
"""Part of a joint's range by which a recorded position must exceed the range, as a margin for the zero of its sensor."""
FALLBACKS = ("equilibrium_position", "motor_1_position", "motor_1_voltage", "motor_1_current", "motor_1_torque")
"""Recorded quantities that replace a command that was not recorded."""


@dataclass(frozen=True, kw_only=True)
class PlayedRecording:
    """Column of a recording that drives an input of the simulation."""

    joint: str
    slot: int | None
    """Index of the reference in the joint's mode, from 0; None: the external torque."""
    column: Column
    hold: bool
    """True: each value holds until the next sample; False: values are interpolated smoothly."""

    @property
    def label(self) -> str:
        """Heading of the column in the file of commands."""
        what = "external_torque" if self.slot is None else f"reference_{self.slot + 1}"
        return f"{self.joint}.{what}" + (f" [{self.column.unit}]" if self.column.unit else "")


@dataclass(frozen=True, kw_only=True)
class RecordingPlan:
    """Columns of a recording that are played into a robot, and columns that are compared with its simulation."""

    robot: Robot
    """Robot in the modes that the commands need."""
    modes: Mapping[str, int]
    """Modes by joint that replace the modes in the robot file, because of the recorded commands."""
    recording: Recording
    played: tuple[PlayedRecording, ...]
    compared: tuple[tuple[str, Column], ...]
    """Pairs (joint of the robot, column) for the recorded quantities that are not commands."""
    lag: float
    """Time by which the recording's clock is ahead of the simulation's clock, s."""
    duration: float
    """Duration of the simulation, s."""
    initial: Mapping[str, float]
    """First recorded positions other than 0, by joint."""
    initial_motors: Mapping[str, tuple[float, ...]]
    """First recorded positions of motors with dynamics, by joint; only for joints whose motors were all recorded."""
    exceeded: tuple[Exceeded, ...] = ()
    """Limits of springs and motors that the recorded motion exceeds."""
    remarks: tuple[str, ...] = ()

    @property
    def on_bench(self) -> bool:
        """Whether only springs were recorded: positions of motors and torques, without motion of a link."""
        played = {one.joint for one in self.played if one.column.quantity == "motor_1_position"}
        springs = ("link_torque", *each_motor("elastic_torque_{}"), *each_motor("motor_{}_position"))
        return bool(self.compared) and all(joint in played and column.quantity in springs for joint, column in self.compared)


def make_plan(robot: Robot, recording: Recording, *, step: float, idle: Sequence[str] | None = None) -> RecordingPlan:
    """Columns of the recording that are played into the robot, and columns that are compared.

    idle: joints whose recorded motor positions may replace a missing command. Other joints play commands only, and a recording
    without commands is accepted. None: any recorded quantity may replace a missing command. Raises RecordingError, with the
    columns of the recording, if it has no joint of the robot or no command.
    """
    pairing = match_joints([joint.name for joint in robot.moving_joints], recording)
    columns = {
        (pairing[str(c.joint)], str(c.quantity)): c for c in recording.channels.values() if c.quantity and c.joint in pairing
    }
    _require_units(robot, recording, columns)
    slides = {joint.name for joint in robot.moving_joints if joint.kind == "prismatic"}
    # A name such as `tau_cmd` or `pos_cmd` means a torque or an angle. For a prismatic joint, it means a force or a
    # displacement.
    columns = {
        key: replace(c, unit=PRISMATIC_UNITS.get(c.unit, c.unit)) if key[0] in slides and not c.stated else c
        for key, c in columns.items()
    }
    remarks = [*filter(None, (_beyond_stops(c, joint, robot.joint(joint).stops) for (joint, _), c in columns.items()))]
    modes: dict[str, int] = {}
    played: list[PlayedRecording] = []
    for block in robot.actuators:
        command = _command(columns, block, remarks, idle)
        if command is not None:
            others = _others(columns, block, command)
            mode = _mode(block, command, others)
            if mode != block.mode:
                modes[block.joint] = mode
                why = "its motors take their recorded positions" if mode == 2 else "which cannot take this command"
                remarks.append(f"{block.joint}: mode {mode} instead of {block.mode}, {why}")
            slots = len(reference_names(replace(block, mode=mode)))
            commands = enumerate([command, *others][:slots])
            played += [_played(block.joint, slot, one) for slot, one in commands if one is not None]
        if (torque := columns.get((block.joint, "external_torque"))) is not None:
            played.append(_played(block.joint, None, torque))
    if idle is None and not any(one.slot == 0 for one in played):
        if robot.actuators or any(quantity == "reference_1" for _, quantity in columns):
            raise _no_command(recording, robot, [joint for joint, quantity in columns if quantity == "reference_1"])
        torques = [column.source for (_, quantity), column in columns.items() if quantity == "link_torque"]
        remarks.append(
            "no joint has an actuator, and no command was recorded: the robot swings from its first recorded position"
            + (f". If the torque '{torques[0]}' drives the robot, play this torque: --actuator sea --mode 0" if torques else "")
        )
    sources = {one.column.source for one in played}
    by_scenario = idle is not None and len({one.joint for one in played if one.slot == 0}) < len(robot.actuators)
    lag, end = _span(columns, LATEST if by_scenario else SOON)
    changed, _ = overridden(robot, modes, {})
    return RecordingPlan(
        robot=changed,
        modes=modes,
        recording=recording,
        played=tuple(played),
        compared=tuple(
            (joint, column)
            for (joint, quantity), column in columns.items()
            if not quantity.startswith("reference") and column.source not in sources and np.isfinite(column.values).sum() > 1
        ),
        lag=lag,
        duration=max(step, np.floor((end - lag) / step + 1e-6) * step),
        initial=_initial(changed, columns, played, remarks),
        initial_motors=_initial_motors(changed, columns, remarks),
        exceeded=tuple(one for block in changed.actuators for one in exceeded_limits(block, columns)),
        remarks=tuple(remarks),
    )


def _span(columns: Mapping[tuple[str, str], Column], latest: float) -> tuple[float, float]:
    """Recorded times of the start (time 0 of the simulation) and of the end of the used columns."""
    start = min(float(column.time[0]) for column in columns.values())
    end = max(float(column.time[-1]) for column in columns.values())
    return (0.0 if 0.0 <= start <= latest and end > start else start), end


def _beyond_stops(column: Column, joint: str, stops: tuple[float, float]) -> str | None:
    """Remark on link positions that exceed the joint's stops. Without a stated unit, they may be in degrees. None if they do
    not exceed the stops.
    """
    known = column.values[np.isfinite(column.values)]
    if column.quantity != "link_position" or not len(known):
        return None
    least, most = np.percentile(known, (2, 98)).tolist()  # percentiles ignore single outliers
    farthest, widest = max(-least, most), max(abs(stop) for stop in stops)
    if not column.stated and farthest >= 1.5 * widest:
        return (
            f"{column.source}: states no unit and reaches {farthest:.3g}, but {joint} stops at {widest:.3g} rad or m: is it "
            f"in degrees or mm? State the unit with --map '{column.source}={joint}.link_position [deg]'"
        )
    for reached, stop, beyond in ((least, stops[0], stops[0] - least), (most, stops[1], most - stops[1])):
        if beyond > BEYOND * (stops[1] - stops[0]):
            return (
                f"{column.source}: reaches {reached:.3g} {column.unit}, but {joint} stops at {stop:.3g} {column.unit}, and no "
                f"simulation passes a stop: check the sign and the zero of the column, or widen <limit> of {joint} in the "
                "robot's file"
            )
    return None


def _require_units(robot: Robot, recording: Recording, columns: Mapping[tuple[str, str], Column]) -> None:
    """Raise RecordingError for columns whose unit does not fit their joint."""
    prismatic = {joint.name: joint.kind == "prismatic" for joint in robot.moving_joints}
    wrong = [wrong_unit(column, joint, prismatic=prismatic[joint]) for (joint, _), column in columns.items()]
    if any(wrong):
        raise RecordingError(condense(replace(problem, file=recording.path) for problem in wrong if problem is not None))


def _command(
    columns: Mapping[tuple[str, str], Column], block: ActuatorBlock, remarks: list[str], idle: Sequence[str] | None
) -> Column | None:
    """Column that is the command of a joint, or that replaces a missing command; None if there is no such column."""
    fallbacks = FALLBACKS if idle is None else _motors(columns, block) if block.joint in idle else ()
    mode, own = MODES[block.mode], [TORQUES[block.mode]] if block.mode in TORQUES else []
    reference = columns.get((block.joint, "reference_1"))
    order = ["reference_1", *own, *fallbacks]
    if mode.direct and reference is not None and reference.unit not in (*mode.units, "N") and not _of_mode(reference):
        # For a torque-controlled motor, prefer the recorded torque to a position.
        order = [*own, *order]
    for quantity in order:
        column = columns.get((block.joint, quantity))
        if column is None or not np.isfinite(column.values).any():
            continue
        if idle is not None and column.unit in ("V", "A") and column.unit != mode.units[0]:
            remarks.append(f"{block.joint}: {column.source} is in {column.unit}, which mode {block.mode} does not accept")
            continue
        if quantity != "reference_1":
            remarks.append(f"{block.joint}: no command was recorded; the recorded {quantity} is played instead")
        return column
    if idle is None and any(joint == block.joint for joint, _ in columns):
        remarks.append(f"{block.joint}: no column is its command; its reference keeps the initial value")
    return None


def _others(columns: Mapping[tuple[str, str], Column], block: ActuatorBlock, command: Column) -> list[Column | None]:
    """Columns of the further references; None for each reference that was not recorded."""
    numbers = range(2, ACTUATORS.get(block.actuator).positions() + 1)
    if command.quantity == "motor_1_position":
        return [columns.get((block.joint, f"motor_{i}_position")) for i in numbers]
    found = [columns.get((block.joint, f"reference_{i}")) for i in numbers]
    if MODES[block.mode].direct and command.quantity == TORQUES[block.mode]:
        own = [columns.get((block.joint, command.quantity.replace("_1_", f"_{i}_"))) for i in numbers]
        found = [one or other for one, other in zip(found, own, strict=True)]
    return found


def _motors(columns: Mapping[tuple[str, str], Column], block: ActuatorBlock) -> Sequence[str]:
    """Quantity that replaces the command of springs, if the positions of all their motors were recorded."""
    actuator = ACTUATORS.get(block.actuator)
    motors = range(1, actuator.motors + actuator.adjuster + 1)
    known = MODES[block.mode].spring and all((block.joint, f"motor_{i}_position") in columns for i in motors)
    return ("motor_1_position",) if known else ()


def _mode(block: ActuatorBlock, command: Column, others: Sequence[Column | None]) -> int:
    """Mode of the block if this mode accepts the command, else the nearest mode that accepts the command. others: columns of
    the other references.
    """
    mode, actuator = MODES[block.mode], ACTUATORS.get(block.actuator)
    complete = None not in others
    single = actuator.motors == 1 and not actuator.adjuster
    if command.quantity == "motor_1_position" and mode.spring and (single or complete):
        # Motors with known positions need no controller, since mode 2 prescribes the positions.
        return 2
    if command.quantity == TORQUES.get(block.mode):
        return mode.number
    if command.unit in ("V", "A"):
        return UNIT_MODES[command.unit]
    if command.unit in UNIT_MODES:
        return mode.number if mode.number in (0, 4) else 4 if actuator.motors == 1 and mode.spring else 0
    if mode.mapped and complete and len(others) > 1:
        # Two references are equilibrium and preset. Three or more are the references of the motors.
        return mode.number - 1
    if _of_mode(command):
        return mode.number
    if mode.direct or mode.number == 0:
        return 6 if mode.direct else 1
    return mode.number + (mode.number in (2, 5) and actuator.motors > 1 and not complete)


def _of_mode(command: Column) -> bool:
    """Whether a command without a unit has the unit of the joint's mode, since a mapping or the column's header calls it
    `reference_1`. Other headers without a unit, such as `knee_cmd`, mean a position.
    """
    called = command.given or split_header(command.source)[0].rpartition(".")[2].strip() == "reference_1"
    return called and command.quantity == "reference_1" and not command.unit


def _played(joint: str, slot: int | None, column: Column) -> PlayedRecording:
    hold = is_staircase(column.values[np.isfinite(column.values)])
    return PlayedRecording(joint=joint, slot=slot, column=column, hold=hold)


def _initial(
    robot: Robot, columns: Mapping[tuple[str, str], Column], played: Sequence[PlayedRecording], remarks: list[str]
) -> dict[str, float]:
    """First recorded position of each joint. It is the position of the link or, if this was not recorded, of the springs, of a
    motor, or of the command."""
    initial: dict[str, float] = {}
    positioned = {block.joint for block in robot.actuators if MODES[block.mode].units[0] == "rad"}
    for joint in robot.moving_joints:
        names = ("link_position", "equilibrium_position", "motor_1_position")
        sources = [columns[joint.name, name] for name in names if (joint.name, name) in columns]
        sources += [one.column for one in played if (one.joint, one.slot) == (joint.name, 0) and one.joint in positioned]
        recorded = [value for column in sources if (value := _first(column)) is not None]
        start = recorded[0] if recorded else 0.0
        inside = min(max(start, joint.stops[0]), joint.stops[1])
        if inside != start:
            remarks.append(f"{joint.name}: its first position {start:.6g} is outside of its limits; it starts at {inside:.6g}")
        if abs(inside) > 1e-9:
            # If the initial position is at a joint limit, keep all digits of the limit, since a rounded position could be
            # beyond it.
            initial[joint.name] = inside if inside != start else float(f"{inside:.9g}")
    return initial


def _initial_motors(
    robot: Robot, columns: Mapping[tuple[str, str], Column], remarks: list[str]
) -> dict[str, tuple[float, ...]]:
    """First recorded positions of the motors of each joint whose motors have dynamics and were all recorded, on the link side
    of their gears.
    """
    found = {}
    for block in robot.actuators:
        names = [(block.joint, f"motor_{i}_position") for i in range(1, ACTUATORS.get(block.actuator).motors + 1)]
        first = [value for name in names if name in columns and (value := _first(columns[name])) is not None]
        if not MODES[block.mode].motor or len(first) < len(names):
            continue
        link = columns.get((block.joint, "link_position"))
        if gear := next(filter(None, (gear_between(columns[name], link) for name in names)), 0.0):
            remarks.append(
                f"{block.joint}: its motor moves {abs(gear):.4g} times as far as its link, so it was probably measured before "
                "its gear; its first position is not used"
            )
        else:
            found[block.joint] = tuple(float(f"{value:.9g}") for value in first)
    return found


def _first(column: Column) -> float | None:
    """First number of a column; None without a number."""
    values = column.values[np.isfinite(column.values)]
    return float(values[0]) if values.size else None


def _no_command(recording: Recording, robot: Robot, undriven: Sequence[str]) -> RecordingError:
    """Error for a recording without a command. undriven: joints without actuator whose command was recorded."""
    if undriven:
        return RecordingError(
            f"the recording has a command for {', '.join(undriven)}, but the robot has no actuator there",
            file=recording.path,
            hint=f"Add an actuator: --actuator {undriven[0]}=NAME",
            choices=ACTUATORS.names(),
            code="no-actuator",
        )
    columns = ", ".join(
        f"{c.source} ({c.joint}.{c.quantity})" if c.quantity else c.source for c in list(recording.channels.values())[:30]
    )
    torques = [c.source for c in recording.channels.values() if c.quantity == "link_torque"]
    rigid = f"--mode 0 plays the torque of '{torques[0]}' on the rigid link, without motor and spring. " if torques else ""
    return RecordingError(
        f"no column is a command that could be played; its columns: {columns}",
        file=recording.path,
        code="no-command",
        hint=f"{rigid}Name the command's column: --map COLUMN={robot.actuators[0].joint}.reference_1, or .motor_1_position for "
        "springs on a bench. `asrsim plot LOG --experiment FILE` compares a recording without commands with a run",
    )
