"""Work of `asrsim plot`: draws runs, alone or beside experiments, with metrics and verdicts. Prints nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

from asrsim.errors import InputError, Problem
from asrsim.log import open_log
from asrsim.metrics import METRICS, ExpectationResult, MetricRow, write_metrics
from asrsim.outfile import make_folder
from asrsim.plain import finite_or_none
from asrsim.plots.bode import bode_pages, pair_in_words
from asrsim.plots.claims import claimed_clocks, claimed_recording, judge
from asrsim.plots.curves import REFERENCE, RunCurves, distinct_labels, drawable_quantities, read_curves, require_curves
from asrsim.plots.figures import FIGURES, FigurePage, run_pages
from asrsim.plots.measured import measured_rows
from asrsim.plots.output import check_formats, save_figure, styled
from asrsim.plots.overlay import comparison_pages
from asrsim.plots.pairing import RECORDED, RunComparison, assign, compare_run, write_recorded
from asrsim.plots.responses import Response, ResponseExperiment, recorded_responses, responses
from asrsim.progress import Progress, Tell
from asrsim.recordings import Recording
from asrsim.recordings.align import LagChoice
from asrsim.scenario.carried import unknown_actuators, unknown_quantities


@dataclass(frozen=True, kw_only=True)
class PlotJob:
    """Logs, recordings, quantities and formats that a plot job draws."""

    logs: tuple[Path, ...]
    folder: Path
    experiments: tuple[str, ...] = ()
    """Recordings, each as the text FILE or VARIANT=FILE."""
    mapping: tuple[str, ...] | Path | None = None
    """Quantities in the recordings' columns: texts COLUMN=JOINT.QUANTITY, or the path of a file with such texts."""
    rate: float | None = None
    """Sampling rate of recordings without a time column, Hz."""
    joints: tuple[str, ...] | None = None
    quantities: tuple[str, ...] | None = None
    figures: tuple[str, ...] | None = None
    """Names in `asrsim.plots.FIGURES` of the figures that show runs without recordings; None: the standard figures."""
    lag: LagChoice = "auto"
    """Lag of the recordings' clocks behind the run's clock in s, or the method that finds the lag."""
    measures: tuple[str, ...] = ()
    """Further measures of run and recording, NAME or NAME:OPTION=VALUE,..."""
    formats: tuple[str, ...] = ("png",)
    bode: bool = False
    band: tuple[float, float] | None = None
    """Frequency band of the Bode plot, Hz."""
    given: str | None = None
    """Input of the frequency response, `quantity` or `joint.quantity`; None: the position reference."""
    output: str | None = None
    """Output of the frequency response; None: the link position."""
    start: float | None = None
    """Simulated time at which the pictures of runs start, s."""
    end: float | None = None

    @property
    def empty(self) -> bool:
        """Whether the job has nothing to draw, since it has neither a log nor a recording for a Bode plot."""
        return not self.logs and not (self.bode and self.experiments)


@dataclass(frozen=True, kw_only=True)
class PlotResult:
    """Files drawn, metrics, verdicts and findings of a plot job."""

    runs: tuple[RunCurves, ...]
    recordings: tuple[Recording, ...] = ()
    assigned: tuple[tuple[Path, str], ...] = ()
    """Each recording with the label of its run, or with `all` if the recording belongs to all runs."""
    compared: tuple[RunComparison, ...] = ()
    responses: tuple[Response, ...] = ()
    rows: tuple[MetricRow, ...] = ()
    claims: tuple[tuple[str, ExpectationResult], ...] = ()
    """Verdicts on claims, each with the label of the run."""
    findings: tuple[Problem, ...] = ()
    files: tuple[Path, ...] = ()
    replaced: int = 0
    """Number of files that were overwritten."""

    @property
    def ok(self) -> bool:
        """Whether every claim holds."""
        return all(result.holds for _, result in self.claims)

    def as_dict(self) -> dict[str, Any]:
        """Result of the plot job as data for `--json`."""
        return {
            "ok": self.ok,
            "runs": [
                {"log": str(run.path), "label": run.label, "status": run.status, "samples": run.samples} for run in self.runs
            ],
            "experiments": [
                {
                    "file": str(path),
                    "run": label,
                    "columns": {c.source: f"{c.joint}.{c.quantity}" for c in recording.channels.values() if c.quantity},
                }
                for (path, label), recording in zip(self.assigned, self.recordings, strict=True)
            ],
            "alignment": [
                {
                    "run": one.label,
                    "experiment": name,
                    "lag": a.lag,
                    "how": a.how,
                    "correlation": a.found.correlation if a.found else None,
                }
                for one in self.compared
                for name, a in one.alignments.items()
            ],
            "metrics": [{**row.__dict__, "value": finite_or_none(row.value)} for row in self.rows],
            "expect": [
                {"run": label, "holds": r.holds, "measured": finite_or_none(r.measured), "text": r.text}
                for label, r in self.claims
            ],
            "findings": [problem.as_dict() for problem in self.findings],
            "files": [str(path) for path in self.files],
        }


