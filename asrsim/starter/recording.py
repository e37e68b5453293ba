"""Makes a scenario that plays a recording's commands and compares the simulated motion with the recorded motion.

Also writes the files that the scenario needs, and a fit file for `asrsim identify`.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.electric import missing_constants
from asrsim.actuators.modes import Mode
from asrsim.outfile import check_output, csv_text
from asrsim.plugins import command_line, plugin_options
from asrsim.quantities import is_comparable
from asrsim.recordings import Recording, read_recording
from asrsim.recordings.data import Column
from asrsim.recordings.propose import propose
from asrsim.recordings.reading import ENDING, is_document, reading_file
from asrsim.robot import ActuatorBlock, Joint, Robot, with_actuators, with_overrides
from asrsim.scenario.recording_plan import PlayedRecording, RecordingPlan, make_plan
from asrsim.scenario.relocate import relative_path, robot_key
from asrsim.signals.playback import shifted
from asrsim.starter.robot import (
    MOUNTED_MODE,
    SCHEMA_FILE,
    Comments,
    Lines,
    mounted,
    moving_robot,
    scenario_of,
    starter_joint,
    write_new,
    yaml_text,
)

WIDE = 1e4
"""Limits of motors whose real limits are unknown, N m and rad/s; a thousand times the limits of robots."""
FIT = ".fit.yaml"
"""Ending of the file for `asrsim identify`, beside the scenario."""


@dataclass(frozen=True, kw_only=True)
class Written:
    """Files made from a recording, and remarks for the user."""

    files: tuple[Path, ...]
    recording: Recording
    remarks: tuple[str, ...]
    """Assumptions that were made, as text."""
    fit: Path | None = None
    """File for `asrsim identify`; None if no recorded motion is compared."""


def write_from_recording(
    robot: Path,
    experiment: Path,
    out: Path,
    *,
    mapping: Sequence[str] = (),
    rate: float | None = None,
    mode: int | None = None,
    actuators: Mapping[str, str] | None = None,
    plugins: Sequence[Path] = (),
    force: bool = False,
    arguments: Mapping[str, str] | None = None,
    packages: Mapping[str, Path] | None = None,
) -> Written:
    """Write a scenario that plays the recorded commands and compares the simulated with the recorded motion.

    Further files beside the scenario: the commands in SI units (`NAME_commands.csv`), the file for `asrsim identify`
    (`NAME.fit.yaml`), and a reading document (such as `lab.csv.yaml`) unless one exists.

    `mapping` and `rate` are as in `asrsim.recordings.read_recording`. `plugins` are written into the fit file. Without `mode`,
    actuators use the mode of the recorded command. The other arguments are as in `asrsim.starter.robot.write_starter`.

    Raises RobotError; RecordingError if the recording cannot be read, or has no joint of the robot or no command; ScenarioError
    for an unknown actuator; and OutputError.
    """
    from asrsim.statics.sizing import sizing

    loaded = moving_robot(robot, arguments, packages)
    joints = [joint.name for joint in loaded.moving_joints]
    recording = read_recording(experiment, mapping=list(mapping) or None, joints=joints, rate=rate)
    given = {} if actuators is None else dict(actuators)
    given_to = [joint for joint in joints if joint in given or "*" in given]
    loaded = with_actuators(loaded, {joint: (name, MOUNTED_MODE) for joint, name in given.items()}, {})
    plan = make_plan(loaded if mode is None else with_overrides(loaded, modes={"*": mode}), recording, step=STEP)
    folder, called = out.parent, relative_path(experiment, out.parent)
    # Items of `map` cannot state everything that a document states, so store the complete document in the recording's folder.
    documented = any(map(is_document, mapping))
    files = Files(
        scenario=out.name,
        robot=robot_key(robot, folder, arguments, packages),
        recording=called,
        commands=f"{out.stem}_commands.csv",
        plugins=tuple(relative_path(plugin, folder) for plugin in plugins),
        mapping=() if documented else tuple(mapping),
        rate=None if documented else rate,
    )
    fit, schema = out.with_suffix(FIT), folder / SCHEMA_FILE
    tables = {folder / name: members for name, members in command_tables(plan, files.commands).items()}
    for path in (out, fit, *tables):
        check_output(path, "schema", inputs=[robot, experiment], replace=True)
    check_output(schema, "schema")
    documents: dict[Path, str] = {}
    if documented:
        proposed = experiment.with_name(experiment.name + ENDING)
        exists = proposed in map(Path, mapping)
    else:
        proposed = out.with_name(experiment.name + ENDING)
        exists = proposed.exists() or reading_file(experiment) is not None
    if not exists and not is_document(str(experiment)):
        named = relative_path(experiment, proposed.parent)
        documents[proposed], _ = propose(experiment, mapping=mapping, rate=rate, joints=joints, called=named)
    commands = {path: command_text(plan, members) for path, members in tables.items()}
    parameters = open_parameters(plan, given_to)
    left = tuple(str(one) for one in plan.exceeded if one.parameter not in parameters.get(one.joint, {}))
    plan = replace(plan, robot=with_overrides(plan.robot, parameters=parameters), remarks=(*plan.remarks, *left))
    if given_to:
        data, _ = recording_data(plan, files, mode=mode, joints=given_to, parameters=parameters)
        with TemporaryDirectory(prefix="asrsim-") as temporary:
            unwritten = {path.name: Path(temporary) / path.name for path in commands}
            for path, text in commands.items():
                unwritten[path.name].write_text(text, encoding="utf-8")
            proposal = sizing(scenario_of(data, plan.robot, folder, unwritten), plan.robot).proposal
        springs = {joint: values for joint, values in proposal.items() if joint in given_to}
        plan = replace(plan, robot=with_overrides(plan.robot, parameters=springs))
        parameters = {joint: {**values, **springs.get(joint, {})} for joint, values in parameters.items()}
    content = recording_data(plan, files, mode=mode, joints=given_to, parameters=parameters)
    texts = {out: yaml_text(*content, list(recording_heading(plan, files))), **commands, **documents}
    if plan.compared:
        texts[fit] = fit_text(plan, files)
    write_new(texts, schema, force=force)
    return Written(files=(*texts, schema), recording=recording, remarks=plan.remarks, fit=fit if plan.compared else None)


# -- the scenario and its commands --

STEP = 0.001
"""Time step of the scenario, s."""
SHARE = 0.1
"""Largest RMSE that a claim allows, as a fraction of the recorded range."""


def command_tables(plan: RecordingPlan, name: str) -> dict[str, list[PlayedRecording]]:
    """Commands by file name, one file for each time base; the first file is called `name`."""
    groups: dict[int, list[PlayedRecording]] = {}
    for one in plan.played:
        groups.setdefault(id(one.column.time), []).append(one)
    stem, dot, ending = name.rpartition(".")
    return {f"{stem}{f'_{i}' if i > 1 else ''}{dot}{ending}": members for i, members in enumerate(groups.values(), start=1)}


def command_text(plan: RecordingPlan, members: Sequence[PlayedRecording]) -> str:
    """CSV of commands in SI units, on the simulation's clock. Missing samples are interpolated."""
    time = members[0].column.time
    values = np.column_stack([shifted(time, plan.lag) if plan.lag else time, *(one.column.values for one in members)])
    for i in range(1, values.shape[1]):
        good = np.isfinite(values[:, i])
        values[:, i] = np.interp(time, time[good], values[good, i])
    return csv_text(["time [s]", *(one.label for one in members)], values)


