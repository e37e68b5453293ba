"""Safe writing of files: a file is written completely or not at all.

Links are never replaced. Files that asrsim did not write are replaced only if the user permits it.
"""

from __future__ import annotations

import csv
import io
import json
import os
import re
import stat
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from asrsim.errors import OutputError

if TYPE_CHECKING:
    from asrsim.samples import Array

MARKS = {
    "log": rb"\A\x89MCAP0\r\n.{9}\x04\0\0\0ros2.{4}asrsim ",
    "json": rb'\A\{\s*"generator": ?"asrsim ',
    "page": rb'<meta name="generator" content="asrsim ',
    "picture": rb"Software\0asrsim|/Creator \(asrsim\)|<dc:title>asrsim</dc:title>|\x21\xfe\x06asrsim|\xa9cmt.{8,24}asrsim",
    "metrics": rb"\Asource,joint,quantity,measure,value,unit\r?\n",
    "learned input": rb"\A# asrsim ilc( --guess-only| --next| --experiment)?: ",
    "learned scenario": rb"\A# Plays what `asrsim ilc` (found|learned)",
    "limits": rb"\A# Limits of `asrsim design`",
    "designed motion": rb"\A# asrsim design: ",
    "designed scenario": rb"\A# Plays the experiment that `asrsim design` found",
    "learning state": rb"a\0\0\0s\0\0\0r\0\0\0s\0\0\0i\0\0\0m\0\0\0 \0\0\0l\0\0\0e\0\0\0a\0\0\0r\0\0\0n",
    "mjcf": rb"<!-- Made by asrsim export",
    "package": rb"\A# Made by asrsim export",
    "mesh": rb"\Aasrsim mesh",
    "twin": rb"\A# asrsim twin: ",
    "ranges": rb"\A# Ranges by asrsim export",
    "robot": rb"<!-- written by asrsim identify -->\n\Z",
    "fitted scenario": rb"\A# Scenario with the parameters that `asrsim identify` found",
    "fitted command": rb"\A# Command as `asrsim identify` played it",
    "rows": rb"\APAR1",
    "fit file": rb"\A# Fit for `asrsim identify`",
    "sheet scenario": rb"\A# Trials of the data sheet of ",
    "sheet robot": rb"<!-- Test load of the data sheet of ",
    "schema": rb'"title": "asrsim scenario"',
}
"""Mark at the start or end of each kind of file, by which asrsim recognises the files that it wrote."""
ABANDONED = 60.0
"""Age in s above which an unfinished file that no process has locked counts as the file of a killed process."""
_LOOKED_AT = 1 << 16
"""Number of bytes at the start and the end of a file that are searched for the mark."""


def is_ours(path: Path, kind: str) -> bool:
    """Whether the mark of this file says that asrsim wrote it. An empty file counts as a file of asrsim, since nothing can be
    lost."""
    mark = MARKS[kind]
    if path.is_symlink() or not path.is_file():
        return False
    try:
        with path.open("rb") as stream:
            ends = [stream.read(_LOOKED_AT)]
            if stream.seek(0, 2) > _LOOKED_AT:
                stream.seek(-_LOOKED_AT, 2)
                ends.append(stream.read())
    except OSError:
        return False
    return not ends[0] or any(re.search(mark, part, re.DOTALL) for part in ends)


def check_output(path: Path, kind: str, *, inputs: Iterable[Path] = (), replace: bool = False) -> None:
    """Check that a file of this kind may be written to `path`.

    inputs: files that the same command reads. replace: whether the user permits replacing any file except the inputs.
    Raises OutputError if `path` is an input, a link or a folder, or a file that asrsim did not write.
    """
    for one in inputs:
        with suppress(OSError):
            if one.samefile(path):
                raise OutputError(f"{path}: is an input of this command and would be lost: choose another path")
    if path.is_dir():
        raise OutputError(f"{path}: cannot be written: it is a folder")
    if is_special(path):
        return
    if path.is_symlink():
        raise OutputError(f"{path}: is a link: use the path of its target")
    # Call `is_ours` also for a new file. It raises KeyError if the kind has no mark, which is an error of the caller.
    if not is_ours(path, kind) and path.exists() and not replace:
        raise OutputError(f"{path}: exists and was not written by asrsim: remove it, or choose another path")


