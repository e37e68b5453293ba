"""A scenario from a recording: its commands are played, and its motion is compared with that of the simulation."""

from __future__ import annotations

import io
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.electric import missing_constants
from asrsim.actuators.modes import Mode
from asrsim.actuators.user import command_line
from asrsim.errors import RecordingError
from asrsim.quantities import is_comparable
from asrsim.recordings.data import Column, Recording
from asrsim.recordings.matching import match_joints, wrong_unit
from asrsim.recordings.suspicions import beyond_stops, condense
from asrsim.robot import ActuatorBlock, Robot, with_overrides
from asrsim.robot.mounting import reference_names
from asrsim.scenario.starter import mounted_lines, number, robot_lines, starter_joint, word
from asrsim.signals.playback import since

UNIT_MODES = {"N m": 4, "N": 4, "V": 7, "A": 8}
"""Unit of a command that is no position -> mode that takes it."""
WIDE = 1e4
"""N m, rad/s: limits of motors whose real limits are unknown; a thousand times those of robots."""


def fitting_modes(robot: Robot, recording: Recording, joints: Sequence[str]) -> dict[str, int]:
    """Joint -> mode that takes what was recorded of its command, where that is no position."""
    pairing, _ = match_joints([joint.name for joint in robot.moving_joints], recording)
    units = {(pairing.get(str(c.joint)), str(c.quantity)): c.unit for c in recording.channels.values() if c.quantity}
    commands = ("reference_1", *(f"motor_1_{what}" for what in ("voltage", "current", "torque")))
    found = {joint: [units[joint, one] for one in commands if (joint, one) in units] for joint in joints}
    return {joint: UNIT_MODES[stated[0]] for joint, stated in found.items() if stated and stated[0] in UNIT_MODES}


def open_parameters(robot: Robot, modes: Mapping[str, int], joints: Sequence[str]) -> dict[str, dict[str, float]]:
    """Joint -> parameters of motors and controllers of which nothing is known: limits that nothing reaches, constants that are
    needed, and no derivative gain, since that brakes as damping does, which is fitted and may be less than a guess of both.
    """
    found: dict[str, dict[str, float]] = {}
    for block in robot.actuators:
        motors, mode = ACTUATORS.get(block.actuator).motors, MODES[modes.get(block.joint, modes.get("*", block.mode))]
        if block.joint in joints and (mode.motor or mode.controller):
            limits = [f"motor_{i}_max_{what}" for i in range(1, motors + 1) for what in ("torque", "velocity") if mode.motor]
            constants = missing_constants(block.values(), motors, mode) if mode.motor else ()
            gains = [f"controller_{i}_derivative" for i in range(1, motors + 1) if mode.controller]
            found[block.joint] = {**dict.fromkeys(limits, WIDE), **dict.fromkeys(constants, 1.0), **dict.fromkeys(gains, 0.0)}
    return found


LATEST = 1.0
"""s: a recording that begins later, or before 0, is played from 0."""
STAIRS = 0.5
"""Fraction of changes that follow directly on a change. A command with less is piecewise constant; others are smooth."""
TORQUES = {4: ("motor_1_torque",), 0: ("link_torque",), 7: ("motor_1_voltage",), 8: ("motor_1_current",)}
"""Mode -> recorded quantities that are its command where none is called so."""
FALLBACKS = ("equilibrium_position", "motor_1_position")
"""Recorded quantities that replace a command that was not recorded."""


@dataclass(frozen=True, kw_only=True)
class Played:
    """One column that drives one input of the simulation."""

    joint: str
    slot: int | None
    """Of the mode's references: 0 or 1; None: the external torque."""
    column: Column
    hold: bool
    """Each value holds until the next sample; else a smooth curve leads there."""

    @property
    def label(self) -> str:
        """Column of the file of commands."""
        what = "external_torque" if self.slot is None else f"reference_{self.slot + 1}"
        return f"{self.joint}.{what}" + (f" [{self.column.unit}]" if self.column.unit else "")


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is played and compared."""

    robot: Robot
    """With the modes that the commands need."""
    modes: Mapping[str, int]
    """Joint -> mode that replaces the robot file's, because of its command."""
    recording: Recording
    pairing: Mapping[str, str]
    """Joint of the recording -> joint of the robot."""
    played: tuple[Played, ...]
    compared: tuple[tuple[str, Column], ...]
    """(joint of the robot, column) of what is recorded and simulated, commands left out."""
    lag: float
    """s that the recording's clock is ahead of the simulation's."""
    duration: float
    """s."""
    initial: Mapping[str, float]
    """Joint -> its first recorded position, where that is not 0."""
    remarks: tuple[str, ...] = ()

    @property
    def on_bench(self) -> bool:
        """Whether springs alone were recorded: motors' places and torques, and no motion of a link."""
        played = {one.joint for one in self.played if one.column.quantity == "motor_1_position"}
        others = ("elastic_torque", "link_torque", "motor_2_position")
        return bool(self.compared) and all(
            joint in played and str(column.quantity).startswith(others) for joint, column in self.compared
        )


