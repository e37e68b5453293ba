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
"""Number of worker crashes caused by a single item after which the item is counted as lost."""
MOST = 500
"""Largest number of items in a piece of work."""
GRACE = 10.0
"""Time after `stop` in which pieces in progress may end, s."""
GROWTH = 4
"""Largest ratio of the numbers of items in successive pieces."""

Work = Callable[[Any], Any]
"""Function of an item that can be pickled. The task may keep prepared data in a worker. Results depend neither on the worker
nor on the order. Two methods are optional: `close` is called at the end; `several` returns the results of a list of items."""
Numbered = list[tuple[int, Any]]
"""Pairs of the index of an item and the result for this item."""


class Lost:
    """Result of an item that crashed its worker repeatedly."""

    def __init__(self, reason: str) -> None:
        self.reason = reason


class Pool(ABC):
    """Workers managed by a library; a context manager that ends all workers on exit. A worker receives a piece with several
    items and returns its results together.
    """

    died: tuple[type[Exception], ...] = ()
    """Exceptions that are raised if the worker of a piece crashed."""
    again: tuple[type[Exception], ...] = ()
    """Exceptions after which the piece must be submitted again."""
    piece = 0.5
    """Duration of a piece of work, s: longer pieces save messages, shorter pieces keep all workers busy at the end."""

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
        """Number of pieces of this task that may be in progress; 0: there is no worker at the moment."""

    @abstractmethod
    def submit(self, sent: bytes, items: Sequence[Any]) -> Any:
        """Submit a piece of work to a worker, and return the future of `do_items`."""

    @abstractmethod
    def abandon(self, futures: Sequence[Any]) -> None:
        """Cancel the pieces of work that these futures stand for."""

    def renew(self) -> None:  # noqa: B027 - not all workers lose tasks
        """Send the task again, because workers may have lost it."""

    def results(self, task: Work, items: Sequence[Any], *, stop: Stop | None = None) -> Iterator[Numbered]:
        """Results in order of arrival, each item once; ends early if `stop` returns True, when the pieces in progress have
        `GRACE` seconds to end. The task can be pickled. Raises its errors, and SimulationError if there are no workers.

        The size of a piece follows from the duration of the previous piece. To find the item that crashes its worker, a piece
        whose worker crashed is repeated, and halved after a further crash.
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
    """Limit NumPy to one thread; call before NumPy is imported. More threads slow down operations on small matrices (80 joints:
    2.4 times) and compete with other processes for the cores.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        environment.setdefault(name, "1")


def one_thread() -> AbstractContextManager[object]:
    """Context manager that limits a loaded NumPy to one thread, for example in a script: a fit then takes a third of the
    processor time.
    """
    from threadpoolctl import threadpool_limits

    # SciPy has a BLAS library of its own, whose threads can be limited only after it is loaded.
    import_module("scipy.linalg")
    limits: AbstractContextManager[object] = threadpool_limits(1)
    return limits


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def do_items(sent: bytes, items: Sequence[Any]) -> tuple[list[Any], float]:
    """Compute the results of items in a worker; returns the results and the computing time, s. The worker keeps the task for
    its next piece.
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
