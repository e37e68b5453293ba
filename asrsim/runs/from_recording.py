"""A scenario from a recording: written, run once, and its claims set from that first comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from asrsim.errors import AsrsimError, RecordingError
from asrsim.outfile import check_output
from asrsim.recordings import Recording, compare, read_recording
from asrsim.recordings.propose import propose
from asrsim.recordings.reading import ENDING, is_document, reading_file, resolve_reading
from asrsim.robot import Robot, with_actuators, with_overrides
from asrsim.samples import Array
from asrsim.scenario.load import load_scenario
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
    First,
    Names,
    Plan,
    extract,
    first_claims,
    fitting_modes,
    make_plan,
    open_parameters,
    placeholders,
    recording_text,
)
from asrsim.simulation.run import simulate

FIT = ".fit.yaml"
"""Ending of the file for `asrsim identify`, beside the scenario."""
MOST = 2_000_000
"""Samples of joints (steps times joints) up to which the scenario is run for the claims' limits."""


@dataclass(frozen=True, kw_only=True)
class Written:
    """What was made of a recording."""

    files: tuple[Path, ...]
    recording: Recording
    remarks: tuple[str, ...]
    """Assumptions, in words."""
    compared: bool
    """The limits of the claims come from a first run; else they are placeholders."""
    message: str = ""
    """Why there was no first comparison."""
    fit: Path | None = None
    """File for `asrsim identify`; None where nothing is compared."""


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
    """Write a scenario that plays the recorded commands and compares with the recorded motion, and a fit file beside it.

    Where no document says how the recording is read, one is proposed beside the scenario, `lab.csv.yaml`. Where the playback
    signal cannot read the file as it is (bags, MATLAB, repaired times), the commands are written beside the scenario as
    `<its name>_commands.csv`. mapping, rate: as for :func:`asrsim.recordings.read_recording`; plugins: that the fit file
    names; the others as for :func:`asrsim.scenario.starter.write_starter`. Without `mode`, actuators that are given are in
    that of the recorded command.

    Raises RobotError, RecordingError (unreadable, no common joint, no command), ScenarioError (unknown actuator), OutputError.
    """
    loaded = moving_robot(robot, arguments, packages)
    joints = [joint.name for joint in loaded.moving_joints]
    recording = read_recording(experiment, mapping=list(mapping) or None, joints=joints, rate=rate)
    mounted = [joint for joint in joints if joint in (actuators or {}) or "*" in (actuators or {})]
    loaded, unknown = _mounted(loaded, recording, actuators or {}, mounted, mode)
    given = mapping
    if any(map(is_document, mapping)):  # it is written down as items: the scenario stands alone
        mapping = resolve_reading(mapping, experiment).items
    plan = make_plan(loaded, recording, step=STEP)
    commands = f"{out.stem}_commands.csv"
    extracted = extract(plan, commands)
    names = Names(
        scenario=out.name, robot=relative_path(robot, out.parent), recording=relative_path(experiment, out.parent),
        extract=commands, schema=SCHEMA_FILE if schema else None, arguments=arguments or {},
        packages={name: relative_path(folder, out.parent) for name, folder in (packages or {}).items()},
        plugins=tuple(relative_path(plugin, out.parent) for plugin in plugins),
    )  # fmt: skip
    beside = schema_beside(out) if schema else None
    fit = out.with_suffix(FIT)
    for path in (out, fit, *(out.parent / name for name in extracted)):
        check_output(path, "schema", inputs=[robot, experiment], replace=True)
    for name, text in extracted.items():
        write_new(out.parent / name, text, force=force)
    write = partial(recording_text, names=names, mode=mode, mounted=mounted, mapping=tuple(mapping), rate=rate)
    springs = _springs_that_hold(write(plan, claims=placeholders(plan), parameters=unknown), plan.robot, out.parent, mounted)
    plan = replace(plan, robot=with_overrides(plan.robot, parameters=springs))
    text_with = partial(
        write, plan, parameters={joint: {**unknown.get(joint, {}), **springs.get(joint, {})} for joint in mounted}
    )
    write_new(out, text_with(claims=placeholders(plan)), force=force)
    files = [out]
    proposed = out.with_name(experiment.name + ENDING)
    described = proposed.exists() or reading_file(experiment) or any(is_document(one) for one in [str(experiment), *given])
    if not described:
        called = relative_path(experiment, out.parent)
        files.append(propose(experiment, proposed, mapping=given, rate=rate, joints=joints, called=called)[0])
    fits = bool(plan.compared)
    if fits:
        text = fit_text(plan, out.name, names.recording, mapping=mapping, rate=rate, plugins=names.plugins)
        write_new(fit, text, force=force)
        files.append(fit)
    files += [out.parent / name for name in extracted]
    measured, message = _first_comparison(out, plan)
    if measured:
        write_new(out, text_with(claims=first_claims(plan, measured)), force=True)
    if beside is not None:
        write_new(beside, schema_text(), force=True)
        files.append(beside)
    return Written(
        files=tuple(files),
        recording=recording,
        remarks=plan.remarks,
        compared=bool(measured),
        message=message,
        fit=fit if fits else None,
    )


def _mounted(
    robot: Robot, recording: Recording, actuators: Mapping[str, str], joints: Sequence[str], mode: int | None
) -> tuple[Robot, dict[str, dict[str, float]]]:
    """The robot with these actuators on `joints`, in the modes of their recorded commands, and guesses for
    unknown parameters."""
    robot = with_actuators(robot, {joint: (name, MOUNTED_MODE) for joint, name in actuators.items()}, {})
    modes = {"*": mode} if mode is not None else fitting_modes(robot, recording, joints)
    unknown = open_parameters(robot, modes, joints)
    return with_overrides(robot, modes=modes, parameters=unknown), unknown


def _springs_that_hold(text: str, robot: Robot, folder: Path, joints: Sequence[str]) -> dict[str, Mapping[str, float]]:
    """Joint -> parameters with which its spring holds the arm where the recording's commands begin; of `joints` alone."""
    from asrsim.kinematics.sizing import sizing

    proposal = sizing(scenario_of(text, robot, folder), robot).proposal if joints else {}
    return {joint: values for joint, values in proposal.items() if joint in joints}


def _first_comparison(path: Path, plan: Plan) -> tuple[dict[tuple[str, str], First], str]:
    """What each joint's quantity gave, of the scenario as written; empty, with the reason, where it cannot be had."""
    if plan.duration / STEP * len(plan.robot.moving_joints) > MOST:
        return {}, "the recording is too long for a first comparison here"
    (scenario,) = load_scenario(path)
    try:
        run = simulate(scenario)
        if run.samples is None:
            return {}, "the first run kept no samples"
        found = compare(run.samples, plan.recording, infos=run.info.joints, joints=plan.pairing, lag=plan.lag)
    except RecordingError as error:
        return {}, str(error)
    except AsrsimError as error:
        return {}, f"the first run failed: {error}"
    result = {
        (s.joint, s.quantity): First(
            rmse=s.metrics["rmse"], nrmse=s.metrics["nrmse"], r2=s.metrics["r2"],
            moved=_extent(s.simulation) / _extent(s.recording),
        )
        for s in found.series
        if np.isfinite(s.metrics["rmse"]) and _extent(s.recording) > 0.0
    }  # fmt: skip
    return result, ""


def _extent(values: Array) -> float:
    return float(np.nanmax(values) - np.nanmin(values))