def plot(job: PlotJob, progress: Tell | None = None) -> PlotResult:
    """Draw the pictures and return the result. progress: called with the current task and the fraction done.

    Raises InputError for wrong logs, recordings and options, before anything is written; and OutputError.
    """
    formats = check_formats(job.formats)
    if job.empty:
        raise InputError(
            "no log was named",
            key="logs",
            code="no-log",
            hint="Without a log, the frequency response of a recording can be drawn: --experiment FILE --bode",
        )
    if job.figures is not None and (job.experiments or job.bode or job.quantities is not None):
        message = "named figures show runs only: leave out recordings, frequency responses and quantities"
        raise InputError(message, key="figures", value=", ".join(job.figures), code="figures")
    for name in job.figures or ():
        FIGURES.get(name)
    runs = _read_runs(job, progress)
    labels = [run.label for run in runs]
    assigned = assign(labels, job.experiments)
    recordings = _read_recordings(job, [path for path, _ in assigned], runs)
    findings = [one for run in runs for one in unknown_actuators(run.info.joints, run.info.attachments)]
    # If an actuator is unknown, its finding says why the quantities that follow from its springs are not drawn.
    if not (job.experiments or job.bode or findings):
        require_curves(runs, job.quantities or ())
    for run in runs:
        findings += unknown_quantities(run.info.joints, run.info.attachments, job.quantities)
    findings += [finding for recording in recordings for finding in recording.findings]
    members = [[r for r, (_, n) in zip(recordings, assigned, strict=True) if n in (None, k)] for k in range(len(runs))]
    compared = _compared(job, runs, members)
    findings += [finding for one in compared for finding in one.findings]
    rows = [row for one in compared for row in one.rows]
    for run in runs if job.measures and not job.experiments else ():
        rows += measured_rows(run.path, run.label, job.measures, joints=job.joints, quantities=job.quantities)
    found: list[Response] = []
    if job.bode:
        found, problems = _responses(job, runs, recordings, compared)
        rows += [row for one in found for row in one.rows()]
        findings += problems
    claims = [(label, verdict) for label, path in zip(labels, job.logs, strict=True) for verdict in judge(open_log(path))]
    result = PlotResult(
        runs=tuple(runs),
        recordings=tuple(recordings),
        assigned=tuple((path, "all" if n is None else labels[n]) for path, n in assigned),
        compared=tuple(compared),
        responses=tuple(found),
        rows=tuple(rows),
        claims=tuple(claims),
        findings=tuple({str(finding): finding for finding in findings}.values()),
    )
    return _written(job, result, formats)


def _read_runs(job: PlotJob, progress: Tell | None) -> list[RunCurves]:
    alone = not job.experiments and not job.bode
    runs = []
    for number, path in enumerate(job.logs):
        runs.append(
            read_curves(
                path,
                joints=job.joints,
                quantities=job.quantities if alone else _beside(path),
                bodies=alone and job.quantities is None,
                start=job.start,
                end=job.end,
            )
        )
        if progress is not None:
            progress(Progress(task="reading", fraction=(number + 1) / len(job.logs)))
    return distinct_labels(runs)


def _beside(path: Path) -> tuple[str, ...]:
    """Quantities drawn in addition to the compared quantities: the run's reference, if the run has a reference."""
    known = drawable_quantities(open_log(path))
    return (REFERENCE,) if {"link_position", "reference_1"} <= set(known) else known[:1]


