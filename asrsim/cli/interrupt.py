"""Ctrl-C: once ends a run cleanly, twice ends the command. SIGTERM is a Ctrl-C; a reader of stdout that has gone is one too."""

from __future__ import annotations

import os
import select
import signal
import stat
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any

from asrsim.cli.console import complain

INTERRUPTED = 130
"""Exit code of a command that SIGINT ended, as shells have it."""
SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def like_an_interruption() -> Iterator[None]:
    """SIGTERM raises KeyboardInterrupt, as SIGINT does: files are closed, processes of ours ended."""

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


def came_from_interruption(error: BaseException | None) -> bool:
    """Whether it is an interruption, or an import that one ended: libraries in C then raise an error of their own."""
    if isinstance(error, KeyboardInterrupt):
        return True
    while error is not None:
        if isinstance(error, ImportError) and isinstance(error.__cause__, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False


class Interruption:
    """While it is entered, the first signal only sets `requested`; the second raises KeyboardInterrupt.

    So does the first before anybody has asked :meth:`stop`: a loop that is being compiled, for half a minute on a busy machine,
    asks nothing, and there is nothing to close yet.
    """

    def __init__(self, message: str = "asrsim: stopping; the log will be closed properly (Ctrl-C again to abort)") -> None:
        """message: what the first signal says; empty: it is how one ends the command, there is nothing to say."""
        self.requested = False
        self._asked = False
        self._message = message
        self._before: dict[int, Any] = {}
        self._pipe = _piped_stdout()

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._handle) for number in SIGNALS}
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)
        self._before = {}

    def stop(self) -> bool:
        """For the simulation: whether to end the run."""
        self._asked = True
        if self._pipe is not None and not self.requested:
            # The reader of our output has gone (`| head -1`): the run ends, without a message.
            self.requested = any(event & (select.POLLERR | select.POLLNVAL) for _, event in self._pipe.poll(0))
        return self.requested

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.requested or not self._asked:
            # A compiler that calls back may swallow the exception: then whoever asks first ends.
            self.requested = True
            raise KeyboardInterrupt
        self.requested = True
        if self._message:
            complain(f"\n{self._message}")


def _piped_stdout() -> Any:
    """What tells whether a pipe at stdout has lost its reader; None where stdout is no pipe, or the system cannot tell."""
    try:
        number = sys.stdout.fileno()
        kind = os.fstat(number).st_mode
    except (AttributeError, OSError, ValueError):
        return None
    if not (stat.S_ISFIFO(kind) or stat.S_ISSOCK(kind)) or not hasattr(select, "poll"):
        return None
    poll = select.poll()
    poll.register(number, 0)
    return poll
