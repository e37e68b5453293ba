"""Worker processes of this machine: a worker that dies is replaced, and its run tried again."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from asrsim.errors import SimulationError
from asrsim.processes import use_one_thread
from asrsim.sweeps.cases import Payload
from asrsim.sweeps.runner import Row, lost

DEATHS = 3
"""Workers that may die over one run before it is a row that says so."""
CHUNK_SECONDS = 0.5
"""Work that a worker is given at a time: more saves messages, less lets none wait at the end."""
MOST = 500
"""Runs of a chunk."""


class _Worker:
    """A process and its pipes."""

    def __init__(self, greeting: bytes) -> None:
        environment = dict(os.environ)
        use_one_thread(environment)
        root = str(Path(__file__).parents[2])
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, [root, environment.get("PYTHONPATH", "")]))
        program = "from asrsim.sweeps.worker import main; main()"
        self.process = subprocess.Popen([sys.executable, "-c", program], stdin=-1, stdout=-1, env=environment)
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.into = Connection(os.dup(self.process.stdin.fileno()), readable=False)
        self.out = Connection(os.dup(self.process.stdout.fileno()), writable=False)
        self.process.stdin.close()
        self.process.stdout.close()
        self.runs: list[int] = []
        """Given, and not yet rows."""
        self.current = -1
        """The run in hand."""
        self.idle = False
        self.send(greeting)

    def send(self, data: bytes) -> None:
        """A message; one that has died is noticed when its answer is awaited."""
        with suppress(OSError):
            self.into.send_bytes(data)

    def end(self) -> None:
        """Kill it, if it lives, and release its pipes."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.into, self.out):
            with suppress(OSError):
                pipe.close()


class Workers:
    """`count` processes that do a study's runs; a context."""

    def __init__(self, payload: Payload, *, count: int, logs: Path | None = None) -> None:
        """Raises SimulationError for a study that cannot be sent to a process."""
        self._payload, self._count = payload, count
        self._greeting = pickle.dumps((pickled(payload), logs, count, sys.path))
        self._workers: list[_Worker] = []
        self._deaths: Counter[int] = Counter()
        self._stillborn = 0
        self._seconds = 0.05
        """Mean time of a run lately, s."""

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.end()
        self._workers = []

    @property
    def pids(self) -> tuple[int, ...]:
        """Of the processes."""
        return tuple(worker.process.pid for worker in self._workers)

    def rows(self, runs: Sequence[int] | Iterable[int], *, stop: Callable[[], bool] | None = None) -> Iterator[list[Row]]:
        """Rows as they come, in no order, each run once; ends early where `stop` says so.

        Raises SimulationError where workers cannot start.
        """
        waiting = deque(int(run) for run in runs)
        total = len(waiting)
        count = min(self._count, total)
        self._workers = [_Worker(self._greeting) for _ in range(count)]
        left = set(waiting)
        while left and not (stop is not None and stop()):
            ready = wait([worker.out for worker in self._workers], timeout=0.2)
            for worker in list(self._workers):
                if worker.out not in ready:
                    continue
                rows, alive = self._listen(worker)
                rows = [row for row in rows if row[0] in left]
                left.difference_update(row[0] for row in rows)
                if rows:
                    mean = sum(row[-1] or 0.0 for row in rows) / len(rows)
                    self._seconds = 0.7 * self._seconds + 0.3 * max(mean, 1e-4)
                    yield rows
                if not alive:
                    crashed = self._bury(worker, waiting, left)
                    if crashed:
                        left.discard(crashed[0][0])
                        yield crashed
            self._feed(waiting)

    def _listen(self, worker: _Worker) -> tuple[list[Row], bool]:
        """Everything that a worker has said, and whether it lives."""
        rows: list[Row] = []
        try:
            while worker.out.poll():
                message: Any = worker.out.recv()
                if message[0] == "start":
                    worker.current = message[1]
                elif message[0] == "ready":
                    worker.idle = True
                elif message[0] == "rows":
                    rows += message[1]
                    given = {row[0] for row in message[1]}
                    worker.runs = [run for run in worker.runs if run not in given]
                    self._stillborn = 0
                else:
                    raise SimulationError(f"a worker cannot start: {message[1]}")
        except (EOFError, OSError, pickle.UnpicklingError):
            return rows, False
        return rows, True

    def _bury(self, worker: _Worker, waiting: deque[int], left: set[int]) -> list[Row]:
        """Replace a dead worker; its runs go back to the front, but one over which too many died becomes a row."""
        worker.end()
        self._workers.remove(worker)
        rows: list[Row] = []
        again = [run for run in worker.runs if run in left]
        if worker.current in again:
            self._deaths[worker.current] += 1
            if self._deaths[worker.current] >= DEATHS:
                again.remove(worker.current)
                code = worker.process.returncode
                how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
                rows.append(lost(self._payload, worker.current, f"{DEATHS} workers died in this run, the last by {how}"))
            elif self._deaths[worker.current] >= 1:
                # Alone with its chunk, so that its next death harms no other.
                again.remove(worker.current)
                again.insert(0, worker.current)
        elif worker.current < 0:
            self._stillborn += 1
            if self._stillborn >= DEATHS * max(1, self._count):
                raise SimulationError(f"workers die before their first run (exit code {worker.process.returncode})")
        waiting.extendleft(reversed(again))
        if waiting or left:
            self._workers.append(_Worker(self._greeting))
        return rows

    def _feed(self, waiting: deque[int]) -> None:
        for worker in self._workers:
            if worker.idle and waiting:
                share = max(1, len(waiting) // (4 * self._count))
                size = max(1, min(MOST, share, round(CHUNK_SECONDS / self._seconds)))
                worker.runs = [waiting.popleft() for _ in range(min(size, len(waiting)))]
                worker.current, worker.idle = -2, False
                worker.send(pickle.dumps(worker.runs))


def pickled(payload: object) -> bytes:
    """The payload for other processes. Raises SimulationError where it cannot be sent."""
    try:
        return pickle.dumps(payload)
    except Exception as error:
        message = f"the study cannot be sent to other processes: {type(error).__name__}: {error}"
        raise SimulationError(message) from error