def open_parameters(plan: RecordingPlan, joints: Sequence[str]) -> dict[str, dict[str, float]]:
    """Values by joint for parameters of springs, motors and controllers that are unknown.

    Limits are so wide that no motor and no recorded deflection reaches them. Constants that the mode needs are 1. Derivative
    gains are 0, since they act like damping, which is fitted.
    """
    found: dict[str, dict[str, float]] = {}
    for block in plan.robot.actuators:
        motors, mode = range(1, ACTUATORS.get(block.actuator).motors + 1), MODES[block.mode]
        if block.joint in joints:
            limits = [f"motor_{i}_max_{what}" for i in motors for what in ("torque", "velocity") if mode.motor]
            constants = missing_constants(block.values(), len(motors), mode) if mode.motor else ()
            gains = [f"controller_{i}_derivative" for i in motors if mode.controller and (mode.motor or i == 1)]
            found[block.joint] = {**dict.fromkeys(limits, WIDE), **dict.fromkeys(constants, 1.0), **dict.fromkeys(gains, 0.0)}
            found[block.joint] |= {
                one.parameter: one.proposal
                for one in plan.exceeded
                if one.joint == block.joint and one.parameter == "max_deflection"
            }
    return found


@dataclass(frozen=True, kw_only=True)
class Files:
    """Files of a scenario from a recording, as the scenario names them, and the options with which the recording is read."""

    scenario: str
    robot: Any
    """Value of the key `robot`."""
    recording: str
    commands: str
    plugins: tuple[str, ...] = ()
    mapping: tuple[str, ...] = ()
    rate: float | None = None

    @property
    def reading(self) -> dict[str, Any]:
        """Options with which the recording is read: `map` and `rate`."""
        mapping = {"map": list(self.mapping)} if self.mapping else {}
        return mapping | ({"rate": self.rate} if self.rate else {})


