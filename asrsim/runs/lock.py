"""A folder belongs to one run at a time: a lock of the operating system, which ends with its process, however that ends."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from asrsim.errors import OutputError
from asrsim.outfile import make_folder

LOCK = ".asrsim.lock"


@contextmanager
def owned(folder: Path) -> Iterator[None]:
    """Make the folder if need be and keep it for ourselves until the block ends.

    Raises OutputError if it cannot be made or written, or is in use: by another process, or elsewhere in this one.
    """
    make_folder(folder)
    path = folder / LOCK
    file = _locked(path)
    try:
        yield
    finally:
        if sys.platform != "win32":
            # While we still hold it: a process that waits for this lock sees that the file is gone, and makes a new one.
            with suppress(OSError):
                path.unlink()
        os.close(file)
        if sys.platform == "win32":
            with suppress(OSError):
                path.unlink()


def _locked(path: Path) -> int:
    """The lock file, opened and locked. Raises OutputError."""
    while True:
        try:
            file = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0), 0o666)
        except OSError as error:
            raise OutputError(f"{path.parent}: cannot be written: {error.strerror or error}") from error
        try:
            _lock(file)
            if _still_there(path, file):
                return file
        except OSError as error:
            os.close(file)
            if error.errno not in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
                raise OutputError(f"{path.parent}: cannot be locked: {error.strerror or error}") from error
            message = "another run is writing there; nothing was written. Wait for it, or choose another folder with --out"
            raise OutputError(f"{path.parent}: is in use: {message}") from error
        os.close(file)


def _lock(file: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        # Of the open file, not of the process: two threads exclude each other too.
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _still_there(path: Path, file: int) -> bool:
    """Whether the file that we locked is the one of that name, and was not taken away by its last owner meanwhile."""
    try:
        return os.path.samestat(path.stat(), os.fstat(file))
    except FileNotFoundError:
        return False
