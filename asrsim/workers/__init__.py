"""Workers: apply a task to many items, in processes of this machine or on a cluster, with one interface."""

from __future__ import annotations

import math
import os
import pickle
import threading
import time as clock
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, MutableMapping, Sequence
from contextlib import AbstractContextManager
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Self

from asrsim.errors import SimulationError
from asrsim.progress import Stop

DEATHS = 3
"""Number of worker crashes in computations of a single item, after which this item counts as lost."""
MOST = 500
"""Largest number of items in a piece of work."""
GRACE = 10.0
"""Time in which pieces in progress may end after `stop` has returned True, s."""
GROWTH = 4
"""Largest factor by which the number of items grows from one piece to the next."""

Work = Callable[[Any], Any]
"""Task: a function that returns the result of one item, and that can be pickled. It may keep prepared data in a worker. A
result must depend neither on the worker nor on the order of the items. The task may have two methods: `close`, which is called
before a worker drops the task, and `several`, which returns the results of a list of items."""
Numbered = list[tuple[int, Any]]
"""Pairs of the index of an item and the result for this item."""


class Lost:
    """Result of an item that crashed its worker repeatedly."""

    def __init__(self, reason: str) -> None:
        self.reason = reason


class Pool(ABC):
    """Workers that a library manages. A pool is a context manager, which ends all workers on exit. A worker receives a piece of
    work, which contains several items, and returns the results of all items together.
    """

    died: tuple[type[Exception], ...] = ()
    """Exceptions that the library raises if the worker of a piece has crashed."""
    again: tuple[type[Exception], ...] = ()
    """Exceptions that the library raises if a piece is lost without a fault of its items and must be submitted again."""
    piece = 0.5
    """Intended duration of a piece of work, s. Longer pieces need fewer messages; shorter pieces keep workers busy at the
    end."""

    def __init__(self, plugins: Iterable[Path]) -> None:
        """plugins: files with users' actuators, which workers load first."""
        self._plugins = tuple(path.absolute() for path in plugins)

    def __enter__(self) -> Self:
        return self

    @abstractmethod
    def __exit__(self, *_: object) -> None:
        """End the workers; unfinished work is dropped."""

    @abstractmethod
    def slots(self, sent: bytes) -> int:
        """Number of pieces that may be in progress at once; 0: there is no worker at the moment. sent: the pickled task."""

    @abstractmethod
    def submit(self, sent: bytes, items: Sequence[Any]) -> Any:
        """Let a worker call `do_items` with a piece of work, and return the future of this call. sent: the pickled task."""

    @abstractmethod
    def abandon(self, futures: Sequence[Any]) -> None:
        """Cancel the pieces of work that these futures stand for."""

    def renew(self) -> None:  # noqa: B027 - not all workers lose tasks
        """Send the task again before the next piece, because workers may have lost the task."""

    def results(self, task: Work, items: Sequence[Any], *, stop: Stop | None = None) -> Iterator[Numbered]:
        """Results in the order in which they arrive, each item once. If `stop` returns True, the pieces in progress have
        `GRACE` seconds to end. Raises the task's errors, and SimulationError if there are no workers or the task cannot be
        pickled.

        The number of items in a piece follows from the computing time of an earlier piece. To find the item that crashes its
        worker, a piece whose worker has crashed is computed alone; after each further crash it is halved.
        """
        try:
            sent = pickle.dumps((self._plugins, pickle.dumps(task)))
        except Exception as error:
            message = f"the work cannot be sent to other processes: {type(error).__name__}: {error}"
            raise SimulationError(message) from error
        waiting = deque(range(len(items)))
        suspects: deque[list[int]] = deque()
        deaths = Counter[int]()
        pieces: dict[Any, list[int]] = {}
        size, end = 1, math.inf
        try:
            while (waiting or suspects or pieces) and clock.monotonic() < end:
                if end == math.inf and stop is not None and stop():
                    waiting.clear()
                    suspects.clear()
                    end = clock.monotonic() + GRACE
                slots = self.slots(sent)
                while (waiting or suspects) and len(pieces) < (min(slots, 1) if suspects else slots):
                    count = max(1, min(size, len(waiting) // (2 * slots)))
                    mine = suspects.popleft() if suspects else [waiting.popleft() for _ in range(count)]
                    pieces[self.submit(sent, [items[number] for number in mine])] = mine
                ended = [future for future in pieces if future.done()]
                if not ended:
                    clock.sleep(0.002)
                alone = len(pieces) == 1
                for future in ended:
                    mine = pieces.pop(future)
                    try:
                        found, seconds = future.result()
                    except self.died as error:
                        half = len(mine) // 2
                        deaths.update(mine if alone and not half else ())
                        if deaths[mine[0]] < DEATHS:
                            suspects.extend([mine[:half], mine[half:]] if alone and half else [mine])
                        else:
                            yield [(mine[0], Lost(f"{DEATHS} workers died in this run: {error}"))]
                    except self.again:
                        self.renew()
                        waiting.extendleft(reversed(mine))
                    else:
                        wanted = self.piece * len(mine) / max(seconds, 1e-9)
                        size = int(max(1, min(wanted, GROWTH * len(mine), MOST)))
                        yield list(zip(mine, found, strict=True))
        finally:
            self.abandon(list(pieces))


def use_one_thread(environment: MutableMapping[str, str]) -> None:
    """Set environment variables that limit NumPy to one thread; call it before NumPy is imported. More threads slow down
    operations on small matrices (2.4 times for 80 joints), and compete with other processes for the cores.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        environment.setdefault(name, "1")


def one_thread() -> AbstractContextManager[object]:
    """Context manager that limits NumPy to one thread after NumPy was imported, for example in a script. A fit then takes a
    third of the processor time that it takes with a thread on every core.
    """
    from threadpoolctl import threadpool_limits

    # Import SciPy's linear algebra first. SciPy has a separate BLAS library, whose threads can be limited only after it is
    # loaded.
    import_module("scipy.linalg")
    limits: AbstractContextManager[object] = threadpool_limits(1)
    return limits


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def do_items(sent: bytes, items: Sequence[Any]) -> tuple[list[Any], float]:
    """Compute the results of a piece of work in this worker; returns the results and the computing time, s. The worker keeps
    the task for its next piece. sent: the pickled task.
    """
    if getattr(_OWN, "sent", b"") != sent:
        _close(getattr(_OWN, "task", None))
        plugins, task = pickle.loads(sent)
        for plugin in plugins:
            _load(plugin)
        _OWN.task, _OWN.sent = pickle.loads(task), sent
    began, task = clock.perf_counter(), _OWN.task
    found = task.several(items) if hasattr(task, "several") else [task(item) for item in items]
    return found, clock.perf_counter() - began


_OWN = threading.local()
"""Task of this worker's thread, and the bytes from which the task was unpickled."""


@cache
def _load(plugin: Path) -> None:
    from asrsim.plugins import load_plugin_file

    load_plugin_file(plugin)


def _close(task: Work | None) -> None:
    release = getattr(task, "close", None)
    if release is not None:
        release()
