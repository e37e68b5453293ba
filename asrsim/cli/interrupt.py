"""Handling of Ctrl-C: the first Ctrl-C ends a run cleanly, the second ends the command. SIGTERM acts like Ctrl-C."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from asrsim.cli.console import complain

INTERRUPTED = 130
"""Exit code of a command ended by SIGINT, as in shells."""
SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def like_an_interruption() -> Iterator[None]:
    """Context manager under which SIGTERM raises KeyboardInterrupt, so that files are closed and child processes are ended."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


class Interruption:
    """Context manager under which the first signal only sets `requested`, and the second signal raises KeyboardInterrupt.

    Before the first call of `stop` the first signal raises KeyboardInterrupt too: compiling a loop may take half a minute and
    does not call `stop`, and no files need closing yet.
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
            # A compiler callback may swallow the exception: then the next call of `stop` ends the run.
            self.requested = True
            raise KeyboardInterrupt
        self.requested = True
        if self._message:
            complain(f"\n{self._message}")