def make_plan(robot: Robot, recording: Recording, *, step: float, strict: bool = False) -> Plan:
    """What of the recording is played into the robot, and what is compared.

    strict: only what is a command is played as one, and a recording without commands is fine. Raises RecordingError where no
    joint is common, or no column is a command, with what there is.
    """
    names = [joint.name for joint in robot.moving_joints]
    pairing, found = match_joints(names, recording)
    remarks = [problem.message for problem in found]
    columns = {
        (pairing[str(c.joint)], str(c.quantity)): c for c in recording.channels.values() if c.quantity and c.joint in pairing
    }
    _require_units(robot, recording, columns)
    remarks += filter(None, (beyond_stops(c, joint, robot.joint(joint).stops) for (joint, _), c in columns.items()))
    lag, end = _span(columns)
    modes: dict[str, int] = {}
    played: list[Played] = []
    for block in robot.actuators:
        command = _command(columns, block, remarks, () if strict else FALLBACKS)
        if command is not None:
            second = columns.get((block.joint, "reference_2"))
            if command.quantity == "motor_1_position":
                second = columns.get((block.joint, "motor_2_position"))
            if second is None and MODES[block.mode].direct and command.quantity in TORQUES[block.mode]:
                second = columns.get((block.joint, command.quantity.replace("_1_", "_2_")))
            mode = _mode(block, command, second)
            if mode != block.mode:
                modes[block.joint] = mode
                why = "its motors stand where they were recorded" if mode == 2 else "which cannot take this command"
                remarks.append(f"{block.joint}: mode {mode} in the place of {block.mode}, {why}")
            played.append(_played(block.joint, 0, command))
            if second is not None and len(reference_names(replace(block, mode=mode))) > 1:
                played.append(_played(block.joint, 1, second))
        if (torque := columns.get((block.joint, "external_torque"))) is not None:
            played.append(_played(block.joint, None, torque))
    if not strict and not any(one.slot == 0 for one in played):
        if robot.actuators or any(quantity == "reference_1" for _, quantity in columns):
            raise _no_command(recording, robot, [joint for joint, quantity in columns if quantity == "reference_1"])
        remarks.append("no joint has an actuator, and no command was recorded: the robot swings from where it begins")
    changed = with_overrides(robot, modes=modes) if modes else robot
    commands = {one.column.source for one in played}
    return Plan(
        robot=changed, modes=modes, recording=recording, pairing=pairing, played=tuple(played),
        compared=tuple(
            (joint, column) for (joint, quantity), column in columns.items()
            if not quantity.startswith("reference") and column.source not in commands and np.isfinite(column.values).sum() > 1
        ),
        lag=lag, duration=max(step, np.floor((end - lag) / step + 1e-6) * step),
        initial=_initial(changed, columns, played, remarks), remarks=tuple(remarks),
    )  # fmt: skip


def _span(columns: Mapping[tuple[str, str], Column]) -> tuple[float, float]:
    """Recorded time that becomes 0, and the recorded end; of the columns that are used."""
    start = min(float(column.time[0]) for column in columns.values())
    end = max(float(column.time[-1]) for column in columns.values())
    return (0.0 if 0.0 <= start <= LATEST and end > start else start), end


def _require_units(robot: Robot, recording: Recording, columns: Mapping[tuple[str, str], Column]) -> None:
    """Raises RecordingError for columns whose unit cannot be one of their joint."""
    prismatic = {joint.name: joint.kind == "prismatic" for joint in robot.moving_joints}
    wrong = [wrong_unit(column, joint, prismatic=prismatic[joint]) for (joint, _), column in columns.items()]
    if any(wrong):
        raise RecordingError(condense(replace(problem, file=recording.path) for problem in wrong if problem is not None))


