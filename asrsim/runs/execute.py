"""One run into one folder: log, claims, summary. Neither prints nor draws."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim.errors import DivergenceError
from asrsim.log import LogWriter, open_log
from asrsim.outfile import write_text
from asrsim.quantities import LIMITS
from asrsim.robot.model import Robot
from asrsim.runs.described import as_run
from asrsim.runs.folder import LOG, SUMMARY, new_log, open_folder
from asrsim.samples import RunInfo
from asrsim.scenario.data import Scenario
from asrsim.simulation.certify import COMPARED, Certificate
from asrsim.simulation.certify import certify as certify_run
from asrsim.simulation.crosscheck import cross_check as run_cross_check
from asrsim.simulation.crosscheck import other_engine, require_other_engine
from asrsim.simulation.recording import Sink
from asrsim.simulation.run import Run, simulate
from asrsim.summary import Collector, RunSummary, make_summary
from asrsim.summary.claims import Claims, check_claims, needs_of

if TYPE_CHECKING:
    from asrsim.metrics import ExpectationResult

PLUGINS = "plugins/"
"""Folder among a log's attachments for users' actuator files."""


@dataclass(frozen=True, kw_only=True)
class Executed:
    """A run and what it wrote."""

    run: Run
    summary: RunSummary
    folder: Path
    log: Path
    certificate: Certificate | None = None
    """Numerical error, if it was requested and the run came to its end."""
    error: DivergenceError | None = None
    """Why the run ended early, if it diverged."""


def execute(
    scenario: Scenario,
    folder: Path,
    *,
    robot: Robot | None = None,
    overwrite: bool = False,
    keep: bool = False,
    certify: bool = False,
    cross_check: bool = False,
    started: Callable[[RunInfo], None] | None = None,
    progress: Callable[[float], None] | None = None,
    stop: Callable[[], bool] | None = None,
    certifying: Callable[[str, float], None] | None = None,
) -> Executed:
    """Simulate one variant into `folder`, which must be ours (:func:`asrsim.runs.lock.owned`): `log.mcap`; the summary is
    written by :func:`write_summary`.

    A run that diverges or is stopped gives a closed log and a summary like any other; its status says so. What the folder
    held of an earlier run goes only when this one's log is whole: until then that is written aside. keep: keep all samples in
    `.run.samples` too; certify: run again with finer steps for the numerical error, which goes into log and summary;
    cross_check: run again in another engine for the differences, which go into the summary (certify does so too, where there
    is one); started: called with the run's description when it is built; progress, stop: see
    :func:`asrsim.simulation.run.simulate`; certifying: progress of the further runs.

    Raises InputError and SimulationError if it cannot be built, OutputError if it cannot be written; what the log holds by
    then stays readable, unless there is an earlier one, which stays then.
    """
    if cross_check:
        require_other_engine(scenario)
    earlier = open_folder(folder, scenario, overwrite=overwrite)
    error: DivergenceError | None = None
    certificate: Certificate | None = None
    made: list[tuple[LogWriter, Collector]] = []
    with new_log(folder, earlier) as path, ExitStack() as stack:

        def open_sinks(info: RunInfo) -> Sequence[Sink]:
            collector = collector_of(scenario, info)
            writer = stack.enter_context(LogWriter(path, as_run(info, scenario, robot)))
            made.append((writer, collector))
            if started is not None:
                started(info)
            return [writer, collector]

        try:
            run = simulate(scenario, robot, sinks=open_sinks, keep=keep, progress=progress, stop=stop)
        except DivergenceError as caught:
            if not isinstance(caught.run, Run):
                raise
            error, run = caught, caught.run
        if certify and run.status == "complete":
            certificate = certify_run(scenario, run, robot, progress=certifying, stop=stop)
        ((writer, collector),) = made
        writer.close(result_metadata(run, error, certificate))
    log = folder / LOG
    summary = judged(scenario, run, collector, certificate, samples=writer.samples)
    summary = replace(summary, files={"log": log}, replaced=earlier)
    if run.status == "complete" and (cross_check or (certify and other_engine(scenario.engine))):
        logged = open_log(log).iter_samples(quantities=COMPARED)
        found = run_cross_check(scenario, run.info, logged, robot, progress=certifying)
        summary = replace(summary, cross_check=found)
    return Executed(run=run, summary=summary, folder=folder, log=log, certificate=certificate, error=error)


def collector_of(scenario: Scenario, info: RunInfo) -> Collector:
    """A sink for what summary and claims need. Raises ScenarioError for claims that no run can satisfy or fail."""
    check_claims(scenario.expect, info.joints, file=scenario.path)
    return Collector(info.joints, samples=scenario.steps + 1, needs=needs_of(scenario.expect, info.joints))


def judged(scenario: Scenario, run: Run, collector: Collector, certificate: Certificate | None, *, samples: int) -> RunSummary:
    """The summary of a run that has ended, with its claims and its numerical error. samples: how many were logged."""
    claims: tuple[ExpectationResult, ...] = ()
    if run.status == "complete":
        claims = Claims(scenario.expect, run.info.joints, file=scenario.path, checked=True).results(collector.read)
    # The run's scenario has the motion that a Cartesian task was planned to.
    seen = collector.seen(run.scenario.desired, balanced=run.scenario.initial_equilibrium)
    summary = make_summary(run, seen, samples=samples, claims=claims)
    return summary if certificate is None else replace(summary, certificate=certificate.as_dict())


def write_summary(executed: Executed) -> Executed:
    """Write `summary.json` beside the log; the summary then lists it. Raises OutputError."""
    path = executed.folder / SUMMARY
    summary = replace(executed.summary, files={**executed.summary.files, "summary": path})
    save_summary(summary, path)
    return replace(executed, summary=summary)


def save_summary(summary: RunSummary, path: Path) -> None:
    """A summary as a file. Raises OutputError."""
    write_text(path, json.dumps(summary.as_dict(), indent=2, ensure_ascii=False, allow_nan=False) + "\n", "json")


def result_metadata(run: Run, error: DivergenceError | None = None, certificate: Certificate | None = None) -> dict[str, str]:
    """What the log says of how the run ended. No wall-clock times: equal runs have equal logs."""
    metadata = {"status": run.status, "simulated_time": repr(float(run.simulated_time))}
    if error is not None:
        metadata |= {"message": str(error), "joint": error.joint, "time": repr(float(error.time))}
    counts = run.counts
    names = [joint.name for joint in run.robot.moving_joints]
    for kind in LIMITS:
        counted = {name: int(count) for name, count in zip(names, getattr(counts, kind), strict=True) if count}
        if counted:
            metadata[f"limit_{kind}"] = json.dumps(counted)
    if certificate is not None:
        metadata["certificate"] = json.dumps(certificate.as_dict())
    return metadata


def with_plugins(scenario: Scenario, plugins: Sequence[Path]) -> Scenario:
    """The scenario with users' actuator files among its attachments, so that its log can be run again."""
    if not plugins:
        return scenario
    names: dict[str, Path] = {}
    for path in plugins:
        name, number = f"{PLUGINS}{path.name}", 2
        while name in names:
            name, number = f"{PLUGINS}{path.stem}_{number}{path.suffix}", number + 1
        names[name] = path
    return replace(scenario, attachments={**scenario.attachments, **names})
