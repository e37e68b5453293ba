"""Workers: apply a task to many items, in this process, in processes of this machine or on a cluster, with one interface."""

from __future__ import annotations

import os
import pickle
import threading
import time as clock
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, MutableMapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from asrsim.errors import SimulationError

DEATHS = 3
"""Number of crashes over a single item after which the item is given up."""
MOST = 500
"""Largest number of items per message to a worker."""

Task = Callable[[Any], Any]
"""Function of an item that can be pickled. A worker may keep its prepared data. Results depend neither on the worker nor
on the order. Two methods are optional: `close` is called at the end; `several` takes (number, item) pairs one by one and
yields (number, result) pairs in any order."""
Numbered = list[tuple[int, Any]]
"""(number of an item, result) pairs."""
Stop = Callable[[], bool]


class Lost:
    """Result of an item over which workers crashed repeatedly."""

    def __init__(self, reason: str) -> None:
        self.reason = reason


class Executor(ABC):
    """Executes tasks. A context manager: after it no worker is left."""

    def __enter__(self) -> Executor:
        return self

    @abstractmethod
    def __exit__(self, *_: object) -> None:
        """End the workers; unfinished work is dropped."""

    @abstractmethod
    def results(self, task: Task, items: Sequence[Any], *, stop: Stop | None = None) -> Iterator[Numbered]:
        """Results in order of arrival, each item once; ends early if `stop` returns True.

        Raises the errors of the task, and SimulationError if there are no workers.
        """


class Here(Executor):
    """Executor that does the work in this process."""

    def __exit__(self, *_: object) -> None:
        pass

    def results(self, task: Task, items: Sequence[Any], *, stop: Stop | None = None) -> Iterator[Numbered]:
        """See `Executor`."""
        for done in _several(task, _until(enumerate(items), stop)):
            yield [done]
        _close(task)


class Pool(Executor):
    """Workers managed by a library. A worker receives a piece with several items and returns its results together."""

    died: tuple[type[Exception], ...] = ()
    """Exceptions that mean: the worker of a piece crashed."""
    again: tuple[type[Exception], ...] = ()
    """Exceptions that mean: the piece must be done again."""

    def __init__(self, plugins: Iterable[Path]) -> None:
        """plugins: files with users' actuators, which workers load first."""
        self._plugins = tuple(path.absolute() for path in plugins)

    @abstractmethod
    def slots(self, sent: bytes) -> int:
        """Number of pieces of this task that may be in progress; 0: there is no worker at the moment."""

    @abstractmethod
    def submit(self, sent: bytes, items: Numbered) -> Any:
        """Future result of `do_items`."""

    @abstractmethod
    def abandon(self, futures: Sequence[Any]) -> None:
        """Drop these futures."""

    def renew(self) -> None:
        """Send the task again, because workers may have lost it."""

    def results(self, task: Task, items: Sequence[Any], *, stop: Stop | None = None) -> Iterator[Numbered]:
        """See `Executor`. A piece whose worker crashed is repeated item by item, and halved after a further crash, to find the
        item that crashes its worker."""
        try:
            sent = pickle.dumps((self._plugins, pickle.dumps(task)))
        except Exception as error:
            message = f"the work cannot be sent to other processes: {type(error).__name__}: {error}"
            raise SimulationError(message) from error
        waiting = deque(range(len(items)))
        suspects: deque[list[int]] = deque()
        deaths = Counter[int]()
        pieces: dict[Any, list[int]] = {}
        try:
            while (waiting or suspects or pieces) and not (stop is not None and stop()):
                slots = self.slots(sent)
                while (waiting or suspects) and len(pieces) < (min(slots, 1) if suspects else slots):
                    size = max(1, min(MOST, len(waiting) // (2 * slots)))
                    mine = suspects.popleft() if suspects else [waiting.popleft() for _ in range(size)]
                    pieces[self.submit(sent, [(number, items[number]) for number in mine])] = mine
                ended = [future for future in pieces if future.done()]
                if not ended:
                    clock.sleep(0.002)
                alone = len(pieces) == 1
                for future in ended:
                    mine = pieces.pop(future)
                    found: Numbered = []
                    try:
                        found = future.result()
                    except self.died as error:
                        half = len(mine) // 2
                        deaths.update(mine if alone and not half else ())
                        if deaths[mine[0]] < DEATHS:
                            suspects.extend([mine[:half], mine[half:]] if alone and half else [mine])
                            continue
                        found = [(mine[0], Lost(f"{DEATHS} workers died in this run: {error}"))]
                    except self.again:
                        self.renew()
                    done = {number for number, _ in found}
                    waiting.extendleft(number for number in reversed(mine) if number not in done)
                    if found:
                        yield found
        finally:
            self.abandon(list(pieces))


def executor(processes: int, plugins: Sequence[Path] = ()) -> Executor:
    """Executor with so many processes of this machine, which load `plugins` first; 1: this process. Results are equal."""
    if processes <= 1:
        return Here()
    from asrsim.workers.local import Processes

    return Processes(processes, plugins)


def in_order(workers: Executor, task: Task, items: Sequence[Any]) -> list[Any]:
    """Results of all items, in their order. Raises SimulationError for a lost item, and the errors of the task."""
    found = dict(pair for some in workers.results(task, items) for pair in some)
    for result in found.values():
        if isinstance(result, Lost):
            raise SimulationError(result.reason)
    return [found[number] for number in range(len(items))]


def use_one_thread(environment: MutableMapping[str, str]) -> None:
    """Limit NumPy to one thread; call before NumPy is imported. More threads slow down a robot's small matrices (80 joints:
    2.4 times) and compete with other processes for the cores."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        environment.setdefault(name, "1")


def one_thread() -> AbstractContextManager[object]:
    """Context that limits a loaded NumPy to one thread, for example in a script: a fit then takes a third of the processor
    time.
    """
    try:
        from threadpoolctl import threadpool_limits
    except ImportError:
        # threadpoolctl is missing in installations older than the requirement: the run is only slower.
        return nullcontext()
    # SciPy has a BLAS library of its own, whose threads can be limited only after it is loaded.
    import_module("scipy.linalg")
    limits: AbstractContextManager[object] = threadpool_limits(1)
    return limits


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def do_items(sent: bytes, items: Numbered, seconds: float) -> Numbered:
    """Results, in a worker, of the items begun within `seconds`, at least of the first item. The worker keeps the task for
    its next piece."""
    if getattr(_OWN, "sent", b"") != sent:
        _close(getattr(_OWN, "task", None))
        plugins, task = pickle.loads(sent)
        for plugin in plugins:
            _load(plugin)
        _OWN.task, _OWN.sent = pickle.loads(task), sent
    end = clock.monotonic() + seconds
    (first, *others) = items
    return list(_several(_OWN.task, _until(others, lambda: clock.monotonic() > end, first)))


_OWN = threading.local()


@cache
def _load(plugin: Path) -> None:
    from asrsim.actuators.user import load_plugin_file

    load_plugin_file(plugin)


def _until(pairs: Iterable[tuple[int, Any]], stop: Stop | None, *first: tuple[int, Any]) -> Iterator[tuple[int, Any]]:
    """`first`, then the pairs until `stop` returns True."""
    yield from first
    for pair in pairs:
        if stop is not None and stop():
            return
        yield pair


def _several(task: Task, pairs: Iterable[tuple[int, Any]]) -> Iterator[tuple[int, Any]]:
    if hasattr(task, "several"):
        return iter(task.several(pairs))
    return ((number, task(item)) for number, item in pairs)


def _close(task: Task | None) -> None:
    release = getattr(task, "close", None)
    if release is not None:
        release()