def _read_recordings(job: PlotJob, paths: Sequence[Path], runs: Sequence[RunCurves]) -> list[Recording]:
    """Recordings with their columns assigned to joints. Raises InputError with the problems of all files."""
    infos = [run.info for run in runs]
    mapping = job.mapping if isinstance(job.mapping, Path) else list(job.mapping) if job.mapping else None
    recordings: list[Recording] = []
    problems: list[Problem] = []
    for path in paths:
        try:
            recordings.append(claimed_recording(path, infos, mapping=mapping, rate=job.rate))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return recordings


def _compared(job: PlotJob, runs: Sequence[RunCurves], members: Sequence[Sequence[Recording]]) -> list[RunComparison]:
    """Comparison of each run with the recordings that belong to the run (`members`); runs without recordings are omitted."""
    everything = [recording for mine in members for recording in mine]
    claimed = claimed_clocks([run.info for run in runs], everything) if job.lag == "auto" else {}
    lags: dict[str, LagChoice] = dict(claimed)
    compared: list[RunComparison] = []
    for run, mine in zip(runs, members, strict=True):
        if not mine:
            continue
        one = compare_run(
            run.path,
            mine,
            label=run.label,
            joints=job.joints,
            quantities=job.quantities,
            # Use the lag that was found with the first run for all runs, since a recording has one clock.
            lags={str(r.path): lags.get(str(r.path), job.lag) for r in mine},
            measures=job.measures,
        )
        for name, alignment in one.alignments.items():
            lags.setdefault(name, alignment.lag)
        known = {n: replace(a, how="as `expect` compares them") if n in claimed else a for n, a in one.alignments.items()}
        compared.append(replace(one, alignments=known))
    return compared


def _responses(
    job: PlotJob, runs: Sequence[RunCurves], recordings: Sequence[Recording], compared: Sequence[RunComparison]
) -> tuple[list[Response], list[Problem]]:
    """Frequency responses of runs and recordings, and findings. Raises InputError if there is no response."""
    found: list[Response] = []
    problems: list[Problem] = []
    options: dict[str, Any] = {"joints": job.joints, "band": job.band, "given": job.given, "output": job.output}
    for number, run in enumerate(runs):
        experiments = [
            ResponseExperiment(recording=r, joints=one.joints[str(r.path)], lag=one.alignments[str(r.path)].lag)
            for one in compared
            for r in recordings
            if one.label == run.label and str(r.path) in one.alignments
        ]
        more, said = responses(run.path, label=run.label, variant=number, experiments=experiments, **options)
        found += more
        problems += said
    for number, recording in enumerate(recordings if not runs else ()):
        more, said = recorded_responses(recording, variant=number, **options)
        found += more
        problems += said
    if not found:
        raise InputError(problems)
    own = [replace(p, file=p.file or Path(one.source), key=p.key or one.joint.name) for one in found for p in one.findings]
    return found, [*problems, *own]


def _written(job: PlotJob, result: PlotResult, formats: tuple[str, ...]) -> PlotResult:
    """Draw and write the pictures and tables, and return the result with the paths of the written files."""
    folder = make_folder(job.folder)
    before = {path.name for path in folder.iterdir()}
    files: list[Path] = []
    pages: list[Iterator[FigurePage]] = []
    if result.compared:
        runs = [next(run for run in result.runs if run.label == one.label) for one in result.compared]
        references = any(name.startswith("reference") for name in job.quantities or ())
        pages.append(comparison_pages(runs, result.compared, references=references))
    if result.responses:
        robots = ", ".join(dict.fromkeys(run.info.robot for run in result.runs)) or "recorded"
        pages.append(bode_pages(result.responses, title=f"{robots} · {pair_in_words(job.given, job.output)}"))
    with styled():
        for page in chain.from_iterable(pages or [run_pages(result.runs, figures=job.figures, quantities=job.quantities)]):
            files += save_figure(page.figure, folder, page.name, formats)
    if result.compared:
        files.append(write_recorded(folder / RECORDED, result.compared))
    if result.rows:
        write_metrics(folder / METRICS, result.rows)
        files.append(folder / METRICS)
    return replace(result, files=tuple(files), replaced=sum(path.name in before for path in files))
