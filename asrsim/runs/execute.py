"""Simulates a scenario, evaluates its claims, and writes log and summary into a folder. This module neither prints nor
plots."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asrsim.errors import DivergenceError, InputError
from asrsim.log import LogWriter
from asrsim.outfile import write_json
from asrsim.progress import Stop, Tell
from asrsim.quantities import LIMITS
from asrsim.runs.described import as_run
from asrsim.runs.folder import LOG, SUMMARY, new_log, open_folder
from asrsim.samples import RunInfo
from asrsim.scenario.data import Scenario
from asrsim.scenario.digest import input_hashes
from asrsim.simulation import accuracy
from asrsim.simulation.examine import Plan
from asrsim.simulation.recording import Sink
from asrsim.simulation.run import Run, simulate
from asrsim.summary import Collector, RunSummary, make_summary
from asrsim.summary.claims import Claims, needs_of

if TYPE_CHECKING:
    from asrsim.metrics import ExpectationResult

INPUTS = "inputs"
"""Metadata key under which a log stores the hashes of all inputs, as JSON."""


@dataclass(frozen=True, kw_only=True)
class Executed:
    """Result of a run and the files that it wrote."""

    run: Run
    summary: RunSummary
    folder: Path | None = None
    log: Path | None = None
    """Path of the log; None if no log was written."""
    error: DivergenceError | None = None
    """Error that ended the run if it diverged; else None."""


def execute(
    plan: Plan,
    folder: Path | None = None,
    *,
    overwrite: bool = False,
    keep: bool = False,
    certify: bool = False,
    cross_check: bool = False,
    started: Callable[[RunInfo], None] | None = None,
    progress: Tell | None = None,
    stop: Stop | None = None,
) -> Executed:
    """Simulate one variant and write its log into `folder`, if a folder is given. `write_summary` writes the summary.

    A run that diverges or is stopped also gives a readable log and a summary, which state how the run ended. If the folder
    contains an earlier log, the new log first has another name, and replaces the earlier run's files when it is complete.

    Args:
        plan: The variant, examined for problems.
        folder: Folder locked by this process (`asrsim.runs.lock.owned`); None: no log is written, and `keep` must be set.
        overwrite: Whether results of another scenario or variant in the folder are replaced.
        keep: Whether all samples are also kept in memory, in `.run.samples` of the result.
        certify: Whether the numerical error is estimated by runs with finer steps, and by a run in `accuracy.other_engine`.
        cross_check: Whether the run is repeated in another engine; the summary states the differences.
        started: Function that is called with the description of the run when the run is built.
        progress: As in `asrsim.simulation.run.simulate`; the progress of additional runs has a `task`.
        stop: As in `asrsim.simulation.run.simulate`.

    Raises:
        InputError, SimulationError: The run cannot be built.
        OutputError: The log cannot be written. An earlier log, or else the written part of the new log, remains readable.
    """
    scenario = plan.scenario
    other = accuracy.other_engine(scenario.engine, required=cross_check)
    earlier = open_folder(folder, scenario, overwrite=overwrite) if folder is not None else ()
    error: DivergenceError | None = None
    certificate: dict[str, Any] = {}
    collectors: list[Collector] = []
    writers: list[LogWriter] = []
    with ExitStack() as stack:
        path = stack.enter_context(new_log(folder, earlier)) if folder is not None else None

        def open_sinks(info: RunInfo) -> Sequence[Sink]:
            collectors.append(collector_of(plan))
            if path is not None:
                described = as_run(info, scenario, plan.source if plan.given else None)
                writers.append(stack.enter_context(LogWriter(path, described)))
            if started is not None:
                started(info)
            return [*writers, *collectors]

        try:
            run = simulate(plan, sinks=open_sinks, keep=keep, progress=progress, stop=stop)
        except DivergenceError as caught:
            if not isinstance(caught.run, Run):
                raise
            error, run = caught, caught.run
        if certify and run.status == "complete":
            certificate = accuracy.certify(plan, run, progress=progress, stop=stop)
        for writer in writers:
            certified = {"certificate": json.dumps(certificate)} if certificate else {}
            writer.close(result_metadata(run, error) | certified)
    log = folder / LOG if folder is not None else None
    samples = writers[0].samples if writers else 0 if run.samples is None else len(run.samples.time)
    summary = judged(scenario, run, collectors[0], samples=samples)
    files = {} if log is None else {"log": log}
    summary = replace(summary, certificate=certificate, files=files, replaced=earlier)
    if run.status == "complete" and other is not None and (cross_check or certify):
        summary = replace(summary, cross_check=accuracy.cross_check(plan, run, other, progress=progress))
    return Executed(run=run, summary=summary, folder=folder, log=log, error=error)


def collector_of(plan: Plan) -> Collector:
    """Receiver of a run's samples that collects the data for the run's summary and claims."""
    claims, joints = plan.scenario.expect, plan.joints
    return Collector(joints, samples=plan.scenario.steps + 1, needs=needs_of(claims, joints))


def judged(scenario: Scenario, run: Run, collector: Collector, *, samples: int) -> RunSummary:
    """Summary of a run that has ended, with the verdicts on its claims. samples: number of logged samples."""
    claims: tuple[ExpectationResult, ...] = ()
    if run.status == "complete":
        claims = Claims(scenario.expect, run.info.joints, file=scenario.path, checked=True).results(collector.read)
    # Use `run.scenario`, which contains the joint motion that was planned for a Cartesian task.
    seen = collector.seen(run.scenario.desired, balanced=run.scenario.initial_equilibrium)
    return make_summary(run, seen, samples=samples, claims=claims)


def write_summary(executed: Executed) -> Executed:
    """Write `summary.json` beside the log, if there is a log, and add its path to the summary's files. Raises OutputError."""
    if executed.folder is None:
        return executed
    path = executed.folder / SUMMARY
    summary = replace(executed.summary, files={**executed.summary.files, "summary": path})
    write_json(path, summary.as_dict())
    return replace(executed, summary=summary)


def result_metadata(run: Run, error: DivergenceError | None = None) -> dict[str, str]:
    """Metadata of a log that state how the run ended. They contain no wall-clock times, so that equal runs have equal logs."""
    metadata = {"status": run.status, "simulated_time": repr(float(run.simulated_time))}
    with suppress(InputError):  # a file may have been removed during the run
        metadata[INPUTS] = json.dumps(input_hashes(run.scenario, run.robot))
    if error is not None:
        metadata |= {"message": str(error), "joint": error.joint, "time": repr(float(error.time))}
    counts = run.counts
    names = [joint.name for joint in run.robot.moving_joints]
    for kind in LIMITS:
        counted = {name: int(count) for name, count in zip(names, getattr(counts, kind), strict=True) if count}
        if counted:
            metadata[f"limit_{kind}"] = json.dumps(counted)
    return metadata