def recording_data(
    plan: RecordingPlan, files: Files, *, mode: int | None, joints: Sequence[str], parameters: Mapping[str, Mapping[str, float]]
) -> tuple[dict[str, Any], Comments]:
    """Scenario as plain data, and its comments.

    mode: operation mode from the command line. joints: joints whose actuators the scenario states. parameters: values that
    replace the defaults of these actuators, by joint.
    """
    data: dict[str, Any] = {"robot": files.robot, "duration": _exact(plan.duration), "step": STEP}
    comments: Comments = {("duration",): "s, of the recording", ("step",): "s"}
    if plan.on_bench:
        data["engine"] = "bench"
        comments["engine",] = "no motion of a link was recorded: links are locked"
    if joints:
        data["actuators"] = mounted(plan.robot, joints, parameters)
        comments["actuators",] = (
            "wide limits, constants of 1 and derivative gains of 0 stand for unknown values; springs hold the arm"
        )
    modes = {block.joint: block.mode for block in plan.robot.actuators if mode is not None or block.joint in plan.modes}
    if modes := {joint: number for joint, number in modes.items() if joint not in joints}:
        data["modes"] = modes
    starts = {
        joint: {"position": plan.initial.get(joint, 0.0), "motor_positions": list(plan.initial_motors[joint])}
        if joint in plan.initial_motors
        else plan.initial[joint]
        for joint in {**plan.initial, **plan.initial_motors}
    }
    if starts:
        data["initial"] = Lines(starts)
        comments["initial",] = "rad, m; first recorded positions"
    references: dict[str, dict[str, Any]] = {}
    for block in plan.robot.actuators:
        drive = starter_joint(plan.robot, block)
        levels = drive.levels(plan.initial.get(block.joint, 0.0), 0.0, drive.presets[0])
        references[block.joint] = {name: value for name, _, value in levels}
        comments |= {path: f"{text}, not recorded" for path, text in drive.comments().items() if len(path) > 2}
    data["references"] = references
    torques: dict[str, Any] = {}
    for file, members in command_tables(plan, files.commands).items():
        for one in members:
            kind = "hold" if one.hold else "smooth"
            playback = {"playback": {"file": file, "column": one.label, "interpolation": kind}}
            if one.slot is None:
                torques[one.joint] = playback
                continue
            name = list(references[one.joint])[one.slot]
            references[one.joint][name] = playback
            comments["references", one.joint, name] = one.column.source
    if torques:
        data["external_torques"] = torques
    against = {"against": files.recording, "options": {"lag": _exact(plan.lag), **files.reading}}
    data["expect"] = [
        {"joint": joint, "quantity": column.quantity, "measure": "rmse", "comparison": "<", "value": limit, **against}
        for joint, column in plan.compared
        if (limit := _limit(plan, joint, column))
    ]
    comments["expect",] = f"{100 * SHARE:g} % of the recorded range: state how accurate the model should be"
    return data, comments


