"""Dask: tasks on the workers of a scheduler, which tries again what a dead worker had; results stream back."""

from __future__ import annotations

import pickle
import sys
import threading
import time as clock
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from asrsim.errors import AsrsimError, InputError, SimulationError, listed
from asrsim.extras import library
from asrsim.versions import numeric_versions
from asrsim.workers import DEATHS, Lost, Pace, Task, close, pickled, several

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


class Cluster:
    """The workers of a Dask scheduler: an :class:`asrsim.workers.Executor`."""

    def __init__(self, target: str | Path, plugins: Sequence[Path] = ()) -> None:
        """target: address of a scheduler, or a YAML file for dask-jobqueue; plugins: sent along, and loaded first.

        Raises SimulationError, OSError, or InputError without Dask.
        """
        distributed = library("distributed", "cluster")
        self._target = str(target)
        self._plugins = tuple((path.name, path.read_bytes()) for path in plugins)
        self._distributed = distributed
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

    def _scatter(self, sent: bytes) -> Any:
        return self._client.scatter(sent, broadcast=True, hash=False)

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

    def results(
        self, task: Task, items: Sequence[Any], *, stop: Callable[[], bool] | None = None
    ) -> Iterator[list[tuple[int, Any]]]:
        """See :class:`asrsim.workers.Executor`; a piece whose workers die is cut into single items."""
        waiting, alone, pace = deque(range(len(items))), set[int](), Pace(PIECE)
        sent = pickle.dumps((self._plugins, pickled(task)))
        data: Any = self._scatter(sent)
        pieces: dict[Any, tuple[list[int], Any]] = {}
        done = self._distributed.as_completed(loop=self._client.loop)

        try:
            while True:
                threads = sum(self._client.nthreads().values())
                if data is None and threads:
                    with suppress(OSError):
                        data = self._scatter(sent)
                slots, pace.wanted = AHEAD * max(1, threads), max(PIECE, SHARE * threads)
                while data is not None and waiting and len(pieces) < slots:
                    size = 1 if waiting[0] in alone else pace.size(len(waiting), 2 * slots)
                    numbers = [waiting.popleft() for _ in range(size)]
                    future = self._client.submit(do_items, data, [(n, items[n]) for n in numbers], pure=False, retries=0)
                    pieces[future] = numbers, data
                    done.add(future)
                if not (pieces or waiting) or (stop is not None and stop()):
                    return
                if not done.has_ready():
                    threading.Event().wait(0.02)
                    continue
                future = next(done)
                mine, given = pieces.pop(future)
                try:
                    found, seconds = future.result()
                except self._distributed.KilledWorker:
                    if len(mine) == 1:
                        yield [(mine[0], Lost(f"{DEATHS} workers died in this run"))]
                    else:
                        waiting.extendleft(reversed(mine))
                        alone.update(mine)
                except CancelledError:
                    # Lost with the scheduler's memory of it, or with all the workers that had it or the task: done again.
                    waiting.extendleft(reversed(mine))
                    data = None if given is data else data
                except AsrsimError:
                    raise
                except Exception as fault:
                    raise SimulationError(f"a worker failed: {fault}") from fault
                else:
                    pace.took(seconds, len(found))
                    future.release()
                    yield found
        except OSError as error:
            message = f"the scheduler at {self._target} has gone; what has come is kept, go on by --resume"
            raise SimulationError(message) from error
        finally:
            with suppress(Exception):
                self._client.cancel(list(pieces))


_OWN = threading.local()
_LOADED: dict[tuple[str, bytes], TemporaryDirectory[str]] = {}


def do_items(sent: bytes, items: list[tuple[int, Any]]) -> tuple[list[tuple[int, Any]], float]:
    """On a worker: results of items, and the seconds they took; what the task made ready is kept for its next piece."""
    if getattr(_OWN, "sent", b"") != sent:
        close(getattr(_OWN, "task", None))
        plugins, task = pickle.loads(sent)
        for plugin in plugins:
            _load(plugin)
        _OWN.task, _OWN.sent = pickle.loads(task), sent
    began = clock.perf_counter()
    return list(several(_OWN.task, items)), clock.perf_counter() - began


def _load(plugin: tuple[str, bytes]) -> None:
    """A file with users' actuators, once a process."""
    from asrsim.actuators.user import load_plugin_file

    if plugin not in _LOADED:
        folder = TemporaryDirectory(prefix="asrsim-plugin-")
        place = Path(folder.name) / plugin[0]
        place.write_bytes(plugin[1])
        load_plugin_file(place)
        _LOADED[plugin] = folder


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
