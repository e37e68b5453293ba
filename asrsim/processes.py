"""Processes of ours: they end with the one that began them, however that ends."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import MutableMapping
from multiprocessing import parent_process


def use_one_thread(environment: MutableMapping[str, str]) -> None:
    """Before NumPy is imported: its library's threads cost more than they save on a robot's small matrices (80 joints: a run
    takes 2.4 times as long), and would fight over the cores that other processes of ours fill."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        environment.setdefault(name, "1")


def end_with_parent() -> None:
    """For a new process: leave Ctrl-C to the parent, which ends us, and end when it is gone (killed, or out of memory)."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
