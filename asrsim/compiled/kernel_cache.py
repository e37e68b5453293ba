"""Folder of the compiled code. Numba runs whatever code is in this folder, so other users must not be able to write to it."""

from __future__ import annotations

import os
import stat
import warnings
from contextlib import suppress
from functools import cache
from pathlib import Path


def cache_file(digest: str) -> Path | None:
    """File in the user's cache beside which Numba stores compiled code; None if the cache is not writable, or if other users
    can write to it."""
    try:
        root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "asrsim" / "kernels"
        path = root / f"kernel_{digest}.py"
        root.parent.mkdir(parents=True, exist_ok=True)
        for folder in (root, root / "__pycache__"):
            with suppress(FileExistsError):
                folder.mkdir(mode=0o700)
        for one in (root, root / "__pycache__", path, *(root / "__pycache__").glob(f"{path.stem}*")):
            if not _is_own(one):
                _warn_of_cache(one)
                return None
        if not path.exists():
            # Write a temporary file and then rename it, since another process may write the same file at the same time.
            aside = path.with_suffix(f".{os.urandom(8).hex()}")
            with aside.open("x", encoding="utf-8") as stream:
                stream.write("# asrsim keeps compiled code beside this file; safe to delete.\n")
            aside.replace(path)
    except (OSError, RuntimeError):
        return None
    return path


def _is_own(path: Path) -> bool:
    """Whether only this user can write to `path`: the user owns it, it is not a link, and others have no write permission."""
    if not hasattr(os, "geteuid"):
        return True
    try:
        status = path.lstat()
    except FileNotFoundError:
        # Another process of this user has just renamed the file, so that it no longer has this name.
        return True
    writable = stat.S_IWOTH | (stat.S_IWGRP if stat.S_ISDIR(status.st_mode) else 0)
    return status.st_uid == os.geteuid() and not stat.S_ISLNK(status.st_mode) and not status.st_mode & writable


@cache
def _warn_of_cache(path: Path) -> None:
    message = f"{path}: other users may have changed this path, so compiled code is neither stored nor loaded; delete the path"
    warnings.warn(message, RuntimeWarning, stacklevel=2)
