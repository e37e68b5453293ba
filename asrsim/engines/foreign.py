"""Protection of the terminal from C libraries that print to it."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_lock = threading.Lock()


@contextmanager
def quiet() -> Iterator[None]:
    """Discard what C libraries print. Only one thread at a time can be inside `quiet`; other threads wait."""
    with _lock:
        saved: list[tuple[int, int]] = []
        try:
            _flush()
            saved.extend((number, os.dup(number)) for number in (1, 2) if _is_open(number))
            nowhere = os.open(os.devnull, os.O_WRONLY)
            for number, _ in saved:
                os.dup2(nowhere, number)
            os.close(nowhere)
            yield
        finally:
            # Ctrl-C may interrupt any of these lines, so the streams are restored in `finally`.
            try:
                # The C library buffers output to a pipe or a file. Flush the buffer before the streams are restored, since the
                # output would otherwise appear later.
                _flush()
            finally:
                for number, copy in saved:
                    os.dup2(copy, number)
                    os.close(copy)


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def _flush() -> None:
    """Flush the output buffers of Python and of the C library."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
    # Flush the buffers of the C library of this process. On Windows, extension modules share the library `ucrtbase`.
    with suppress(OSError, AttributeError):
        (ctypes.CDLL("ucrtbase") if sys.platform == "win32" else ctypes.CDLL(None)).fflush(None)
