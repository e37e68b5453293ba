"""Workers: one task done on many items, here, in processes of this machine or on a cluster, behind one small interface."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, MutableMapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from asrsim.errors import SimulationError

DEATHS = 3
"""Workers that may die over one item before it is given up."""
MOST = 500
"""Items that a worker is given at a time."""

Task = Callable[[Any], Any]
"""What is done on an item. It can be pickled, and what it makes ready in a worker it may keep for the next item; results do
not depend on where items are done, nor on their order. Its method `close`, if it has one, is called where it is done with, and
`several`, if it has one, does many: it takes (number, item) one by one, and gives (number, result) in any order."""


@dataclass(frozen=True)
class Lost:
    """In the place of a result: an item over which workers died, again and again."""

    reason: str


class Executor(Protocol):
    """Does tasks somewhere; a context, at whose end nothing of it is left, whatever the reason."""

    def __enter__(self) -> Executor:
        """Begin."""
        ...

    def __exit__(self, *_: object) -> None:
        """End, and what is being computed is not wanted any more."""
        ...

    def results(
        self, task: Task, items: Sequence[Any], *, stop: Callable[[], bool] | None = None
    ) -> Iterator[list[tuple[int, Any]]]:
        """(number of the item, result) as they come, in no order, each once; ends early where `stop` says so.

        Raises what the task raises, and SimulationError where there are no workers.
        """
        ...


class Here:
    """This process does it."""

    def __enter__(self) -> Here:
        return self

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

        for done in several(task, until_stopped()):
            yield [done]
        close(task)


def executor(processes: int, plugins: Sequence[Path] = ()) -> Executor:
    """So many processes of this machine, which load `plugins` first; 1: this process itself, and so on Windows, whose pipes are
    others: results are the same."""
    if processes <= 1 or os.name == "nt":
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


def several(task: Task, items: Iterable[tuple[int, Any]]) -> Iterator[tuple[int, Any]]:
    """A task done on (number, item) as they are asked for; (number, result) as they come."""
    if hasattr(task, "several"):
        return iter(task.several(items))
    return ((number, task(item)) for number, item in items)


def close(task: Task | None) -> None:
    """Release what a task made ready."""
    release = getattr(task, "close", None)
    if release is not None:
        release()


def pickled(what: object) -> bytes:
    """For other processes. Raises SimulationError where it cannot be sent."""
    import pickle

    try:
        return pickle.dumps(what)
    except Exception as error:
        message = f"the work cannot be sent to other processes: {type(error).__name__}: {error}"
        raise SimulationError(message) from error


class Pace:
    """How many items make a piece of work of so many seconds, from what items took lately."""

    def __init__(self, seconds: float) -> None:
        self.wanted, self._mean = seconds, 0.05

    def took(self, seconds: float, items: int) -> None:
        """`items` of them took s."""
        self._mean = 0.7 * self._mean + 0.3 * max(seconds / max(items, 1), 1e-4)

    def size(self, waiting: int, shares: int) -> int:
        """Items of the next piece, of those that wait; `shares` pieces are in work at a time."""
        return max(1, min(MOST, waiting // shares, round(self.wanted / self._mean)))
