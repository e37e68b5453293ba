"""Worker processes of this machine: one that dies is replaced, and its item tried again."""

from __future__ import annotations

import mmap
import os
import pickle
import subprocess
import sys
import tempfile
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from asrsim.errors import SimulationError
from asrsim.workers import DEATHS, Lost, Pace, Task, pickled, use_one_thread

PIECE = 0.5
"""s of work that a worker is given at a time: more saves messages, less lets none wait at the end."""
NONE_YET = b"\xff" * 8


class _Worker:
    """A process and its pipes."""

    def __init__(self, greeting: bytes) -> None:
        environment = dict(os.environ)
        use_one_thread(environment)
        root = str(Path(__file__).parents[2])
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, [root, environment.get("PYTHONPATH", "")]))
        with tempfile.TemporaryFile() as file:
            file.truncate(8)
            self._note = mmap.mmap(file.fileno(), 8)
            program = f"from asrsim.workers.child import main; main({file.fileno()})"
            self.process = subprocess.Popen(
                [sys.executable, "-c", program], stdin=-1, stdout=-1, env=environment, pass_fds=[file.fileno()]
            )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.into = Connection(os.dup(self.process.stdin.fileno()), readable=False)
        self.out = Connection(os.dup(self.process.stdout.fileno()), writable=False)
        self.process.stdin.close()
        self.process.stdout.close()
        self.task = b""
        self.numbers: list[int] = []
        """Of items given, and not yet results."""
        self.idle = False
        self._note[:] = NONE_YET
        self.send(greeting)

    def send(self, data: bytes) -> None:
        """A message; one that has died is noticed when its answer is awaited."""
        with suppress(OSError):
            self.into.send_bytes(data)

    def give(self, task: bytes, items: list[tuple[int, Any]]) -> None:
        """Work."""
        if self.task != task:
            self.send(pickle.dumps(("task", task)))
            self.task = task
        self.numbers, self.idle = [number for number, _ in items], False
        self._note[:] = NONE_YET
        self.send(pickle.dumps(("items", items)))

    @property
    def in_hand(self) -> int | None:
        """Number of the item that it began last."""
        noted = self._note[:]
        return None if noted == NONE_YET else int.from_bytes(noted, "little")

    @property
    def end_of_it(self) -> str:
        """How it ended."""
        code = self.process.returncode
        return f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"

    def end(self) -> None:
        """Kill it, if it lives, and release its pipes."""
        self.process.kill()
        self.process.wait()
        self._note.close()
        for pipe in (self.into, self.out):
            with suppress(OSError):
                pipe.close()


class Processes:
    """`count` processes: an :class:`asrsim.workers.Executor`. They begin with the first task, and stay for the next."""

    def __init__(self, count: int, plugins: Sequence[Path] = ()) -> None:
        """plugins: files with users' actuators, loaded first."""
        self._count = count
        self._greeting = pickle.dumps((sys.path, tuple(plugins)))
        self._workers: list[_Worker] = []
        self._deaths: Counter[int] = Counter()
        self._stillborn = 0

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.end()
        self._workers = []

    @property
    def pids(self) -> tuple[int, ...]:
        """Of the processes."""
        return tuple(worker.process.pid for worker in self._workers)

    def results(
        self, task: Task, items: Sequence[Any], *, stop: Callable[[], bool] | None = None
    ) -> Iterator[list[tuple[int, Any]]]:
        """See :class:`asrsim.workers.Executor`."""
        sent, waiting = pickled(task), deque(range(len(items)))
        left, pace = set(waiting), Pace(PIECE)
        self._deaths.clear()
        try:
            for _ in range(min(self._count, len(items)) - len(self._workers)):
                self._workers.append(_Worker(self._greeting))
            while left and not (stop is not None and stop()):
                for worker in self._workers:
                    if worker.idle and waiting:
                        # One that was in a dead worker's hand goes alone: then it is clear whose fault it is.
                        size = 1 if waiting[0] in self._deaths else pace.size(len(waiting), 4 * self._count)
                        worker.give(sent, [(number, items[number]) for number in (waiting.popleft() for _ in range(size))])
                ready = wait([worker.out for worker in self._workers], timeout=0.2)
                for worker in [worker for worker in self._workers if worker.out in ready]:
                    done, alive = self._listen(worker, pace)
                    if not alive:
                        done += self._bury(worker, waiting, left - {number for number, _ in done})
                    done = [(number, result) for number, result in done if number in left]
                    left.difference_update(number for number, _ in done)
                    if done:
                        yield done
        finally:
            # What is still at work, after an error or a stop, must not answer to the next task.
            for worker in [worker for worker in self._workers if worker.numbers]:
                worker.end()
                self._workers.remove(worker)

    def _listen(self, worker: _Worker, pace: Pace) -> tuple[list[tuple[int, Any]], bool]:
        """Everything that a worker has said, and whether it lives."""
        done: list[tuple[int, Any]] = []
        while True:
            try:
                if not worker.out.poll():
                    return done, True
                message: Any = worker.out.recv()
            except (EOFError, OSError, pickle.UnpicklingError):
                return done, False
            if message[0] == "error":
                raise message[1]
            if message[0] == "ready":
                worker.idle = True
            else:
                done += message[1]
                pace.took(message[2], len(message[1]))
                given = {number for number, _ in message[1]}
                worker.numbers = [number for number in worker.numbers if number not in given]
                self._stillborn = 0

    def _bury(self, worker: _Worker, waiting: deque[int], left: set[int]) -> list[tuple[int, Any]]:
        """Replace a dead worker; its items go back to the front, the one in its hand first, unless too many died over it."""
        in_hand = worker.in_hand
        worker.end()
        self._workers.remove(worker)
        again = [number for number in worker.numbers if number in left]
        lost: list[tuple[int, Any]] = []
        if in_hand is None:
            self._stillborn += 1
            if self._stillborn >= DEATHS * self._count:
                raise SimulationError(f"workers die before they begin to work ({worker.end_of_it})")
        elif in_hand in again:
            self._deaths[in_hand] += 1
            again.remove(in_hand)
            if self._deaths[in_hand] < DEATHS:
                again.insert(0, in_hand)
            else:
                lost.append((in_hand, Lost(f"{DEATHS} workers died in this run, the last by {worker.end_of_it}")))
        waiting.extendleft(reversed(again))
        self._workers.append(_Worker(self._greeting))
        return lost
