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
from tempfile import TemporaryDirectory
from typing import Any

from asrsim.errors import SimulationError

DEATHS = 3
"""Times that workers may die over one item, done by itself, before it is given up."""
MOST = 500
"""Items that a worker is given at a time."""

Task = Callable[[Any], Any]
"""What is done on an item. It can be pickled, and may keep what it makes ready in a worker for the next item. Results depend
neither on where items are done nor on their order. Its method `close`, if it has one, is called in the end. Its method
`several`, if it has one, does many: it takes (number, item) one by one, and gives (number, result) in any order."""


class Lost:
    """In the place of a result: an item over which workers died again and again."""

    def __init__(self, reason: str) -> None:
        self.reason = reason


class Executor(ABC):
    """Does tasks somewhere. A context: at its end nothing is left, whatever the reason."""

    def __enter__(self) -> Executor:
        return self

    @abstractmethod
    def __exit__(self, *_: object) -> None:
        """End. What is being computed is not wanted any more."""

    @abstractmethod
    def results(
        self, task: Task, items: Sequence[Any], *, stop: Callable[[], bool] | None = None
    ) -> Iterator[list[tuple[int, Any]]]:
        """(number of the item, result) as they come, in any order, each once; ends early where `stop` says so.

        Raises what the task raises, and SimulationError where there are no workers.
        """


class Here(Executor):
    """This process does it."""

    def __exit__(self, *_: object) -> None:
        pass

    def results(
        self, task: Task, items: Sequence[Any], *, stop: Callable[[], bool] | None = None
    ) -> Iterator[list[tuple[int, Any]]]:
        """See :class:`Executor`."""

        def until_stopped() -> Iterator[tuple[int, Any]]:
            for numbered in enumerate(items):
                if stop is not None and stop():
                    return
                yield numbered

        for done in _several(task, until_stopped()):
            yield [done]
        _close(task)


class Pool(Executor):
    """Workers that a library keeps. They take pieces of work ahead of time, and each piece's results come when it ends."""

    died: tuple[type[Exception], ...] = ()
    """What a piece raises whose worker died."""
    again: tuple[type[Exception], ...] = ()
    """What a piece raises that is to be done again, through no fault of its own."""

    def __init__(self, plugins: Iterable[Path | tuple[str, bytes]] = ()) -> None:
        """plugins: files with users' actuators, or their names and contents, which workers load first."""
        self._plugins = tuple(plugins)

    @abstractmethod
    def slots(self, sent: bytes) -> int:
        """Pieces of this task that may be out at a time; 0: no worker is there at the moment."""

    @abstractmethod
    def submit(self, sent: bytes, items: list[tuple[int, Any]]) -> Any:
        """A future of :func:`do_items`."""

    @abstractmethod
    def abandon(self, futures: Sequence[Any]) -> None:
        """Nobody waits for these any more."""

    def renew(self) -> None:
        """Workers may have lost what they were sent."""

    def results(
        self, task: Task, items: Sequence[Any], *, stop: Callable[[], bool] | None = None
    ) -> Iterator[list[tuple[int, Any]]]:
        """See :class:`Executor`. Pieces that were in work when a worker died are done again one by one, and halved where a
        worker dies again: so the item is found that kills them."""
        sent = _pickled((self._plugins, _pickled(task)))
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
                    try:
                        found = future.result()
                    except self.died as error:
                        half = len(mine) // 2
                        if not alone:
                            suspects.append(mine)
                        elif half:
                            suspects.extendleft([mine[half:], mine[:half]])
                        else:
                            deaths.update(mine)
                            if deaths[mine[0]] < DEATHS:
                                suspects.appendleft(mine)
                            else:
                                yield [(mine[0], Lost(f"{DEATHS} workers died in this run: {error}"))]
                        continue
                    except self.again:
                        self.renew()
                        found = []
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
    """Results of all items, in their order. Raises SimulationError for what is lost, and what the task raises."""
    found: dict[int, Any] = {}
    for some in workers.results(task, items):
        found.update(some)
    for result in found.values():
        if isinstance(result, Lost):
            raise SimulationError(result.reason)
    return [found[number] for number in range(len(items))]


def use_one_thread(environment: MutableMapping[str, str]) -> None:
    """Before NumPy is imported: its library's threads cost more than they save on a robot's small matrices (80 joints: a run
    takes 2.4 times as long), and would fight over the cores that other processes of ours fill."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        environment.setdefault(name, "1")


def one_thread() -> AbstractContextManager[object]:
    """The same for a while, where NumPy is there already, as in a script: a fit takes a third of the processor's time."""
    try:
        from threadpoolctl import threadpool_limits
    except ImportError:
        # An installation from before it was required is only slower.
        return nullcontext()
    # It has a library of its own, which can be told only when it is there.
    import_module("scipy.linalg")
    limits: AbstractContextManager[object] = threadpool_limits(1)
    return limits


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def do_items(sent: bytes, items: Iterable[tuple[int, Any]], seconds: float) -> list[tuple[int, Any]]:
    """In a worker: results of the items that could be begun within so many seconds, at least of the first. What the task made
    ready is kept for its next piece."""
    if getattr(_OWN, "sent", b"") != sent:
        _close(getattr(_OWN, "task", None))
        plugins, task = pickle.loads(sent)
        for plugin in plugins:
            _load(plugin)
        _OWN.task, _OWN.sent = pickle.loads(task), sent
    end = clock.monotonic() + seconds

    def begun() -> Iterator[tuple[int, Any]]:
        for numbered in items:
            yield numbered
            if clock.monotonic() > end:
                return

    return list(_several(_OWN.task, begun()))


_OWN = threading.local()
_FOLDERS: list[TemporaryDirectory[str]] = []


@cache
def _load(plugin: Path | tuple[str, bytes]) -> None:
    """A file with users' actuators, or its name and content: once a process."""
    from asrsim.actuators.user import load_plugin_file

    if isinstance(plugin, tuple):
        folder = TemporaryDirectory(prefix="asrsim-plugin-")
        _FOLDERS.append(folder)
        name, content = plugin
        plugin = Path(folder.name) / name
        plugin.write_bytes(content)
    load_plugin_file(plugin)


def _several(task: Task, items: Iterable[tuple[int, Any]]) -> Iterator[tuple[int, Any]]:
    if hasattr(task, "several"):
        return iter(task.several(items))
    return ((number, task(item)) for number, item in items)


def _close(task: Task | None) -> None:
    release = getattr(task, "close", None)
    if release is not None:
        release()


def _pickled(what: object) -> bytes:
    """For other processes. Raises SimulationError where it cannot be sent."""
    try:
        return pickle.dumps(what)
    except Exception as error:
        message = f"the work cannot be sent to other processes: {type(error).__name__}: {error}"
        raise SimulationError(message) from error