def _command(
    columns: Mapping[tuple[str, str], Column], block: ActuatorBlock, remarks: list[str], fallbacks: Sequence[str]
) -> Column | None:
    torques = TORQUES.get(block.mode, ())
    reference = columns.get((block.joint, "reference_1"))
    order = ["reference_1", *torques, *fallbacks]
    if MODES[block.mode].direct and reference is not None and reference.unit not in (*MODES[block.mode].units, "N"):
        # A torque-controlled motor takes its recorded torque rather than a position.
        order = [*torques, *order]
    for quantity in order:
        column = columns.get((block.joint, quantity))
        if column is None or not np.isfinite(column.values).any():
            continue
        if column.unit in ("V", "A") and column.unit != MODES[block.mode].units[0]:
            remarks.append(f"{block.joint}: {column.source} is in {column.unit}, which mode {block.mode} does not take")
            continue
        if quantity != "reference_1":
            remarks.append(f"{block.joint}: no command was recorded; the recorded {quantity} is played in its place")
        return column
    recorded = [quantity for joint, quantity in columns if joint == block.joint]
    if recorded and fallbacks:
        remarks.append(f"{block.joint}: no column is its command; it rests where it starts")
    return None


def _mode(block: ActuatorBlock, command: Column, second: Column | None) -> int:
    """The block's mode if it accepts the command, else the nearest mode that does."""
    mode, actuator = MODES[block.mode], ACTUATORS.get(block.actuator)
    alone = actuator.motors == 1 and not actuator.adjuster
    if command.quantity == "motor_1_position" and mode.spring and (alone or second is not None):
        # Motors whose positions are known need no controller: the positions are prescribed.
        return 2
    if command.quantity in TORQUES.get(block.mode, ()):
        return mode.number
    if command.unit in ("V", "A"):
        return mode.number
    if command.unit in ("N m", "N"):
        return mode.number if mode.number in (0, 4) else 4 if actuator.motors == 1 and mode.spring else 0
    if not command.unit and command.quantity == "reference_1" and command.given:
        # The user says that it is what the mode takes, and in no other unit.
        return mode.number
    if mode.direct or mode.number == 0:
        return 6 if mode.direct else 1
    if mode.number in (2, 5) and actuator.motors > 1 and second is None:
        return mode.number + 1
    return mode.number


def _played(joint: str, slot: int | None, column: Column) -> Played:
    changes = np.diff(column.values[np.isfinite(column.values)]) != 0.0
    following = float(np.sum(changes[1:] & changes[:-1])) / max(1, int(np.sum(changes)))
    return Played(joint=joint, slot=slot, column=column, hold=following < STAIRS)


def _initial(
    robot: Robot, columns: Mapping[tuple[str, str], Column], played: list[Played], remarks: list[str]
) -> dict[str, float]:
    starts = dict(_starts(columns, played))
    initial: dict[str, float] = {}
    for joint in robot.moving_joints:
        start = starts.get(joint.name, 0.0)
        low, high = joint.stops
        inside = min(max(start, low), high)
        if inside != start:
            remarks.append(f"{joint.name}: it begins at {start:.6g}, outside of its limits, and is put to {inside:.6g}")
        if abs(inside) > 1e-9:
            # A limit stays to the last digit: rounded, it may be passed.
            initial[joint.name] = float(inside) if inside != start else float(f"{inside:.9g}")
    return initial


def _starts(columns: Mapping[tuple[str, str], Column], played: list[Played]) -> Iterator[tuple[str, float]]:
    """First recorded position of each joint: of its link, else of what else is an angle at its link."""
    for one in played:
        if one.slot == 0 and one.column.unit not in ("N m", "N"):
            yield one.joint, _first(one.column)
    for quantity in ("motor_1_position", "equilibrium_position", "link_position"):
        for (joint, name), column in columns.items():
            if name == quantity and np.isfinite(column.values).any():
                yield joint, _first(column)


def _first(column: Column) -> float:
    return float(column.values[np.isfinite(column.values)][0])


