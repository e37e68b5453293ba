"""Worker processes on this machine, managed by loky, which does not import the script that started them."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time as clock
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from loky import ProcessPoolExecutor
from loky.process_executor import BrokenProcessPool

from asrsim.workers import Pool, do_items, use_one_thread


class Processes(Pool):
    """Pool of `count` processes. The processes start with the first task and are reused for later tasks."""

    died = (BrokenProcessPool,)

    def __init__(self, count: int, plugins: Iterable[Path] = ()) -> None:
        super().__init__(plugins)
        self._count = count
        self._pool: Any = None

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(kill_workers=True)
            self._pool = None

    def slots(self, sent: bytes) -> int:
        """Number of pieces that may be in progress; see `Pool.slots`."""
        return 2 * self._count

    def submit(self, sent: bytes, items: Sequence[Any]) -> Any:
        """Submit a piece of work; see `Pool.submit`."""
        if self._pool is not None:
            with suppress(BrokenProcessPool):
                return self._pool.submit(do_items, sent, items)
            self.__exit__()
        environment: dict[str, str] = {}
        use_one_thread(environment)
        environment = {name: os.environ.get(name, value) for name, value in environment.items()}
        # loky replaces a process that grows by 300 MB, and warns about a memory leak. Hide this warning, since our processes
        # grow because they keep prepared simulation worlds.
        warnings.filterwarnings("ignore", "A worker was restarted", UserWarning, r"loky\.")
        self._pool = ProcessPoolExecutor(self._count, initializer=_begin, initargs=(os.getpid(),), env=environment)
        with _ignoring_interrupts():
            return self._pool.submit(do_items, sent, items)

    def abandon(self, futures: Sequence[Any]) -> None:
        """Cancel pieces of work; see `Pool.abandon`."""
        if futures:
            self.__exit__()


@contextmanager
def _ignoring_interrupts() -> Iterator[None]:
    """Context manager in which new processes start so that they ignore Ctrl-C from their first moment. If the user presses
    Ctrl-C during the block, this process is interrupted at the end of the block.
    """
    if sys.platform == "win32" or threading.current_thread() is not threading.main_thread():
        yield
        return
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _begin(parent: int) -> None:
    """Set up this worker process: it ignores Ctrl-C, prints to stderr, and ends when the process `parent` ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)

    def watch() -> None:
        while os.getppid() == parent:
            clock.sleep(1.0)
        os._exit(0)

    threading.Thread(target=watch, daemon=True).start()
