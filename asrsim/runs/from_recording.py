"""Makes a scenario from a recording, with the files that the scenario needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from asrsim.outfile import check_output, write_text
from asrsim.recordings import Recording, read_recording
from asrsim.recordings.propose import propose
from asrsim.recordings.reading import ENDING, is_document, reading_file, resolve_reading
from asrsim.robot import with_actuators, with_overrides
from asrsim.scenario.schema import schema_text
from asrsim.scenario.starter import (
    MOUNTED_MODE,
    SCHEMA_FILE,
    moving_robot,
    relative_path,
    robot_key,
    scenario_of,
    write_new,
    yaml_text,
)
from asrsim.scenario.starter_fit import fit_text
from asrsim.scenario.starter_recording import (
    STEP,
    Files,
    command_tables,
    command_text,
    make_plan,
    open_parameters,
    recording_data,
    recording_heading,
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
    from asrsim.kinematics.sizing import sizing

    loaded = moving_robot(robot, arguments, packages)
    joints = [joint.name for joint in loaded.moving_joints]
    recording = read_recording(experiment, mapping=list(mapping) or None, joints=joints, rate=rate)
    given = {} if actuators is None else dict(actuators)
    mounted = [joint for joint in joints if joint in given or "*" in given]
    loaded = with_actuators(loaded, {joint: (name, MOUNTED_MODE) for joint, name in given.items()}, {})
    plan = make_plan(loaded if mode is None else with_overrides(loaded, modes={"*": mode}), recording, step=STEP)
    folder, called, items = out.parent, relative_path(experiment, out.parent), mapping
    if any(map(is_document, mapping)):  # the document becomes items of `map`, so that the scenario does not need the document
        items = resolve_reading(mapping, experiment).items
    files = Files(
        scenario=out.name, robot=robot_key(robot, folder, arguments, packages), recording=called,
        commands=f"{out.stem}_commands.csv", plugins=tuple(relative_path(plugin, folder) for plugin in plugins),
        mapping=tuple(items), rate=rate,
    )  # fmt: skip
    fit, schema = out.with_suffix(FIT), folder / SCHEMA_FILE
    tables = {folder / name: members for name, members in command_tables(plan, files.commands).items()}
    for path in (out, fit, *tables):
        check_output(path, "schema", inputs=[robot, experiment], replace=True)
    check_output(schema, "schema")
    for path, members in tables.items():
        write_new(path, command_text(plan, members), force=force)
    parameters = open_parameters(plan.robot, mounted)
    plan = replace(plan, robot=with_overrides(plan.robot, parameters=parameters))
    if mounted:
        data, _ = recording_data(plan, files, mode=mode, joints=mounted, parameters=parameters)
        proposal = sizing(scenario_of(data, plan.robot, folder), plan.robot).proposal
        springs = {joint: values for joint, values in proposal.items() if joint in mounted}
        plan = replace(plan, robot=with_overrides(plan.robot, parameters=springs))
        parameters = {joint: {**values, **springs.get(joint, {})} for joint, values in parameters.items()}
    content = recording_data(plan, files, mode=mode, joints=mounted, parameters=parameters)
    write_new(out, yaml_text(*content, list(recording_heading(plan, files))), force=force)
    written = [out, *tables]
    proposed = out.with_name(experiment.name + ENDING)
    if not (proposed.exists() or reading_file(experiment) or any(is_document(one) for one in [str(experiment), *mapping])):
        written.append(propose(experiment, proposed, mapping=mapping, rate=rate, joints=joints, called=called)[0])
    if plan.compared:
        write_new(fit, fit_text(plan, files), force=force)
        written.append(fit)
    write_text(schema, schema_text(), "schema")
    return Written(files=(*written, schema), recording=recording, remarks=plan.remarks, fit=fit if plan.compared else None)
