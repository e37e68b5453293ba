"""Ctrl-C: once ends a run cleanly, twice ends the command."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any

from asrsim.cli.console import complain

INTERRUPTED = 130
"""Exit code of a command that SIGINT ended, as shells have it."""


class Interruption:
    """While it is entered, the first SIGINT only sets `requested`; the second raises KeyboardInterrupt."""

    def __init__(self) -> None:
        self.requested = False
        self._before: Any = None

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._handle)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
            self._before = None

    def stop(self) -> bool:
        """For the simulation: whether to end the run."""
        return self.requested

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True
        complain("\nasrsim: stopping; the log will be closed properly (Ctrl-C again to abort)")