def _limit(plan: RecordingPlan, joint: str, column: Column) -> float:
    """Largest RMSE that a claim about the column allows; 0 if there is nothing to compare."""
    quantity = str(column.quantity)
    modes = {block.joint: MODES[block.mode] for block in plan.robot.actuators}
    simulated = is_comparable(quantity) and _is_simulated(quantity, modes.get(joint))
    return float(f"{SHARE * np.ptp(column.values[np.isfinite(column.values)]):.2g}") if simulated else 0.0


def recording_heading(plan: RecordingPlan, files: Files) -> Iterator[str]:
    """Comment lines above the scenario."""
    log = shlex.quote(f"out/{files.scenario.rpartition('.')[0]}/default/log.mcap")
    options = [f"--map {shlex.quote(text)}" for text in files.mapping] + ([f"--rate {files.rate:g}"] if files.rate else [])
    options += [shlex.join(plugin_options(files.plugins))] if files.plugins else []
    yield f"yaml-language-server: $schema={SCHEMA_FILE}"
    yield f"Scenario from the recording {files.recording}, written by `asrsim init --experiment`. Units are SI."
    yield f"It plays the recorded commands ({files.commands}) and compares the simulated with the recorded motion."
    yield f"  {command_line('run', files.scenario, files.plugins)}"
    lag = f"--align {_exact(plan.lag)!r}"
    yield f"  asrsim plot {log} --experiment {shlex.quote(files.recording)} {' '.join([lag, *options])}"
    if plan.remarks:
        yield "Assumptions, and peculiarities of the file:"
    yield from (f"  - {' '.join(text.split())}" for text in plan.remarks)
    if plan.lag:
        yield f"The recording starts at {_exact(plan.lag)!r} s of its own clock, which is 0 here."


def _is_simulated(quantity: str, mode: Mode | None) -> bool:
    """Whether a run in this mode computes the quantity: ideal motors have a position only, and rigid joints have no motor."""
    if quantity.startswith("motor_") and not quantity.endswith("_position"):
        return mode is not None and mode.motor
    elastic = quantity.startswith(("motor_", "elastic_torque", "stiffness", "deflection", "equilibrium"))
    return not elastic or (mode is not None and mode.spring)


def _exact(value: float) -> float:
    """Number with twelve digits, which times of long recordings need."""
    return float(f"{value + 0.0:.12g}")


# -- the fit file --

NOT_FITTED = ("max_deflection", "spring_rest_length")
"""Spring parameters that are not freed: limits that recordings seldom reach, and parameters without effect."""
INERTIA = ("ixx", "iyy", "izz")


def fit_text(plan: RecordingPlan, files: Files) -> str:
    """YAML of a fit file for `asrsim identify`."""
    command = command_line("identify", f"{files.scenario.rpartition('.')[0]}.fit.yaml", files.plugins)
    heading = [
        "Fit for `asrsim identify`: the robot's parameters from the recording. docs/identify.md lists further parameters.",
        f"  {command} --check    # which parameters can be identified, within seconds",
        f"  {command}",
        "The last quarter of each recording is held out; `validate: [another.csv]` names a recording instead.",
    ]
    delays, keys = _delays(plan), (key for joint in plan.robot.moving_joints for key in _free(plan, joint))
    data: dict[str, Any] = {
        "scenario": files.scenario,
        "experiments": [{"file": files.recording, **files.reading}],
        **({"plugins": list(files.plugins)} if files.plugins else {}),
        "free": Lines.fromkeys([*keys, *delays[:1], *_zeros(plan)]),
    }
    ties = sorted(_ties(plan))
    if ties:
        data["ties"] = Lines(ties)
    comments = {
        ("free",): "key: start, or {start: 1, low: 0.5, high: 2}; null: the robot's value",
        ("ties",): "key: other key, or 0.5 * other key; equal springs, motors and delays",
    }
    return yaml_text(data, {path: text for path, text in comments.items() if path[0] in data}, heading)


