"""Dask: a study on the workers of a scheduler, which tries again what a dead worker had; rows stream back."""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from asrsim.errors import InputError, Problem, SimulationError
from asrsim.samples import Array
from asrsim.sweeps.cases import Payload
from asrsim.sweeps.executor import DEATHS, pickled
from asrsim.sweeps.runner import Row, Runner, lost

PATIENCE = 10.0
"""s that a scheduler, and the first worker, have to answer."""
CHUNK_SECONDS = 2.0
MOST = 500
"""Runs of a task: the scheduler takes some milliseconds for each."""
AHEAD = 3
"""Tasks a worker thread, done or waiting: bounds the memory of scheduler and client."""
COMPARED = ("python", "asrsim", "numpy", "mujoco-core", "pybullet")
"""What must be the same everywhere, so that rows are."""
JOBS = ("slurm", "pbs", "sge", "lsf", "htcondor", "oar", "moab", "local")


class Cluster:
    """Runs a study on Dask workers; a context."""

    def __init__(self, payload: Payload, target: str | Path) -> None:
        """target: address of a scheduler, or a YAML file for dask-jobqueue. Raises SimulationError or InputError."""
        try:
            distributed: Any = import_module("distributed")
        except ImportError:
            raise SimulationError("--cluster needs Dask: pip install 'asrsim[cluster]'") from None
        if payload.study.logs:
            raise SimulationError(
                "logs of every run are not gathered from a cluster: leave --logs away, and repeat runs by --run"
            )
        self._payload, self._target = payload, str(target)
        self._distributed = distributed
        self._sent = pickled(shipped(payload))
        self._jobs: Any = None
        self._client: Any = None

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
        from asrsim.sweeps.run import versions

        mine = versions()
        try:
            theirs = self._client.run(_versions)
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
            more = f" and {len(faults) - 5} more" if len(faults) > 5 else ""
            raise SimulationError("rows would differ between machines: " + "; ".join(faults[:5]) + more)

    def rows(self, runs: Sequence[int] | Array, *, stop: Callable[[], bool] | None = None) -> Iterator[list[Row]]:
        """Rows as tasks end; a task whose workers die is cut into single runs, and what still kills them is a row."""
        waiting = deque(int(run) for run in runs)
        data = self._client.scatter(self._sent, broadcast=True, hash=True)
        seconds = 0.05
        chunks: dict[Any, list[int]] = {}
        done = self._distributed.as_completed(loop=self._client.loop)
        try:
            while True:
                slots = AHEAD * max(1, sum(self._client.nthreads().values()))
                while waiting and len(chunks) < slots:
                    share = max(1, len(waiting) // (2 * slots))
                    size = min(MOST, share, max(1, round(CHUNK_SECONDS / seconds)), len(waiting))
                    self._submit(data, [waiting.popleft() for _ in range(size)], chunks, done)
                if not chunks or (stop is not None and stop()):
                    return
                if not done.has_ready():
                    threading.Event().wait(0.02)
                    continue
                future = next(done)
                mine = chunks.pop(future)
                if future.status == "finished":
                    rows = future.result()
                    seconds = 0.7 * seconds + 0.3 * max(1e-4, sum(row[-1] or 0.0 for row in rows) / len(rows))
                    future.release()
                    yield rows
                elif future.status == "error" and isinstance(future.exception(), self._distributed.KilledWorker):
                    if len(mine) == 1:
                        yield [lost(self._payload, mine[0], f"{DEATHS} workers died in this run")]
                    for run in mine if len(mine) > 1 else ():
                        self._submit(data, [run], chunks, done)
                elif future.status == "error":
                    raise SimulationError(f"a worker failed: {future.exception()}")
                else:
                    # Lost with the scheduler's memory of it: done again.
                    waiting.extendleft(reversed(mine))
        finally:
            with suppress(Exception):
                self._client.cancel(list(chunks))

    def _submit(self, data: Any, runs: list[int], chunks: dict[Any, list[int]], done: Any) -> None:
        future = self._client.submit(do_runs, data, runs, pure=False, retries=0)
        chunks[future] = runs
        done.add(future)


def _versions() -> dict[str, str]:
    """On a worker."""
    from asrsim.sweeps.run import versions

    return versions()


_OWN = threading.local()


def do_runs(payload: bytes, runs: list[int]) -> list[Row]:
    """On a worker: rows of runs; what is prepared is kept for the next task of the study."""
    import pickle

    if getattr(_OWN, "bytes", b"") != payload:
        if getattr(_OWN, "runner", None) is not None:
            _OWN.runner.close()
        unpacked = unpacked_payload(pickle.loads(payload))
        _OWN.runner = Runner(unpacked, share=8)
        _OWN.bytes = payload
    return [_OWN.runner.row(run) for run in runs]


class Shipped:
    """A payload with its files, for machines that have none of them."""

    def __init__(self, payload: Payload, files: dict[str, bytes]) -> None:
        self.payload, self.files = payload, files


def shipped(payload: Payload) -> Shipped:
    """With the bytes of attachments and plugins; the robot itself is data already. Raises OSError where one cannot be read."""
    paths = {path for case in payload.cases.values() for path in case.files.values()}
    paths |= set(payload.study.plugins)
    return Shipped(payload, {str(path): path.read_bytes() for path in sorted(paths)})


def unpacked_payload(shipped: Shipped) -> Payload:
    """The payload on a worker, its files written to a folder that lives as long as the process."""
    import tempfile

    payload = shipped.payload
    folder = tempfile.TemporaryDirectory(prefix="asrsim-sweep-")
    _OWN.folder = folder
    places: dict[Path, Path] = {}
    for number, (name, data) in enumerate(shipped.files.items()):
        place = Path(folder.name) / str(number) / Path(name).name
        place.parent.mkdir()
        place.write_bytes(data)
        places[Path(name)] = place
    if payload.study.plugins:
        from asrsim.actuators.user import load_plugin_file

        for plugin in payload.study.plugins:
            if plugin not in _LOADED:
                load_plugin_file(places[plugin])
                _LOADED.add(plugin)
    cases = {
        name: replace(case, files={key: places[path] for key, path in case.files.items()})
        for name, case in payload.cases.items()
    }
    return replace(payload, cases=cases)


_LOADED: set[Path] = set()


def _job_queue(path: Path) -> Any:
    """A cluster of dask-jobqueue from a file: `slurm: {jobs: 10, cores: 8, memory: 16GB, ...}`. Raises InputError."""
    from asrsim.document.yaml_reader import read_yaml

    data = read_yaml(path)[0].plain()

    def wrong(message: str, choices: tuple[str, ...] = ()) -> InputError:
        hint = "Write for example slurm: {jobs: 10, cores: 8, memory: 16GB, walltime: '02:00:00'}"
        return InputError(Problem(message=message, file=path, choices=choices, hint=hint, code="cluster"))

    if not isinstance(data, dict) or len(data) != 1 or next(iter(data)) not in JOBS:
        raise wrong("must name one system of jobs", JOBS)
    kind, options = next(iter(data.items()))
    if not isinstance(options, dict):
        raise wrong("the system's options must be a mapping")
    try:
        import dask_jobqueue
    except ImportError:
        raise SimulationError("a file for --cluster needs dask-jobqueue: pip install 'asrsim[cluster]'") from None
    names = {name.lower().removesuffix("cluster"): name for name in dir(dask_jobqueue) if name.endswith("Cluster")}
    make: Any
    if kind == "local":
        from dask_jobqueue.local import LocalCluster

        make = LocalCluster
    elif kind in names:
        make = getattr(dask_jobqueue, names[kind])
    else:
        raise wrong(f"dask-jobqueue has no '{kind}'", tuple(names))
    options = {"python": sys.executable, **options}
    jobs = options.pop("jobs", 1)
    try:
        made = make(**options)
        made.scale(jobs=jobs)
    except Exception as error:
        raise wrong(f"cannot begin the jobs: {type(error).__name__}: {error}") from None
    return made
