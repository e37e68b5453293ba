"""Manners for a library that prints to the C streams and may take the process down with it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def quiet() -> Iterator[None]:
    """Bullet writes to the C streams; keep them out of the user's terminal."""
    sys.stdout.flush()
    sys.stderr.flush()
    with Path(os.devnull).open("w") as nowhere:
        saved = os.dup(1), os.dup(2)
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(saved[0], 1)
            os.dup2(saved[1], 2)
            os.close(saved[0])
            os.close(saved[1])


def crashes(call: Callable[[], object]) -> bool:
    """Whether a call kills the process, tried in a child: Bullet's mesh readers trust their files."""
    if not hasattr(os, "fork"):
        return False
    child = os.fork()
    if child == 0:
        with suppress(BaseException):
            call()
        os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])
