"""A worker process: takes runs from its standard input and gives rows to its standard output, until that ends."""

from __future__ import annotations

import os
import pickle
import queue
import signal
import sys
import threading
from multiprocessing.connection import Connection
from typing import Any

BATCH = 0.1
"""s after which finished rows are sent, so that short runs do not cost a message each."""


def main() -> None:
    """What `python -c` of a worker calls. Messages out: ("start", run), ("rows", rows), ("ready",), ("fault", error)."""
    # Only the parent answers Ctrl-C; and what a user's law prints must not come between the messages.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    out = Connection(os.dup(1), readable=False)
    os.dup2(2, 1)
    inbox: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(inbox,), daemon=True).start()
    try:
        _work(inbox, out)
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


def _work(inbox: queue.SimpleQueue[Any], out: Connection) -> None:
    import time as clock

    try:
        payload, logs, share, paths = pickle.loads(inbox.get())
        sys.path[:] = [*paths, *(path for path in sys.path if path not in paths)]
        payload = pickle.loads(payload)
        from asrsim.actuators.user import load_plugin_file
        from asrsim.sweeps.runner import Runner

        for plugin in payload.study.plugins:
            load_plugin_file(plugin)
        runner = Runner(payload, logs=logs, share=share)
    except Exception as error:
        out.send(("fault", f"{type(error).__name__}: {error}"))
        return
    out.send(("ready",))
    while True:
        runs = pickle.loads(inbox.get())
        rows, sent = [], clock.monotonic()
        for run in runs:
            out.send(("start", run))
            rows.append(runner.row(run))
            if clock.monotonic() - sent > BATCH:
                out.send(("rows", rows))
                rows, sent = [], clock.monotonic()
        out.send(("rows", rows))
        out.send(("ready",))