def _free(plan: RecordingPlan, joint: Joint) -> Iterator[str]:
    """Keys of a joint's parameters to fit; a joint without an actuator moves freely."""
    for block in plan.robot.actuators:
        if block.joint == joint.name:
            yield from _free_of_actuator(plan, block)
    if not plan.on_bench:
        strongest = max(range(3), key=lambda i: abs(joint.axis[i]))
        yield f"{joint.name}.damping"
        yield f"{joint.name}.friction"
        yield f"{joint.child}.{'mass' if joint.kind == 'prismatic' else INERTIA[strongest]}"


def _free_of_actuator(plan: RecordingPlan, block: ActuatorBlock) -> Iterator[str]:
    mode = MODES[block.mode]
    for parameter in ACTUATORS.get(block.actuator).parameters if mode.spring else ():
        if parameter.name not in NOT_FITTED and not parameter.name.endswith("_2") and not parameter.unused:
            yield f"{block.joint}.{parameter.name}"
    if mode.motor and block.joint not in _twins(plan.robot):
        yield from (f"{block.joint}.motor_1_{name}" for name in ("inertia", "damping", "friction_torque"))
    # The gains of a rigid servo are seldom known. The gains of motors are known if the robot file states them.
    if mode.controller and not (mode.motor and any(value.origin == "tag" for value in block.parameters.values())):
        yield f"{block.joint}.controller_1_proportional"


def _delays(plan: RecordingPlan) -> list[str]:
    """Keys for the delays of commands to controllers and motors. Torques on links and positions of motors are measured."""
    modes = {block.joint: MODES[block.mode] for block in plan.robot.actuators}
    return [
        f"{one.joint}.{one.column.quantity}.delay"
        for one in plan.played
        if str(one.column.quantity).startswith("reference") and (modes[one.joint].motor or modes[one.joint].controller)
    ]


def _zeros(plan: RecordingPlan) -> Iterator[str]:
    """Keys for the zeros of torques, voltages and currents. Each amplifier has an unknown zero. If no spring or controller
    holds the joint, the effect of this zero on the position grows with the square of the time.
    """
    modes = {block.joint: MODES[block.mode] for block in plan.robot.actuators}
    for one in plan.played:
        if one.slot is not None and (modes[one.joint].direct or modes[one.joint].number == 0):
            yield f"{one.joint}.reference_{one.slot + 1}.offset"


def _twins(robot: Robot) -> dict[str, str]:
    """Map from a joint to an earlier joint whose motors have equal parameters in the robot's file, and are therefore of one
    type."""
    first: dict[object, str] = {}
    twins = {}
    for block in robot.actuators:
        motors = {name: p.value for name, p in block.parameters.items() if name.startswith("motor_") and p.origin == "tag"}
        made = first.setdefault((block.actuator, block.mode, tuple(sorted(motors.items()))), block.joint)
        if motors and made != block.joint:
            twins[block.joint] = made
    return twins


def _ties(plan: RecordingPlan) -> Iterator[tuple[str, str]]:
    """Pairs (key, equal key) for the two springs of an antagonistic actuator, motors of one type, and the delays of
    commands."""
    twins = _twins(plan.robot)
    for block in plan.robot.actuators:
        actuator, mode = ACTUATORS.get(block.actuator), MODES[block.mode]
        names = {parameter.name for parameter in actuator.parameters} if mode.spring else set()
        for name in names:
            if name.endswith("_2") and f"{name[:-2]}_1" in names:
                yield f"{block.joint}.{name}", f"{block.joint}.{name[:-2]}_1"
        twin = twins.get(block.joint, block.joint)
        for i in range(1, actuator.motors + 1) if mode.motor else ():
            if (block.joint, i) != (twin, 1):
                yield f"{block.joint}.motor_{i}_*", f"{twin}.motor_1_*"
    first, *others = _delays(plan) or [""]
    yield from ((key, first) for key in others)
