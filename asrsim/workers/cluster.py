"""Dask: tasks on the workers of a scheduler, which tries again what a dead worker had; results stream back."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from typing import Any

from asrsim.errors import InputError, SimulationError, listed
from asrsim.extras import library
from asrsim.versions import numeric_versions
from asrsim.workers import Pool, Task, do_items

PATIENCE = 10.0
"""s that a scheduler, and the first worker, have to answer."""
PIECE, SHARE = 2.0, 0.01
"""s of work of a task of Dask's, at least, and for each thread: scheduler and client take some 4 ms for every task, and are to
have time to spare with a thousand threads, too."""
AHEAD = 3
"""Tasks a worker thread, done or waiting: bounds the memory of scheduler and client."""
COMPARED = ("python", "asrsim", "numpy", "mujoco", "pybullet")
"""What must be the same everywhere, so that results are."""
JOBS = ("slurm", "pbs", "sge", "lsf", "htcondor", "oar", "moab", "local")


class Cluster(Pool):
    """The workers of a Dask scheduler."""

    again = (CancelledError,)

    def __init__(self, target: str | Path, plugins: Sequence[Path] = ()) -> None:
        """target: address of a scheduler, or a YAML file for dask-jobqueue; plugins: sent along, and loaded first.

        Raises SimulationError, OSError, or InputError without Dask.
        """
        distributed = library("distributed", "cluster")
        super().__init__((path.name, path.read_bytes()) for path in plugins)
        self.died = (distributed.KilledWorker,)
        self._target = str(target)
        self._distributed = distributed
        self._jobs: Any = None
        self._client: Any = None
        self._data: Any = None

    def __enter__(self) -> Cluster:
        try:
            self._connect()
            self._compare()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for one in (self._client, self._jobs):
            if one is not None:
                with suppress(Exception):
                    one.close()
        self._client = self._jobs = None

    def _connect(self) -> None:
        address: Any = self._target
        if "://" not in self._target:
            self._jobs = address = _job_queue(Path(self._target))
        try:
            self._client = self._distributed.Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            text = str(error) or type(error).__name__
            raise SimulationError(f"no scheduler answers at {self._target} within {PATIENCE:g} s: {text}") from error
        try:
            self._client.wait_for_workers(1, timeout=600.0 if self._jobs is not None else PATIENCE)
        except Exception as error:
            hint = f"start some: dask worker {self._target}"
            raise SimulationError(f"the scheduler at {self._target} has no workers: {hint}") from error

    def _compare(self) -> None:
        mine = numeric_versions()
        try:
            theirs = self._client.run(numeric_versions)
        except Exception as error:
            message = f"the workers cannot import asrsim of this version: {type(error).__name__}: {error}"
            raise SimulationError(message) from error
        faults = [
            f"worker {worker} has {name} {found.get(name)}, here it is {mine[name]}"
            for worker, found in sorted(theirs.items())
            for name in COMPARED
            if found.get(name) != mine[name]
        ]
        if faults:
            raise SimulationError(f"rows would differ between machines: {listed(faults, 5, '; ')}")

    def slots(self, sent: bytes) -> int:
        """See :class:`Pool`."""
        threads = sum(self._client.nthreads().values())
        self._seconds = max(PIECE, SHARE * threads)
        if self._data is None and threads:
            with suppress(OSError):
                self._data = self._client.scatter(sent, broadcast=True, hash=False)
        return 0 if self._data is None else AHEAD * threads

    def submit(self, sent: bytes, items: list[tuple[int, Any]]) -> Any:
        """See :class:`Pool`."""
        return self._client.submit(do_items, self._data, items, self._seconds, pure=False, retries=0)

    def abandon(self, futures: Sequence[Any]) -> None:
        """See :class:`Pool`."""
        with suppress(Exception):
            self._client.cancel(list(futures))

    def renew(self) -> None:
        """Pieces are cancelled where the scheduler forgot them, and where all workers are lost that had them or the task."""
        self._data = None

    def results(
        self, task: Task, items: Sequence[Any], *, stop: Callable[[], bool] | None = None
    ) -> Iterator[list[tuple[int, Any]]]:
        """See :class:`Pool`."""
        self._data = None
        try:
            yield from super().results(task, items, stop=stop)
        except OSError as error:
            message = f"the scheduler at {self._target} has gone; what has come is kept, go on by --resume"
            raise SimulationError(message) from error


def _job_queue(path: Path) -> Any:
    """A cluster of dask-jobqueue from a file: `slurm: {jobs: 10, cores: 8, memory: 16GB, ...}`. Raises InputError."""
    from asrsim.document.yaml_reader import read_yaml

    data = read_yaml(path)[0].plain()

    def wrong(message: str, choices: tuple[str, ...] = ()) -> InputError:
        hint = "Write for example slurm: {jobs: 10, cores: 8, memory: 16GB, walltime: '02:00:00'}"
        return InputError(message, file=path, choices=choices, hint=hint, code="cluster")

    if not isinstance(data, dict) or len(data) != 1 or next(iter(data)) not in JOBS:
        raise wrong("must name one system of jobs", JOBS)
    kind, options = next(iter(data.items()))
    if not isinstance(options, dict):
        raise wrong("the system's options must be a mapping")
    options = {"python": sys.executable, **options}
    jobs = options.pop("jobs", 1)
    if type(jobs) is not int or jobs < 1:
        raise wrong("'jobs' must be a whole number of at least 1")
    dask_jobqueue = library("dask_jobqueue", "cluster")
    names = {name.lower().removesuffix("cluster"): name for name in dir(dask_jobqueue) if name.endswith("Cluster")}
    make: Any
    if kind == "local":
        from dask_jobqueue.local import LocalCluster

        make = LocalCluster
    elif kind in names:
        make = getattr(dask_jobqueue, names[kind])
    else:
        raise wrong(f"dask-jobqueue has no '{kind}'", tuple(names))
    made: Any = None
    try:
        made = make(**options)
        # The first job by itself: what goes wrong with those of `scale` is only logged, and nobody comes.
        made.worker_spec.update(made.new_worker_spec())
        made.sync(made._correct_state)
        made.scale(jobs=jobs)
    except Exception as error:
        with suppress(Exception):
            made.close()
        raise wrong(f"cannot begin the jobs: {type(error).__name__}: {' '.join(str(error).split())}") from None
    return made