def _no_command(recording: Recording, robot: Robot, idle: Sequence[str]) -> RecordingError:
    """idle: joints that have a command in the recording."""
    found = ", ".join(f"{c.source} ({c.joint}.{c.quantity})" if c.quantity else c.source
                      for c in list(recording.channels.values())[:30])  # fmt: skip
    joint = robot.actuators[0].joint if robot.actuators else "JOINT"
    if idle:
        return RecordingError(
            f"it has a command of {', '.join(idle)}, which has no actuator in the robot", file=recording.path,
            hint=f"Put one there: --actuator {idle[0]}=NAME", choices=ACTUATORS.names(), code="no-actuator",
        )  # fmt: skip
    quantities = " ".join(str(c.quantity) for c in recording.channels.values())
    bench = f"; of a spring on a bench, turned against its locked end: --map ANGLE={joint}.motor_1_position --map TORQUE="
    bench += f"{joint}.elastic_torque_1"
    hint = (
        f"Name the command's column: --map COLUMN={joint}.reference_1{bench if 'torque' in quantities else ''}. Without one, "
    )
    hint += "a run of a scenario is compared by `asrsim plot LOG --experiment FILE`"
    problem = f"no column is a command that could be played; its columns: {found}"
    return RecordingError(problem, file=recording.path, hint=hint, code="no-command")


STEP = 0.001
"""s."""
SHARE = 0.1
"""Of the recorded range: largest RMSE that a claim allows."""
UNKNOWN = (
    "Limits of motors are wide open, their constants, if any, 1, controllers' derivative gains 0, since they brake as damping "
    "does; springs that stand here hold the arm's own weight, which the defaults do not: write what is known."
)


def command_tables(plan: Plan, name: str) -> dict[str, list[Played]]:
    """File name -> the commands that it holds: one file for each time base, the first of them called `name`."""
    groups: dict[int, list[Played]] = {}
    for one in plan.played:
        groups.setdefault(id(one.column.time), []).append(one)
    stem, dot, ending = name.rpartition(".")
    return {f"{stem}{f'_{i}' if i > 1 else ''}{dot}{ending}": members for i, members in enumerate(groups.values(), start=1)}


def command_text(plan: Plan, members: Sequence[Played]) -> str:
    """CSV of commands in SI, on the simulation's clock. Missing samples are bridged by the samples around them."""
    time = members[0].column.time
    values = np.column_stack([since(time, plan.lag) if plan.lag else time, *(one.column.values for one in members)])
    for i in range(1, values.shape[1]):
        good = np.isfinite(values[:, i])
        values[:, i] = np.interp(time, time[good], values[good, i])
    text = io.StringIO()
    header = ",".join(["time [s]", *(f'"{one.label}"' for one in members)])
    np.savetxt(text, values, delimiter=",", header=header, comments="", fmt="%.12g")
    return text.getvalue()


@dataclass(frozen=True, kw_only=True)
class Names:
    """Files as the scenario names them, from its own folder."""

    scenario: str
    robot: str
    recording: str
    commands: str
    schema: str | None = None
    arguments: Mapping[str, str] = field(default_factory=dict)
    """Of xacro."""
    packages: Mapping[str, str] = field(default_factory=dict)
    """Of ROS, with their folders."""
    plugins: tuple[str, ...] = ()
    """Files of users' actuators."""


def recording_text(
    plan: Plan, names: Names, *, mode: int | None = None, mounted: Sequence[str] = (),
    parameters: Mapping[str, Mapping[str, float]] | None = None, mapping: Sequence[str] = (), rate: float | None = None,
) -> str:  # fmt: skip
    """The scenario's YAML. mode, mapping, rate: as given on the command line, and written down; mounted: joints whose actuator
    the scenario gives; parameters: those of these that are no defaults.
    """
    lines = [f"# yaml-language-server: $schema={names.schema}"] if names.schema else []
    lines += [*_head(plan, names, mapping, rate), "", *robot_lines(names.robot, names.arguments, names.packages)]
    lines += [
        f"duration: {exact(plan.duration)}".ljust(21) + "# s, of the recording",
        f"step: {number(STEP)}".ljust(21) + "# s",
        *(["engine: bench".ljust(21) + "# no motion of a link was recorded: they are locked"] if plan.on_bench else []),
    ]
    if mounted:
        lines += mounted_lines(plan.robot, mounted, parameters or {}, why=UNKNOWN)
    others = any(block.joint not in plan.modes for block in plan.robot.actuators)
    modes = {**({"*": mode} if mode is not None and others else {}), **plan.modes}
    modes = {joint: number for joint, number in modes.items() if joint not in mounted}
    if modes and len(mounted) < len(plan.robot.actuators):
        lines.append("modes: {" + ", ".join(f"{word(joint)}: {value}" for joint, value in modes.items()) + "}")
    if plan.initial:
        lines += ["initial:".ljust(21) + "# rad, m; where the recording begins"]
        lines += [f"  {word(joint)}: {value!r}" for joint, value in plan.initial.items()]
    playbacks = {
        (one.joint, one.slot): f"{{playback: {{file: {word(file)}, column: {word(one.label)}, interpolation: "
        f"{'hold' if one.hold else 'smooth'}}}}}  # {one.column.source}"
        for file, members in command_tables(plan, names.commands).items()
        for one in members
    }
    if plan.robot.actuators:
        lines += ["", "references:", *_references(plan, playbacks)]
    torques = [f"  {word(joint)}: {playback}" for (joint, slot), playback in playbacks.items() if slot is None]
    lines += ["", "external_torques:", *torques] if torques else []
    lines += ["", *_expect(plan, names, mapping, rate)]
    return "\n".join(lines) + "\n"


