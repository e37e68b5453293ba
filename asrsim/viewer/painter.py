"""Draws the pictures of a page in a separate thread, so that no picture delays the simulation."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable
from contextlib import AbstractContextManager
from threading import Event, Thread
from typing import Any

from asrsim.viewer.page import FRAME

SWITCH = 5e-4
"""Longest time for which a thread keeps Python's lock while another thread waits for the lock, s. With Python's default of 5
ms, each tick of the simulation could wait 5 ms until a thread that draws or sends releases the lock.
"""
SHARE = 0.5
"""Largest fraction of a core's time that the thread spends on pictures."""


class Painter:
    """Calls a function at the page's rate of pictures, in a separate thread. It is a context manager, which ends this
    thread."""

    def __init__(self, draw: Callable[[], None], lock: AbstractContextManager[Any]) -> None:
        """draw: function that draws a picture; lock: lock that is held while a picture is drawn."""
        self._draw, self._lock, self._stopped = draw, lock, Event()
        self._thread = Thread(target=self._work, daemon=True)
        self.error: BaseException | None = None
        """Error that ended the thread; None without an error."""

    def __enter__(self) -> Painter:
        self._interval = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()
        sys.setswitchinterval(self._interval)

    def _work(self) -> None:
        try:
            due, pause = clock.perf_counter(), 0.0
            while not self._stopped.wait(pause):
                with self._lock:
                    began = clock.thread_time()
                    self._draw()
                    spent = clock.thread_time() - began
                now = clock.perf_counter()
                # A late picture does not delay the next picture; pictures that are overdue are skipped. For `SHARE`, count only
                # the time in which this thread works, and not the time in which it waits for a page or for a core.
                due = max(due + FRAME, now + (1.0 / SHARE - 1.0) * spent)
                pause = due - now
        except BaseException as error:
            self.error = error
