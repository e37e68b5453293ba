"""A whole learning session: from a scenario to learned inputs in a folder. The command line is a thin skin over it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asrsim.errors import OutputError
from asrsim.learning.arm import learning_model
from asrsim.learning.figure import write_figure, write_transfer_figure
from asrsim.learning.folder import (
    DESIRED,
    GUESS,
    GUESS_PLAYBACK,
    INPUTS,
    LOG,
    NUMBERS,
    PICTURE,
    PLAYBACK,
    STATE,
    TRANSFER,
    Earlier,
    clear,
    open_folder,
)  # fmt: skip
from asrsim.learning.iterate import learn
from asrsim.learning.plant import Plant
from asrsim.learning.playback import write_playback
from asrsim.learning.prepared import Prepared, prepare_learning
from asrsim.learning.report import demand_data, result_data, transfer_data
from asrsim.learning.table import write_inputs
from asrsim.learning.transfer import TransferReport, draw_plants, outputs_of, transfer
from asrsim.learning.trial import LearningResult, Trial, worst
from asrsim.outfile import write_json
from asrsim.runs.lock import owned
from asrsim.samples import Array
from asrsim.scenario.learning_keys import KeepLogs
from asrsim.workers import executor

if TYPE_CHECKING:
    from asrsim.log import LogWriter
    from asrsim.samples import RunInfo

MOST_DEMANDS = 12
"""Demands of the motion that are written."""


@dataclass(frozen=True, kw_only=True)
class Session:
    """What a learning session gave."""

    prepared: Prepared
    result: LearningResult
    folder: Path
    """Where everything was written."""
    transfer: TransferReport | None = None
    replaced: Earlier | None = None
    """What the folder held of an earlier run, if anything."""


def run_session(
    plant: Plant,
    folder: Path,
    *,
    on_start: Callable[[Prepared], None] | None = None,
    on_trial: Callable[[Trial], None] | None = None,
    resume: bool = False,
    overwrite: bool = False,
    keep_logs: KeepLogs | None = None,
    with_transfer: bool = False,
    draws: int | None = None,
    processes: int = 1,
    plugins: Sequence[Path] = (),
    picture: bool = True,
) -> Session:
    """Learn, and write into `folder`: state.npz (after each trial), learned.csv, learned.yaml, ilc.json, pictures, logs.

    resume: go on from the folder's state. overwrite: replace what another scenario left there; results of the same one are
    replaced anyway. keep_logs, draws: replace the scenario's. plugins: files with users' actuators, for the other processes.
    on_start is told what the model says before the first trial.
    Raises InputError, SimulationError or OutputError.
    """
    with owned(folder):
        earlier = open_folder(folder, plant.scenario, resume=resume, overwrite=overwrite)
        learning = plant.learning
        keep = keep_logs or learning.keep_logs
        with learning_model(plant) as model, executor(processes, plugins) as workers:
            prepared = prepare_learning(plant, model)
            plant = prepared.plant
            if on_start is not None:
                on_start(prepared)
            logger = _Logger(folder, keep == "all")

            def ended(trial: Trial) -> None:
                # This run's state is on disk now: the earlier run's files may go.
                if trial.number == 0:
                    clear(earlier, but=(folder / STATE, *logger.written))
                if on_trial is not None:
                    on_trial(trial)

            result = learn(
                prepared.problem,
                partial(logger.run, plant),
                prepared.settings,
                ended,
                law=prepared.law,
                state=folder / STATE,
                resume=resume,
            )
            if keep == "last":
                logger.write(plant, result.inputs, LOG)
            report = None
            if with_transfer and learning.transfer is not None:
                drawn = draw_plants(learning.transfer, plant.joints, draws)
                report = transfer(
                    plant.reference,
                    drawn,
                    outputs_of(plant, result.inputs, drawn, workers),
                    joints=plant.joints,
                    tolerance=prepared.settings.tolerance,
                    unit=prepared.problem.unit,
                )
        session = Session(
            prepared=prepared,
            result=result,
            folder=folder,
            transfer=report,
            replaced=earlier if earlier.files else None,
        )
        _write(session, folder, picture=picture)
        return session


def session_data(session: Session) -> dict[str, Any]:
    """A session's numbers as plain values."""
    plant, result = session.prepared.plant, session.result
    path = plant.scenario.path
    data: dict[str, Any] = {
        "scenario": str(path or plant.scenario.name),
        "scenario_path": str(path.resolve()) if path else "",
        "variant": plant.scenario.variant,
    }
    data |= result_data(result, plant.joints)
    data["law"] = session.prepared.settings.law
    data["demands"] = [demand_data(demand) for demand in session.prepared.demands[:MOST_DEMANDS]]
    if session.transfer is not None:
        data["transfer"] = transfer_data(session.transfer)
    return data


