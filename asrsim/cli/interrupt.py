"""Handling of Ctrl-C: the first Ctrl-C ends a run cleanly, the second ends the command. SIGTERM acts like Ctrl-C."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from asrsim.cli.console import complain

INTERRUPTED = 130
"""Exit code of a command ended by SIGINT, as in shells."""
SIGNALS = (signal.SIGINT, signal.SIGTERM)
AGAIN = 0.3
"""Time in s after which KeyboardInterrupt is raised again if the exception has been suppressed."""


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Context manager under which SIGTERM acts like Ctrl-C, so that files are closed and child processes are ended. It gives a
    function that returns whether such a signal has arrived. Callbacks of compilers and imports of some libraries suppress
    exceptions, so KeyboardInterrupt is raised repeatedly until it is handled.
    """
    timer = getattr(signal, "SIGALRM", None)
    arrived = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal arrived
        handled = sys.exc_info()[1]
        while handled is not None and not isinstance(handled, KeyboardInterrupt):
            handled = handled.__context__
        arrived = True
        if timer is not None:
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
        # The timer must not raise the exception while it is handled, since files are then being closed.
        if number != timer or handled is None:
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield lambda: arrived
        return
    numbers = [number for number in (*SIGNALS, timer) if number is not None and signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, interrupt) for number in numbers}
    try:
        yield lambda: arrived
    finally:
        if timer is not None:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


class Interruption:
    """Context manager under which the first signal only sets `requested`, and the second signal raises KeyboardInterrupt.

    Before the first call of `stop`, the first signal also raises KeyboardInterrupt, since compiling a loop may take half a
    minute without a call of `stop`, and no files are open yet.
    """

    def __init__(self, message: str = "asrsim: stopping; the log will be closed properly (Ctrl-C again to abort)") -> None:
        """message: text printed at the first signal; empty if a signal is the normal way to end the command."""
        self.requested = False
        self._polled = False
        self._message = message
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._handle) for number in SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)
        self._before = {}

    def stop(self) -> bool:
        """Whether the simulation should end."""
        self._polled = True
        return self.requested

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.requested or not self._polled:
            self.requested = True
            outer = self._before[number]
            if callable(outer):
                outer(number, frame)
            raise KeyboardInterrupt
        self.requested = True
        if self._message:
            complain(f"\n{self._message}")
