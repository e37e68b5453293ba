"""Runs a study: prepares it, distributes its runs among workers, and writes their rows. Also repeats a single run with a
log."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from asrsim import __version__
from asrsim.engines.libraries import numeric_versions
from asrsim.errors import InputError, SimulationError
from asrsim.extras import library
from asrsim.plugins import check_named
from asrsim.progress import Progress, Stop
from asrsim.renamed import renamed
from asrsim.runs.execute import execute, write_summary
from asrsim.runs.lock import owned
from asrsim.scenario.digest import input_hashes
from asrsim.simulation.examine import examine
from asrsim.summary import RunSummary
from asrsim.sweeps.cases import Payload, make_payload
from asrsim.sweeps.rows import Runner, StudyRow, row_of
from asrsim.sweeps.samplers import SAMPLERS
from asrsim.sweeps.store import open_store
from asrsim.sweeps.study import Study, is_study, make_study, present_name, read_study
from asrsim.sweeps.table import Table
from asrsim.workers import Lost, cores
from asrsim.workers.cluster import Cluster
from asrsim.workers.local import Processes


@dataclass(frozen=True, kw_only=True)
class StudyProgress(Progress):
    """Progress of a study."""

    done: int
    total: int
    rate: float
    """Runs per second that this session has finished, averaged since its start."""
    statuses: Mapping[str, int]
    """Number of runs of this session by status."""


@renamed(design="sampler")
def sweep(
    scenario: str | Path | Study,
    over: Mapping[str, Any] | Sequence[str] = (),
    *,
    workers: int | None = None,
    cluster: str | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    overwrite: bool = False,
    progress: Callable[[StudyProgress], None] | None = None,
    stop: Stop | None = None,
    **options: Any,
) -> Table:
    """Run a study and return its table, like `asrsim sweep`, but without pictures.

        table = asrsim.sweep("arm.yaml", {"parameters.*.spring_stiffness": "10:200:20"}, workers=2)
        table.to_pandas()

    Args:
        scenario: Scenario file, or a study: a file with the key `scenario`, or a result of `make_study`.
        over: Key -> list, range as text, or distribution; see docs/sweep.md.
        workers: Number of processes; None: one process per core.
        cluster: Address of a Dask scheduler, used instead of processes on this machine.
        out: Folder for the rows; None: a temporary folder, which is deleted with the table.
        resume: Whether the rows in `out` are kept and only the missing runs are simulated.
        overwrite: Whether the rows in `out` are replaced.
        progress: Function that is called with the progress of the study when rows arrive.
        stop: Function that is called often; the study ends with the rows so far when it returns True.
        options: Options of a study: variants, overrides, sampler, samples, seed, fit, plugins.

    Raises:
        InputError: No run of the study can succeed: unknown keys, values out of range; or `out` contains another study.
        SimulationError: Workers cannot start, or the cluster cannot be used.
        OutputError: Rows cannot be written; rows written before remain.
    """
    # Report a missing library before preparing the study, which takes seconds.
    library("pyarrow", "sweep")
    if workers is not None and workers < 1:
        raise InputError("must be at least 1", key="workers", value=workers, code="workers")
    payload = make_payload(study_of(scenario, over, options))
    temporary = None
    if out is None:
        temporary = TemporaryDirectory(prefix="asrsim-sweep-")
        out = temporary.name
    folder, plugins = Path(out), payload.study.plugins
    began, statuses = clock.monotonic(), dict.fromkeys(("complete", "diverged", "failed", "crashed"), 0)
    status = list(payload.kinds).index("status")
    with owned(folder):
        store = open_store(folder, manifest(payload), resume=resume, overwrite=overwrite)
        missing = store.missing
        # Use a separate process even for a single worker, so that a run that crashes the process still becomes a row. Do not
        # contact the cluster if no run is missing.
        executor = Cluster(cluster, plugins) if cluster and missing else Processes(workers or cores(), plugins)
        try:
            with executor:
                for found in executor.results(Runner(payload), missing, stop=stop):
                    rows = [crashed_row(payload, missing[n], row) if isinstance(row, Lost) else row for n, row in found]
                    for row in store.add(rows):
                        statuses[row[status]] += 1
                    if progress is not None:
                        rate = sum(statuses.values()) / (clock.monotonic() - began)
                        done = int(store.done.sum())
                        share = done / max(store.total, 1)
                        progress(StudyProgress(fraction=share, done=done, total=store.total, rate=rate, statuses=statuses))
        finally:
            # Write the rows that have arrived, even if an error or Ctrl-C ended the study.
            store.finish()
    return Table(folder, keep=temporary, checked=True)


def study_of(scenario: str | Path | Study, over: Any, options: Mapping[str, Any]) -> Study:
    """Study from a `Study`, a study file or a scenario file. Raises InputError, and SimulationError if `over` or options are
    given with a `Study` or a study file, which contain them already.
    """
    if isinstance(scenario, Study):
        study = scenario
    elif is_study(Path(scenario)):
        options = dict(options)
        study = read_study(Path(scenario), options.pop("plugins", ()))
    else:
        return make_study(scenario, over, **options)
    if over or options:
        names = ", ".join(["over"] if over else [*options])
        raise SimulationError(f"{names} is valid with a scenario only: a study defines its own variations")
    return study


def crashed_row(payload: Payload, run: int, lost: Lost) -> StudyRow:
    """Row of a run during which its workers crashed."""
    return row_of(payload, run, {"status": "crashed", "reason": lost.reason, "ok": False})


def manifest(payload: Payload) -> dict[str, Any]:
    """Content of `study.json`: all data that determine the rows, and the columns of the rows."""
    study = payload.study
    left = ("scenario", "plugins")
    return {
        "generator": f"asrsim {__version__}",
        "format": 4,
        "scenario": str(study.scenario.absolute()),
        "plugins": [str(path.absolute()) for path in study.plugins],
        "study": {field.name: getattr(study, field.name) for field in fields(study) if field.name not in left},
        "inputs": _input_hashes(payload),
        "versions": numeric_versions(),
        "runs": len(study),
        "blocks": SAMPLERS.get(study.sampler).blocks,
        "columns": payload.columns,
        "claims": {name: case.claims for name, case in payload.cases.items()},
        "substeps": {name: dict(case.substeps) for name, case in payload.cases.items()},
    }


def _input_hashes(payload: Payload) -> dict[str, dict[str, str]]:
    """Hashes of all input files of the study, by variant and by input."""
    plugins = payload.study.plugins
    return {name: input_hashes(case.scenario({}), case.robot, plugins=plugins) for name, case in payload.cases.items()}


def run_again(table: Table, run: int, folder: Path, plugins: Sequence[Path | str] = ()) -> RunSummary:
    """Repeat a run of a study with a log and a summary in `folder`, and return the summary; plugins: files of users'
    actuators that may run. Raises InputError if the study has no row of this run.
    """
    study = replace(table.study, over={present_name(name): value for name, value in table.study.over.items()})
    check_named(study.plugins, plugins, file=table.folder)
    if run not in table["run"]:
        raise InputError(f"there is no row of run {run}", file=table.folder, code="no-run")
    variant, values = study.point(run)
    payload = make_payload(replace(study, variants=(variant,)))
    case = replace(payload.cases[variant], substeps=table.manifest["substeps"][variant])
    with owned(folder):
        plan = examine(case.scenario(case.plan.settings(values)), case.robot_of(values))
        executed = execute(plan, folder, overwrite=True)
        return write_summary(executed).summary