def _write(session: Session, folder: Path, *, picture: bool) -> None:
    plant, result, settings = session.prepared.plant, session.result, session.prepared.settings
    inputs, desired = folder / INPUTS, folder / DESIRED
    headings, values = plant.table(result.inputs)
    write_inputs(inputs, plant.time, headings, values, comment=f"asrsim ilc: {result.reason}")
    positions = [f"{joint}.link_position [{plant.unit(joint)}]" for joint in plant.joints]
    write_inputs(desired, plant.time, positions, plant.reference, comment="asrsim ilc: the desired motion")
    write_playback(folder / PLAYBACK, plant, inputs, largest=result.best_trial.largest, desired=desired)
    write_json(folder / NUMBERS, session_data(session))
    if picture:
        write_figure(folder / PICTURE, session.prepared.problem, result, settings, title=_title(session))
        if session.transfer is not None:
            write_transfer_figure(folder / TRANSFER, session.transfer)


def _title(session: Session) -> str:
    """Of the picture: what was learned, how, and what came of it."""
    scenario, result, problem = session.prepared.plant.scenario, session.result, session.prepared.problem
    words = [scenario.name, *([scenario.variant] if scenario.variant not in ("", "default") else [])]
    best = f"{worst(problem, result.best_trial)} off at most in the best trial, number {result.best}"
    return " · ".join([*words, f"law {session.prepared.settings.law}", f"{result.outcome}: {best}"])


def write_guess(plant: Plant, folder: Path, *, overwrite: bool) -> Prepared:
    """Write the inputs of inverse dynamics, and a scenario that plays them, into `folder`. Nothing is simulated.

    Raises InputError or OutputError.
    """
    with owned(folder), learning_model(plant) as model:
        open_folder(folder, plant.scenario, overwrite=overwrite)
        prepared = prepare_learning(plant, model, lawless=True)
        plant = prepared.plant
        headings, values = plant.table(prepared.inverse.inputs_at(plant.time, model.delays))
    write_inputs(folder / GUESS, plant.time, headings, values, comment="asrsim ilc --guess-only: inverse dynamics")
    write_playback(folder / GUESS_PLAYBACK, plant, folder / GUESS)
    return prepared


class _Logger:
    """Writes the logs of trials that are to be kept."""

    def __init__(self, folder: Path, everything: bool) -> None:
        self.folder = folder
        self.everything = everything
        self.count = 0
        self.written: list[Path] = []

    def run(self, plant: Plant, inputs: Array) -> Array:
        """Outputs of a trial, logged if all trials are."""
        if not self.everything:
            return plant.outputs(inputs)
        self.count += 1
        return self.write(plant, inputs, f"trial_{self.count - 1:03d}.mcap")

    def write(self, plant: Plant, inputs: Array, name: str) -> Array:
        """Outputs of a run that is logged to a file of that name."""
        from asrsim.log import LogWriter
        from asrsim.runs.described import as_run

        writers: list[LogWriter] = []
        path, aside = self.folder / name, self.folder / f"{name}.part"

        def sinks(info: RunInfo) -> list[LogWriter]:
            writers.append(LogWriter(aside, as_run(info, plant.with_inputs(inputs), plant.robot)))
            return writers

        try:
            outputs = plant.outputs(inputs, sinks)
            for writer in writers:
                writer.close()
                aside.replace(path)
        except OSError as error:
            raise OutputError(f"{path}: cannot be replaced: {error.strerror or error}") from error
        finally:
            for writer in writers:
                writer.close()
                aside.unlink(missing_ok=True)
        self.written.append(path)
        return outputs
