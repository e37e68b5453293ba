"""A complete learning session, from a scenario to a folder with learned inputs.

As in `asrsim run`, earlier results of the same scenario file and variant are replaced, with a message. Results of another
scenario or variant are not replaced unless overwriting is allowed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, floor, isfinite, log10
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.kinematics.inverse import Demand
from asrsim.learning.figure import write_figure
from asrsim.learning.plant import Plant, make_plant
from asrsim.learning.prepared import PreparedLearning, prepare_learning
from asrsim.learning.state import LearningState, load_state, save_state, simulation_basis
from asrsim.learning.trial import LearningResult, Trial, iterate
from asrsim.outfile import check_output, csv_text, make_folder, remove_ours, write_json, write_text
from asrsim.plain import finite_or_none
from asrsim.progress import Stop, never
from asrsim.runs.folder import inputs_of, recorded_origin, require_same
from asrsim.runs.lock import owned
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.scenario.overrides import Overrides
from asrsim.scenario.relocate import relocated
from asrsim.simulation.examine import Plan, examine

STATE, INPUTS, DESIRED, PLAYBACK, NUMBERS, PICTURE = (
    "state.npz",
    "learned.csv",
    "desired.csv",
    "learned.yaml",
    "ilc.json",
    "ilc.png",
)
KINDS = {
    STATE: "learning state",
    INPUTS: "learned input",
    DESIRED: "learned input",
    PLAYBACK: "learned scenario",
    NUMBERS: "json",
    PICTURE: "picture",
}
"""Kinds of the files of a learning run, by file name. The kinds are defined in `asrsim.outfile`."""
MOST_DEMANDS = 12
"""Largest number of demands that are written to ilc.json."""
DIGITS = 3
"""Number of digits of a claimed error, which is rounded up. Three digits suffice, since a replay with the same plant repeats
the error bit for bit.
"""


@dataclass(frozen=True, kw_only=True)
class LearningSession:
    """Result of a learning session."""

    prepared: PreparedLearning
    result: LearningResult
    replaced: str
    """Message about files of an earlier run that were replaced; empty if no files were replaced."""

    @property
    def reach(self) -> str:
        """Statement whether the joints can perform the motion."""
        return self.prepared.reach(self.result)


def learn(
    scenario: str | Path | Scenario | Plan,
    out: str | Path,
    *,
    variant: str | None = None,
    overrides: Overrides = (),
    plugins: Sequence[str | Path] = (),
    on_start: Callable[[PreparedLearning], None] | None = None,
    on_trial: Callable[[Trial], None] | None = None,
    stop: Stop = never,
    resume: bool = False,
    overwrite: bool = False,
    picture: bool = True,
) -> LearningSession:
    """Learn the inputs with which the joints follow the motion `ilc.trajectory` of a scenario, as `asrsim ilc` does.

        session = asrsim.learn("arm.yaml", "out/arm")
        session.result.converged, session.result.inputs

    Args:
        scenario, variant, overrides, plugins: As in `asrsim.run`.
        out: Folder for state.npz (after each trial), learned.csv, desired.csv, learned.yaml, ilc.json and ilc.png.
        on_start: Function that is called with the prepared problem before the first trial.
        on_trial: Function that is called with each trial.
        stop: Function that is called after each trial. If it returns True, learning ends with the best trial so far.
        resume: Whether to continue from the state in the folder.
        overwrite: Whether to replace results of another scenario, too. Results of the same scenario are always replaced.
        picture: Whether to draw ilc.png.

    Raises:
        InputError, SimulationError, OutputError: As in `asrsim.run`. InputError also if the scenario has no motion to learn.
    """
    plan = examine(scenario, variant=variant, overrides=overrides, plugins=plugins)
    plant, folder = make_plant(plan), Path(out)
    with owned(folder):
        going_on = resume and (folder / STATE).is_file()
        earlier = _earlier(folder, plant.scenario, overwrite=overwrite or going_on)
        prepared, basis = prepare_learning(plant), simulation_basis(plant)
        trials = list(load_state(folder / STATE, basis, prepared.problem).trials) if going_on else []
        if on_start is not None:
            on_start(prepared)

        def ended(trial: Trial) -> None:
            trials.append(trial)
            save_state(folder / STATE, basis, LearningState(trials=tuple(trials)))
            if on_trial is not None:
                on_trial(trial)

        result = iterate(
            prepared.problem, plant.outputs, prepared.settings, ended, law=prepared.law, finished=trials, stop=stop
        )
        replaced = ""
        if earlier and not going_on:
            plural = "s" * (len(earlier) != 1)
            replaced = f"replaced {len(earlier)} file{plural} of an earlier learning run of this scenario"
        session = LearningSession(prepared=prepared, result=result, replaced=replaced)
        _write(session, folder, picture=picture)
        if not picture and folder / PICTURE in earlier:
            remove_ours(folder / PICTURE, KINDS[PICTURE])
        return session


def _earlier(folder: Path, scenario: Scenario, *, overwrite: bool) -> list[Path]:
    """Files of an earlier run that this run will replace.

    Raises OutputError if the folder contains results of another scenario or variant, files that asrsim did not write, or inputs
    of this run.
    """
    for name, kind in KINDS.items():
        check_output(folder / name, kind, inputs=inputs_of(scenario))
    files = [folder / name for name in KINDS if (folder / name).is_file()]
    if files and not overwrite:
        require_same(folder, scenario, recorded_origin(folder / NUMBERS), "unfinished learning, which --resume continues")
    return files


def session_data(session: LearningSession) -> dict[str, Any]:
    """Results of a learning session as plain data for JSON."""
    prepared, result = session.prepared, session.result
    scenario = prepared.plant.scenario
    return {
        "scenario": str(scenario.path or scenario.name),
        "scenario_path": str(scenario.path.resolve()) if scenario.path else "",
        "variant": scenario.variant,
        "outcome": result.outcome,
        "converged": result.converged,
        "reason": result.reason,
        "iterations": result.iterations,
        "best": result.best.number,
        "trials": [trial_data(trial, prepared.problem.joints) for trial in result.trials],
        "law": prepared.settings.law,
        "reach": session.reach,
        "demands": [demand_data(demand) for demand in prepared.demands[:MOST_DEMANDS]],
    }


def trial_data(trial: Trial, joints: Sequence[str]) -> dict[str, Any]:
    """Results of a trial as plain data for JSON, in rad and s."""
    return {
        "iteration": trial.number,
        "largest_error": {joint: finite_or_none(value) for joint, value in zip(joints, trial.largest, strict=True)},
        "rms_error": {joint: finite_or_none(value) for joint, value in zip(joints, trial.rms, strict=True)},
        "largest_norm": finite_or_none(trial.norm),
        "wall_time": trial.seconds,
    }


def demand_data(demand: Demand) -> dict[str, Any]:
    """Demand of the motion on a component of a joint, such as a motor, as plain data for JSON."""
    numbers = {"motor": demand.motor or None, "needed": finite_or_none(demand.needed), "limit": finite_or_none(demand.limit)}
    return vars(demand) | numbers | {"score": finite_or_none(demand.score)}


def _write(session: LearningSession, folder: Path, *, picture: bool) -> None:
    prepared, result = session.prepared, session.result
    plant, problem, scenario = prepared.plant, prepared.problem, prepared.plant.scenario
    inputs, desired = folder / INPUTS, folder / DESIRED
    write_inputs(inputs, plant.time, plant.headings(), result.inputs, comment=f"asrsim ilc: {result.reason}")
    positions = [f"{joint}.link_position [{plant.unit(joint)}]" for joint in plant.joints]
    write_inputs(desired, plant.time, positions, plant.reference, comment="asrsim ilc: the desired motion")
    write_playback(folder / PLAYBACK, plant, inputs, largest=result.best.largest, desired=desired)
    write_json(folder / NUMBERS, session_data(session))
    if picture:
        words = [scenario.name, *([scenario.variant] if scenario.variant not in ("", "default") else [])]
        best = f"largest error {problem.worst(result.best)} in the best trial, number {result.best.number}"
        title = " · ".join([*words, f"law {prepared.settings.law}", f"{result.outcome}: {best}"])
        write_figure(folder / PICTURE, problem, result, prepared.settings, title=title)


def write_inputs(path: Path, time: Array, headings: Sequence[str], values: Array, *, comment: str) -> None:
    """Write a CSV file with `time` (n,) in s and `values` (n, columns), in full precision. Raises OutputError."""
    comments = "".join(f"# {line}\n" for line in comment.splitlines())
    make_folder(path.parent)
    write_text(path, comments + csv_text(["time [s]", *headings], np.column_stack([time, values])), "learned input")


def write_playback(
    path: Path, plant: Plant, inputs: Path, *, largest: Sequence[float] = (), desired: Path | None = None
) -> None:
    """Write a scenario that plays the learned inputs from the CSV file `inputs`. Raises OutputError.

    desired: file with the desired motion; largest: largest error of each joint, rad. The scenario claims that the errors
    relative to the motion in `desired` do not exceed `largest`.
    """
    import yaml

    scenario, folder = plant.scenario, path.parent
    data = relocated(scenario, folder)
    learned = data.pop("ilc", {})
    # Add the variant to the name, since replays of two variants must write to different folders.
    variant = [scenario.variant] if scenario.variant != "default" else []
    data["name"] = "_".join([scenario.name, *variant, inputs.stem])
    # The errors of a replay are relative to the motion to be learned.
    data["desired"] = learned.get("trajectory", {})
    if scenario.inverse_dynamics:
        data["inverse_dynamics"] = {**scenario.inverse_dynamics, **dict.fromkeys(plant.joints, False)}
    data["references"] = _references(data.get("references", {}), plant, os.path.relpath(inputs, folder))
    if desired is not None:
        if not plant.prepared.stepping.released:
            # State the substeps of the trials, so that a replay repeats the best trial bit for bit.
            resolution = plant.prepared.resolution
            data |= {"substeps": resolution.substeps, "motor_substeps": resolution.motor_substeps}
        claim = {
            "quantity": "link_position",
            "measure": "maximum_error",
            "comparison": "<=",
            "against": os.path.relpath(desired, folder),
            "options": {"lag": "off"},
        }
        data["expect"] = [
            {"joint": joint, "value": rounded_up(error), **claim}
            for joint, error in zip(plant.joints, largest, strict=True)
            if isfinite(error)  # a joint of a simulation that diverged has no error
        ]
    text = f"# Plays what `asrsim ilc` learned; the inputs are in {inputs.name}.\n"
    write_text(path, text + yaml.safe_dump(data, sort_keys=False, allow_unicode=True), "learned scenario")


def _references(given: dict[str, Any], plant: Plant, inputs: str) -> dict[str, Any]:
    references = {joint: dict(signals) for joint, signals in given.items()}
    # The entry `*` gives each joint the references that the joint's own entry lacks.
    common = references.pop("*", {})
    for joint, name in zip(plant.joints, plant.names(), strict=True):
        own = references.setdefault(joint, {})
        own[name] = {"playback": {"file": inputs, "column": joint}}
    # Of the references in the entry `*`, keep those that at least one joint lacks. The others would have no effect.
    missed = {
        name
        for drive in plant.prepared.drives
        if drive.mode
        for name in drive.mode.references
        if name not in references.get(drive.name, {})
    }
    left = {name: signal for name, signal in common.items() if name in missed}
    return ({"*": left} if left else {}) | references


def rounded_up(value: float) -> float:
    """Error, rounded up to `DIGITS` digits so that the claimed error is not smaller than the error."""
    if value <= 0.0:
        return 0.0
    places = DIGITS - 1 - floor(log10(value))
    return float(round(ceil(value * 10.0**places) / 10.0**places, max(places, 0)))