def _head(plan: Plan, names: Names, mapping: Sequence[str], rate: float | None) -> Iterator[str]:
    log = shlex.quote(f"out/{names.scenario.rpartition('.')[0]}/default/log.mcap")
    options = [
        f"--lag {exact(plan.lag)}",
        *(f"--map {shlex.quote(text)}" for text in mapping),
        *([f"--rate {rate:g}"] if rate else []),
    ]
    yield f"# Scenario from the recording {names.recording}, written by `asrsim init --experiment`. Units are SI."
    yield f"# It plays the recorded commands ({names.commands}) and compares the motion with the recorded one."
    yield f"#   {command_line('run', names.scenario, names.plugins)}"
    yield f"#   asrsim plot {log} --experiment {shlex.quote(names.recording)} {' '.join(options)}"
    if plan.remarks:
        yield "# Assumed, or odd about the file:"
    yield from (f"#   - {' '.join(text.split())}" for text in plan.remarks)
    if plan.lag:
        yield f"# The recording begins at {exact(plan.lag)} s of its own clock, which is 0 here."


def _references(plan: Plan, playbacks: Mapping[tuple[str, int | None], str]) -> Iterator[str]:
    for block in plan.robot.actuators:
        mode, drive = MODES[block.mode], starter_joint(plan.robot, block)
        yield f"  {word(block.joint)}:  # {drive.actuator.title}, mode {mode.number} ({mode.name}: {mode.doc})"
        presets = drive.presets()
        preset = presets[0] if presets else drive.actuator.typical_preset
        for slot, (name, unit, rest) in enumerate(drive.levels(plan.initial.get(block.joint, 0.0), 0.0, preset)):
            yield f"    {name}: {playbacks.get((block.joint, slot), f'{number(rest)}  # {unit}, not recorded')}"


def _expect(plan: Plan, names: Names, mapping: Sequence[str], rate: float | None) -> Iterator[str]:
    """A claim for each quantity that is compared: an RMSE of at most a tenth of the recorded range."""
    options = [f"lag: {exact(plan.lag)}"]
    options += [f"map: [{', '.join(word(text) for text in mapping)}]"] if mapping else []
    options += [f"rate: {rate:g}"] if rate else []
    against = f"against: {word(names.recording)}, options: {{{', '.join(options)}}}"
    claims = []
    modes = {block.joint: MODES[block.mode] for block in plan.robot.actuators}
    for joint, column in plan.compared:
        if not _is_simulated(str(column.quantity), modes.get(joint)):
            continue
        extent = float(np.ptp(column.values[np.isfinite(column.values)]))
        if extent > 0.0 and is_comparable(str(column.quantity)):
            limit = f"measure: rmse, comparison: <, value: {SHARE * extent:.2g}"
            claims.append(f"  - {{joint: {word(joint)}, quantity: {column.quantity}, {limit}, {against}}}")
    if not claims:
        yield "# Nothing that the simulation has was recorded beside the commands: there is nothing to compare."
        return
    yield f"expect:              # {100 * SHARE:g} % of the recorded range: write how near the model should be"
    yield from claims


def _is_simulated(quantity: str, mode: Mode | None) -> bool:
    """Whether a run in this mode has the quantity: ideal motors have a position only, and rigid joints have no motor."""
    if quantity.startswith("motor_") and not quantity.endswith("_position"):
        return mode is not None and mode.motor
    elastic = quantity.startswith(("motor_", "elastic_torque", "stiffness", "deflection", "equilibrium"))
    return not elastic or (mode is not None and mode.spring)


def exact(value: float) -> str:
    """A number as YAML, to twelve digits: times of long recordings need them."""
    return f"{value + 0.0:.12g}"
