"""A study from beginning to end: read, shared out among workers, rows kept, put together."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from asrsim.errors import Problem, SimulationError
from asrsim.extras import library
from asrsim.runs.lock import owned
from asrsim.sweeps.cases import Case, Payload, make_payload
from asrsim.sweeps.read import is_study, make_study, read_study
from asrsim.sweeps.rows import lost
from asrsim.sweeps.runner import Runner
from asrsim.sweeps.shipping import Shipped
from asrsim.sweeps.store import Store, open_store
from asrsim.sweeps.study import Study
from asrsim.sweeps.table import Table
from asrsim.sweeps.units import units_of
from asrsim.versions import numeric_versions
from asrsim.workers import Executor, Here, Lost, Task, cores
from asrsim.workers.local import Processes


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a study is."""

    done: int
    total: int
    elapsed: float
    """s of this session."""
    here: int
    """Runs of this session."""
    statuses: Mapping[str, int]
    """Of this session's rows."""

    @property
    def rate(self) -> float:
        """Runs a second."""
        return self.here / self.elapsed if self.elapsed > 0.0 else 0.0

    @property
    def remaining(self) -> float:
        """s."""
        return (self.total - self.done) / self.rate if self.rate else math.inf


def sweep(
    scenario: str | Path | Study,
    over: Mapping[str, Any] | Sequence[str] = (),
    *,
    workers: int | None = None,
    cluster: str | Path | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    overwrite: bool = False,
    progress: Callable[[Progress], None] | None = None,
    stop: Callable[[], bool] | None = None,
    **options: Any,
) -> Table:
    """Run a study: everything that `asrsim sweep` does but the pictures.

        table = asrsim.sweep("arm.yaml", {"parameters.*.spring_stiffness": "10:200:20"}, workers=2)
        table.to_pandas()

    Args:
        scenario: Scenario file, or a study: a file with the key `scenario`, or one made by :func:`make_study`.
        over: Key -> list, range as text, or distribution; see docs/sweep.md.
        workers: Processes; None: one a core.
        cluster: Address of a Dask scheduler, or a file for dask-jobqueue, in place of processes here.
        out: Folder for the rows; None: a temporary one, which goes with the table.
        resume: Go on with what is in `out`; overwrite: begin anew.
        progress: Told as rows come. stop: asked; True ends the study with the rows that there are.
        options: Of a study: variants, overrides, design, samples, seed, fit, signals, rate, plugins.

    Raises:
        InputError: Nothing of the study can run: unknown keys, values out of range; or `out` holds another study.
        SimulationError: Workers cannot start, or the cluster cannot be used.
        OutputError: Rows cannot be written; those before are kept.
    """
    library("pyarrow", "sweep")  # told before the study is prepared, which takes seconds
    study = _study(scenario, over, options)
    payload = make_payload(study)
    temporary = None
    if out is None:
        from tempfile import TemporaryDirectory

        temporary = TemporaryDirectory(prefix="asrsim-sweep-")
        out = temporary.name
    folder = Path(out)
    with owned(folder):
        study = payload.study
        store = open_store(folder, payload.columns, len(study), manifest(payload), resume=resume, overwrite=overwrite)
        _run(payload, store, *executor_of(payload, store, workers, cluster), progress, stop)
    return Table(folder, keep=temporary, checked=True)


def _study(scenario: str | Path | Study, over: Any, options: Mapping[str, Any]) -> Study:
    if isinstance(scenario, Study):
        study = scenario
    elif is_study(Path(scenario)):
        options = dict(options)
        study = read_study(Path(scenario), options.pop("plugins", ()))
    else:
        return make_study(scenario, over, **options)
    if over or options:
        names = ", ".join(["over"] if over else [*options])
        raise SimulationError(f"a study says itself what is varied: {names} goes with a scenario only")
    return study


def executor_of(payload: Payload, store: Store, workers: int | None, cluster: str | Path | None) -> tuple[Executor, Task]:
    """Where the missing runs are done, and by what. Raises SimulationError."""
    if workers is not None and workers < 1:
        raise SimulationError(str(Problem("must be at least 1", key="workers", value=workers)))
    if not len(store.missing):
        return Here(), Runner(payload)
    plugins = payload.study.plugins
    if cluster is None:
        count = workers or cores()
        # Even one: runs that kill their process are rows, too.
        return Processes(count, plugins), Runner(payload, count)
    from asrsim.workers.cluster import Cluster

    return Cluster(cluster, plugins), Shipped(payload, share=8)


def _run(
    payload: Payload,
    store: Store,
    workers: Executor,
    task: Task,
    progress: Callable[[Progress], None] | None,
    stop: Callable[[], bool] | None,
) -> None:
    began, here, statuses = clock.monotonic(), 0, dict.fromkeys(("complete", "diverged", "failed", "crashed"), 0)
    status, missing = payload.names.index("status"), store.missing.tolist()
    try:
        with workers:
            for found in workers.results(task, missing, stop=stop):
                new = store.add([lost(payload, missing[n], row.reason) if isinstance(row, Lost) else row for n, row in found])
                here += len(new)
                for row in new:
                    statuses[row[status]] = statuses.get(row[status], 0) + 1
                if progress is not None:
                    done = int(store.done.sum())
                    elapsed = clock.monotonic() - began
                    progress(Progress(done=done, total=store.total, elapsed=elapsed, here=here, statuses=statuses))
    finally:
        # Whatever ended it, rows that have come are kept.
        store.finish()


def manifest(payload: Payload) -> dict[str, Any]:
    """What `study.json` says: what the rows follow from, and what their columns are."""
    from asrsim import __version__

    study = payload.study
    return {
        "generator": f"asrsim {__version__}",
        "format": 1,
        "scenario": str((study.scenario or Path()).absolute()),
        "name": study.name,
        "digest": study.digest,
        "inputs": inputs_digest(payload),
        "versions": numeric_versions(),
        "runs": len(study),
        "variants": list(study.variants),
        "keys": list(study.keys),
        "design": study.design if study.dimensions else "grid",
        "samples": study.samples,
        "seed": study.seed,
        "grid": list(study.grid),
        "listed": [list(axis.keys) for axis in study.listed],
        "drawn": [list(group) for group in study.groups],
        "overrides": list(study.overrides),
        "plugins": [str(path.absolute()) for path in study.plugins],
        "columns": [list(column) for column in payload.columns],
        "units": units_of(payload),
        "joints": list(dict.fromkeys(joint for case in payload.cases.values() for joint in case.joints)),
        "claims": {name: list(case.claims) for name, case in payload.cases.items()},
        "substeps": {name: dict(case.substeps) for name, case in payload.cases.items()},
        "rate": study.rate,
    }


def inputs_digest(payload: Payload) -> str:
    """Of scenarios, robots and the files that they name: what rows follow from, besides the study."""
    digest = sha256()
    for case in payload.cases.values():
        for part in (repr(case.resolved).encode(), case.robot.text.encode(), *_files(case)):
            digest.update(part)
    for plugin in payload.study.plugins:
        digest.update(plugin.read_bytes())
    return digest.hexdigest()[:16]


def _files(case: Case) -> Iterator[bytes]:
    for name in sorted(case.files):
        yield case.files[name].read_bytes()
