"""Manners for a library that prints to the C streams and may take the process down with it."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress


@contextmanager
def quiet() -> Iterator[None]:
    """Bullet writes to the C streams; keep them out of the user's terminal. Threads may be in it at the same time."""
    inside = False
    try:
        with _silence:
            if not _silence.depth:
                _flush()
            # Counted before the streams are redirected: the collector may end an engine in between, which calls this function
            # too; it finds that somebody is inside already, and leaves the streams alone.
            inside = True
            _silence.depth += 1
            if _silence.depth == 1:
                _silence.redirect()
        yield
    finally:
        # A Ctrl-C may come at any line; what is said of it must not be lost too.
        if inside:
            with _silence:
                try:
                    # What C has printed to a pipe or a file waits in its buffer until then.
                    if _silence.depth == 1:
                        _flush()
                finally:
                    if _silence.depth == 1:
                        _silence.restore()
                    _silence.depth -= 1


class _Silence:
    """The streams' state while somebody is in :func:`quiet`; entered to look at it or to change it.

    A thread may be in it twice: the collector may end an engine that nobody holds any more at any moment, which is quiet too.
    """

    def __init__(self) -> None:
        self.depth = 0
        self.saved: list[tuple[int, int]] = []
        self._lock = threading.RLock()

    def redirect(self) -> None:
        """The C streams lead nowhere."""
        self.saved = [(number, os.dup(number)) for number in (1, 2) if _is_open(number)]
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for number, _ in self.saved:
            os.dup2(nowhere, number)
        os.close(nowhere)

    def restore(self) -> None:
        """And where they led before."""
        while self.saved:
            number, copy = self.saved.pop()
            os.dup2(copy, number)
            os.close(copy)

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()


_silence = _Silence()


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def _flush() -> None:
    """Empty the buffers of Python's streams and of C's."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
    # The C library of the process; on Windows the one that extension modules share.
    with suppress(OSError, AttributeError):
        (ctypes.CDLL("ucrtbase") if sys.platform == "win32" else ctypes.CDLL(None)).fflush(None)


def crashes(call: Callable[[], object]) -> bool:
    """Whether a call kills the process, tried in a child: Bullet's mesh readers trust their files."""
    if not hasattr(os, "fork"):
        return False
    child = os.fork()
    if child == 0:
        with suppress(BaseException):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            for number in (1, 2):
                os.dup2(nowhere, number)
            call()
        os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])
