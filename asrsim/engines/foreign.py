"""Protection from a library that prints to the C streams and may crash the process."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

_lock = threading.RLock()
_inside: list[bool] = []
"""Not empty while a thread is in :func:`quiet`."""


@contextmanager
def quiet() -> Iterator[None]:
    """Keep what a C library prints out of the user's terminal. Other threads that want the same wait.

    The garbage collector may end an engine at any moment, which calls this function again: that changes nothing.
    """
    with _lock:
        if _inside:
            yield
            return
        saved: list[tuple[int, int]] = []
        try:
            _inside.append(True)
            _flush()
            saved.extend((number, os.dup(number)) for number in (1, 2) if _is_open(number))
            nowhere = os.open(os.devnull, os.O_WRONLY)
            for number, _ in saved:
                os.dup2(nowhere, number)
            os.close(nowhere)
            yield
        finally:
            # Ctrl-C may come at any line: the streams are restored first of all.
            try:
                # The C library buffers what it has printed to a pipe or a file.
                _flush()
            finally:
                for number, copy in saved:
                    os.dup2(copy, number)
                    os.close(copy)
                _inside.clear()


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
    """Whether a call crashes, tried in a child process: Bullet's mesh readers trust their files."""
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
