"""Makes a scenario from a recording, with the files that the scenario needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from asrsim.outfile import check_output
from asrsim.recordings import Recording, read_recording
from asrsim.recordings.propose import propose
from asrsim.recordings.reading import ENDING, is_document, reading_file, resolve_reading
from asrsim.robot import Robot, with_actuators, with_overrides
from asrsim.scenario.schema import schema_text
from asrsim.scenario.starter import (
    MOUNTED_MODE,
    SCHEMA_FILE,
    moving_robot,
    relative_path,
    scenario_of,
    schema_beside,
    write_new,
)  # fmt: skip
from asrsim.scenario.starter_fit import fit_text
from asrsim.scenario.starter_recording import (
    STEP,
    Names,
    command_tables,
    command_text,
    fitting_modes,
    make_plan,
    open_parameters,
    recording_text,
)

FIT = ".fit.yaml"
"""Ending of the file for `asrsim identify`, beside the scenario."""


@dataclass(frozen=True, kw_only=True)
class Written:
    """Files made from a recording, and remarks for the user."""

    files: tuple[Path, ...]
    recording: Recording
    remarks: tuple[str, ...]
    """Assumptions made, as text."""
    fit: Path | None = None
    """File for `asrsim identify`; None where no recorded motion is compared."""


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
    schema: bool = True,
    arguments: Mapping[str, str] | None = None,
    packages: Mapping[str, Path] | None = None,
) -> Written:
    """Write a scenario that plays the recorded commands and compares the simulated with the recorded motion.

    Further files beside the scenario: the commands in SI units (`NAME_commands.csv`), the file for `asrsim identify`
    (`NAME.fit.yaml`), and a reading document (such as `lab.csv.yaml`) unless one exists.

    `mapping` and `rate` are those of `asrsim.recordings.read_recording`. `plugins` are written into the fit file. Without
    `mode`, actuators use the mode of the recorded command. The other arguments are those of
    `asrsim.scenario.starter.write_starter`.

    Raises RobotError, RecordingError (unreadable, no common joint, no command), ScenarioError (unknown actuator), OutputError.
    """
    loaded = moving_robot(robot, arguments, packages)
    joints = [joint.name for joint in loaded.moving_joints]
    recording = read_recording(experiment, mapping=list(mapping) or None, joints=joints, rate=rate)
    mounted = [joint for joint in joints if joint in (actuators or {}) or "*" in (actuators or {})]
    loaded, unknown = _mounted(loaded, recording, actuators or {}, mounted, mode)
    given = mapping
    if any(map(is_document, mapping)):  # the document becomes items of `map`, so that the scenario does not need the document
        mapping = resolve_reading(mapping, experiment).items
    plan = make_plan(loaded, recording, step=STEP)
    folder, called = out.parent, relative_path(experiment, out.parent)
    names = Names(
        scenario=out.name, robot=relative_path(robot, folder), recording=called, commands=f"{out.stem}_commands.csv",
        schema=SCHEMA_FILE if schema else None, arguments=arguments or {},
        packages={name: relative_path(path, folder) for name, path in (packages or {}).items()},
        plugins=tuple(relative_path(plugin, folder) for plugin in plugins),
    )  # fmt: skip
    beside = schema_beside(out) if schema else None
    fit = out.with_suffix(FIT) if plan.compared else None
    tables = {folder / name: members for name, members in command_tables(plan, names.commands).items()}
    for path in (out, out.with_suffix(FIT), *tables):
        check_output(path, "schema", inputs=[robot, experiment], replace=True)
    for path, members in tables.items():
        write_new(path, command_text(plan, members), force=force)
    write = partial(recording_text, names=names, mode=mode, mounted=mounted, mapping=tuple(mapping), rate=rate)
    springs = _springs_that_hold(write(plan, parameters=unknown), plan.robot, folder, mounted)
    plan = replace(plan, robot=with_overrides(plan.robot, parameters=springs))
    parameters = {joint: {**unknown.get(joint, {}), **springs.get(joint, {})} for joint in mounted}
    write_new(out, write(plan, parameters=parameters), force=force)
    files = [out, *tables]
    proposed = out.with_name(experiment.name + ENDING)
    if not (proposed.exists() or reading_file(experiment) or any(is_document(one) for one in [str(experiment), *given])):
        files.append(propose(experiment, proposed, mapping=given, rate=rate, joints=joints, called=called)[0])
    if fit is not None:
        text = fit_text(plan, out.name, called, mapping=mapping, rate=rate, plugins=names.plugins)
        write_new(fit, text, force=force)
        files.append(fit)
    if beside is not None:
        write_new(beside, schema_text(), force=True)
        files.append(beside)
    return Written(files=tuple(files), recording=recording, remarks=plan.remarks, fit=fit)


def _mounted(
    robot: Robot, recording: Recording, actuators: Mapping[str, str], joints: Sequence[str], mode: int | None
) -> tuple[Robot, dict[str, dict[str, float]]]:
    """Robot with these actuators on `joints`, in the modes of the recorded commands, and estimates of unknown parameters."""
    robot = with_actuators(robot, {joint: (name, MOUNTED_MODE) for joint, name in actuators.items()}, {})
    modes = {"*": mode} if mode is not None else fitting_modes(robot, recording, joints)
    unknown = open_parameters(robot, modes, joints)
    return with_overrides(robot, modes=modes, parameters=unknown), unknown


def _springs_that_hold(text: str, robot: Robot, folder: Path, joints: Sequence[str]) -> dict[str, Mapping[str, float]]:
    """Parameters of the springs that hold the arm at the first recorded commands: joint -> parameters, for `joints` only."""
    from asrsim.kinematics.sizing import sizing

    proposal = sizing(scenario_of(text, robot, folder), robot).proposal if joints else {}
    return {joint: values for joint, values in proposal.items() if joint in joints}