def is_special(path: Path) -> bool:
    """Whether the path is a device or a pipe. Devices and pipes are written to directly and are not replaced."""
    return path.exists() and not path.is_file() and not path.is_dir()


@contextmanager
def written(path: Path, kind: str, *, replace: bool = False) -> Iterator[BinaryIO]:
    """Open stream for the new content of `path`. It replaces the old content when the block ends without an error; otherwise
    `path` stays unchanged.

    kind: key of `MARKS`; replace: as in `check_output`. Raises OutputError, also for a full disk.
    """
    check_output(path, kind, replace=replace)
    if is_special(path):
        with _with_output_error(path), path.open("wb") as stream:
            yield stream
        return
    # The temporary file has a random name and must be new, so that no existing link is followed and no existing file is
    # overwritten.
    part = path.with_name(f".asrsim-{os.urandom(8).hex()}.part")
    _remove_abandoned(path.parent)
    try:
        with _with_output_error(path):
            with part.open("xb") as stream:
                with suppress(OSError):  # without locks, the unfinished file of a killed process stays
                    lock(stream.fileno())
                yield stream
            part.replace(path)
    finally:
        with suppress(OSError):
            part.unlink()


def lock(file: int) -> None:
    """Lock an open file until it is closed, or until the process ends. Raises OSError if the file is locked elsewhere."""
    if sys.platform == "win32":
        import msvcrt

        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        # Use flock, which locks the open file and not the process, so that two threads of a process also exclude each other.
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _remove_abandoned(folder: Path) -> None:
    """Remove the unfinished files of killed processes from the folder: files older than a minute that no process has locked."""
    if sys.platform == "win32":  # Windows cannot remove open files
        return
    for part in folder.glob(".asrsim-" + "[0-9a-f]" * 16 + ".part"):
        with suppress(OSError):
            file = os.open(part, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
            try:
                about = os.fstat(file)
                if stat.S_ISREG(about.st_mode) and time.time() - about.st_mtime > ABANDONED:
                    lock(file)
                    part.unlink()
            finally:
                os.close(file)


@contextmanager
def _with_output_error(path: Path) -> Iterator[None]:
    """Convert errors of the operating system to OutputError, which names the file."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error


def write_text(path: Path, text: str, kind: str, *, replace: bool = False) -> None:
    """Write a text to a UTF-8 file as `written` does. The folder of the file must exist. Raises OutputError."""
    with written(path, kind, replace=replace) as stream:
        stream.write(text.encode())


def csv_text(headings: Sequence[str], table: Array) -> str:
    """Table (rows, columns) as CSV text. Each number is the shortest text that reads back exactly, as `repr` gives it."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(headings)
    writer.writerows(map(repr, row) for row in table.tolist())
    return text.getvalue()


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write plain data as a JSON document, with the name and version of asrsim. Raises OutputError."""
    from asrsim import __version__

    document = {"generator": f"asrsim {__version__}", **data}
    write_text(path, json.dumps(document, indent=2, ensure_ascii=False) + "\n", "json")


def remove_ours(path: Path, kind: str) -> None:
    """Delete a file if its mark says that asrsim wrote it. Raises OutputError."""
    if is_ours(path, kind):
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"{path}: cannot replace it: {error.strerror or error}") from error


def make_folder(folder: Path) -> Path:
    """Path of the folder, which is created with its parents if missing. Raises OutputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        file = next((one for one in (folder, *folder.parents) if one.is_file()), None)
        why = f"{file} is a file" if file is not None else error.strerror or error
        raise OutputError(f"{folder}: cannot make the folder: {why}") from error
    return folder
