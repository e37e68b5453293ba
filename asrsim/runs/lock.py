"""Locks a folder for one run. The operating system releases the lock when the process ends, even if the process is killed."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from asrsim.errors import OutputError
from asrsim.outfile import lock, make_folder

LOCK = ".asrsim.lock"


@contextmanager
def owned(folder: Path) -> Iterator[None]:
    """Create the folder if the folder is missing, and lock the folder until the block ends.

    Raises OutputError if the folder cannot be created or written, or if this process or another process has locked the folder.
    """
    make_folder(folder)
    path = folder / LOCK
    file = _locked(path)
    try:
        yield
    finally:
        if sys.platform != "win32":
            # Remove the lock file before its lock is released. A waiting process then finds that the file was removed, and
            # creates a new file.
            with suppress(OSError):
                path.unlink()
        os.close(file)
        if sys.platform == "win32":
            with suppress(OSError):
                path.unlink()


def _locked(path: Path) -> int:
    """File descriptor of the lock file, which is opened and locked. Raises OutputError."""
    while True:
        try:
            file = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0), 0o666)
        except OSError as error:
            raise OutputError(f"{path.parent}: cannot be written: {error.strerror or error}") from error
        try:
            lock(file)
            if _still_there(path, file):
                return file
        except OSError as error:
            os.close(file)
            if error.errno not in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
                raise OutputError(f"{path.parent}: cannot be locked: {error.strerror or error}") from error
            message = "another run is writing to it; nothing was written. Wait for it, or choose another folder with --out"
            raise OutputError(f"{path.parent}: is in use: {message}") from error
        os.close(file)


def _still_there(path: Path, file: int) -> bool:
    """Whether this path still leads to the locked file. If not, the previous owner removed the file before this process locked
    it."""
    try:
        return os.path.samestat(path.stat(), os.fstat(file))
    except FileNotFoundError:
        return False
