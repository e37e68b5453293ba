"""A worker process: takes pieces of work from its standard input and gives results to its standard output, until that ends."""

from __future__ import annotations

import mmap
import os
import pickle
import queue
import signal
import sys
import threading
import time as clock
from collections.abc import Iterator
from multiprocessing.connection import Connection
from typing import Any

from asrsim.errors import SimulationError
from asrsim.workers import Task, close, several

BATCH = 0.1
"""s after which results are sent, so that short items do not cost a message each."""


def main(note: int) -> None:
    """What `python -c` of a worker calls. note: descriptor of the file whose first 8 bytes tell the item in hand.

    Messages out: ("ready",), ("results", [(number, result)], seconds), ("error", exception).
    """
    # Only the parent answers Ctrl-C; and what a user's law prints must not come between the messages.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    out = Connection(os.dup(1), readable=False)
    os.dup2(2, 1)
    inbox: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(inbox,), daemon=True).start()
    try:
        _work(inbox, out, mmap.mmap(note, 8))
    except (BrokenPipeError, ConnectionError):
        # The parent has gone.
        os._exit(1)


def _read(inbox: queue.SimpleQueue[Any]) -> None:
    into = Connection(0, writable=False)
    try:
        while True:
            inbox.put(into.recv_bytes())
    except (EOFError, OSError):
        # A parent that ended, however, wants nothing any more.
        os._exit(0)


def _work(inbox: queue.SimpleQueue[Any], out: Connection, note: mmap.mmap) -> None:
    """Messages in: (paths, plugins), then ("task", bytes) or ("items", [(number, item)])."""
    task: Task | None = None
    try:
        paths, plugins = pickle.loads(inbox.get())
        sys.path[:] = [*paths, *(path for path in sys.path if path not in paths)]
        from asrsim.actuators.user import load_plugin_file

        for plugin in plugins:
            load_plugin_file(plugin)
        out.send(("ready",))
        while True:
            kind, content = pickle.loads(inbox.get())
            if kind == "task":
                close(task)
                task = pickle.loads(content)
            elif task is not None:
                _do(task, content, out, note)
    except BrokenPipeError:
        raise
    except Exception as error:
        out.send(("error", _sendable(error)))


def _do(task: Task, items: list[tuple[int, Any]], out: Connection, note: mmap.mmap) -> None:
    def noted() -> Iterator[tuple[int, Any]]:
        for number, item in items:
            note[:] = number.to_bytes(8, "little")
            yield number, item

    done, began = [], clock.perf_counter()
    for result in several(task, noted()):
        done.append(result)
        if clock.perf_counter() - began > BATCH:
            out.send(("results", done, clock.perf_counter() - began))
            done, began = [], clock.perf_counter()
    if done:
        out.send(("results", done, clock.perf_counter() - began))
    out.send(("ready",))


def _sendable(error: Exception) -> Exception:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return SimulationError(f"{type(error).__name__}: {error}")
    return error
