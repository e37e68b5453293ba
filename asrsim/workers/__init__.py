"""Workers: one task done on many items, here, in processes of this machine or on a cluster, behind one small interface."""

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
"""Deaths of workers over one item, done by itself, after which the item is given up."""
MOST = 500
"""Items that a worker takes at a time."""

Task = Callable[[Any], Any]
"""A function of an item that can be pickled. It may keep in a worker what it makes ready. Results depend neither on the worker
nor on the order. Two methods are optional: `close` is called in the end; `several` takes (number, item) pairs one by one, and
gives (number, result) pairs in any order."""
Numbered = list[tuple[int, Any]]
"""(number of an item, result) pairs."""
Stop = Callable[[], bool]


class Lost:
    """The result of an item over which workers died again and again."""

    def __init__(self, reason: str) -> None:
        self.reason = reason


class Executor(ABC):
    """Does tasks somewhere. A context: at its end no worker is left."""

    def __enter__(self) -> Executor:
        return self

    @abstractmethod
    def __exit__(self, *_: object) -> None:
        """End the workers; work that is not done is dropped."""

    @abstractmethod
    def results(self, task: Task, items: Sequence[Any], *, stop: Stop | None = None) -> Iterator[Numbered]:
        """Results as they come, in any order, each once; ends early where `stop` returns True.

        Raises what the task raises, and SimulationError where there are no workers.
        """


class Here(Executor):
    """This process does the work."""

    def __exit__(self, *_: object) -> None:
        pass

    def results(self, task: Task, items: Sequence[Any], *, stop: Stop | None = None) -> Iterator[Numbered]:
        """See :class:`Executor`."""
        for done in _several(task, _until(enumerate(items), stop)):
            yield [done]
        _close(task)


class Pool(Executor):
    """Workers that a library keeps. They take pieces of several items, and return the results of a piece when it ends."""

    died: tuple[type[Exception], ...] = ()
    """Exceptions of a piece whose worker died."""
    again: tuple[type[Exception], ...] = ()
    """Exceptions of a piece that has to be done again."""

    def __init__(self, plugins: Iterable[Path]) -> None:
        """plugins: files with users' actuators, which workers load first."""
        self._plugins = tuple(path.absolute() for path in plugins)

    @abstractmethod
    def slots(self, sent: bytes) -> int:
        """Pieces of this task that may be out at a time; 0: there is no worker at the moment."""

    @abstractmethod
    def submit(self, sent: bytes, items: Numbered) -> Any:
        """A future of :func:`do_items`."""

    @abstractmethod
    def abandon(self, futures: Sequence[Any]) -> None:
        """Drop these futures."""

    def renew(self) -> None:
        """Send the task again: workers may have lost it."""

    def results(self, task: Task, items: Sequence[Any], *, stop: Stop | None = None) -> Iterator[Numbered]:
        """See :class:`Executor`. Pieces whose worker died are done again one by one, and halved where a worker dies again: so
        the item that kills its worker is found."""
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
    """So many processes of this machine, which load `plugins` first; 1: this process itself. Results are the same."""
    if processes <= 1:
        return Here()
    from asrsim.workers.local import Processes

    return Processes(processes, plugins)


def in_order(workers: Executor, task: Task, items: Sequence[Any]) -> list[Any]:
    """Results of all items, in their order. Raises SimulationError for a lost item, and what the task raises."""
    found = dict(pair for some in workers.results(task, items) for pair in some)
    for result in found.values():
        if isinstance(result, Lost):
            raise SimulationError(result.reason)
    return [found[number] for number in range(len(items))]


def use_one_thread(environment: MutableMapping[str, str]) -> None:
    """Set before NumPy is imported: its library's threads cost more than they save on a robot's small matrices (80 joints: a
    run takes 2.4 times as long), and compete for the cores of our other processes."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        environment.setdefault(name, "1")


def one_thread() -> AbstractContextManager[object]:
    """The same for a while, where NumPy is loaded already, as in a script: a fit takes a third of the processor's time."""
    try:
        from threadpoolctl import threadpool_limits
    except ImportError:
        # An installation from before it was required is only slower.
        return nullcontext()
    # It has a library of its own, whose threads can be set only once it is loaded.
    import_module("scipy.linalg")
    limits: AbstractContextManager[object] = threadpool_limits(1)
    return limits


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def do_items(sent: bytes, items: Numbered, seconds: float) -> Numbered:
    """In a worker: results of the items that are begun within so many seconds, at least of the first. The task is kept for
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
    """`first`, then pairs until `stop` returns True."""
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
