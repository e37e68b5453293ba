"""Files that we write: whole or not at all, never over what somebody else wrote, and never through a link."""

from __future__ import annotations

import csv
import io
import json
import os
import re
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
    "bench": rb"\Atime,[^\n]+\.position,[^\n]+\.elastic_torque_1,[^\n]+\.stiffness,",
    "learned input": rb"\A# asrsim ilc( --guess-only| --next)?: ",
    "learned scenario": rb"\A# Plays what `asrsim ilc` (found|learned)",
    "designed motion": rb"\A# asrsim design: ",
    "designed scenario": rb"\A# Plays the experiment that `asrsim design` found",
    "learning state": rb"a\0\0\0s\0\0\0r\0\0\0s\0\0\0i\0\0\0m\0\0\0 \0\0\0l\0\0\0e\0\0\0a\0\0\0r\0\0\0n",
    "mjcf": rb"<!-- Made by asrsim export",
    "mesh": rb"\Aasrsim mesh",
    "twin": rb"\A# asrsim twin: ",
    "ranges": rb"\A# Ranges by asrsim export",
    "robot": rb"<!-- written by asrsim identify -->\n\Z",
    "fitted scenario": rb"\A# Scenario with the parameters that `asrsim identify` found",
    "fit file": rb"\A# Fit for `asrsim identify`",
    "schema": rb'"title": "asrsim scenario"',
}
"""Kind of file -> what is found at the start or the end of one that asrsim wrote, and in no other."""
_LOOKED_AT = 1 << 16
"""Bytes at the start and at the end of a file in which its mark stands."""


def is_ours(path: Path, kind: str) -> bool:
    """Whether asrsim wrote this file, as its mark proves. An empty file holds nothing that could be lost."""
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
    return not ends[0] or any(re.search(MARKS[kind], part, re.DOTALL) for part in ends)


def check_output(path: Path, kind: str, *, inputs: Iterable[Path] = (), replace: bool = False) -> None:
    """Whether a file of that kind may be written to `path`.

    inputs: files that the same command reads. replace: the user allows to replace any file but those.
    Raises OutputError where `path` is an input, a link or a folder, or a file that asrsim did not write.
    """
    for one in inputs:
        with suppress(OSError):
            if one.samefile(path):
                raise OutputError(f"{path}: is read by this command, and would be lost: choose another place to write to")
    if path.is_dir():
        raise OutputError(f"{path}: cannot be written: it is a folder")
    if is_special(path):
        return
    if path.is_symlink():
        raise OutputError(f"{path}: is a link: name the file that it leads to")
    if not replace and path.exists() and not is_ours(path, kind):
        raise OutputError(f"{path}: is there, and asrsim did not write it: take it away, or choose another place to write to")


def is_special(path: Path) -> bool:
    """A device or a pipe: written to as it is."""
    return path.exists() and not path.is_file() and not path.is_dir()


@contextmanager
def written(path: Path, kind: str, *, replace: bool = False) -> Iterator[BinaryIO]:
    """A file that takes the place of `path` in one move if the block ends without error; else all stays as it was.

    kind: of :data:`MARKS`; replace: as for :func:`check_output`, which raises OutputError first; so do disks that are full.
    """
    check_output(path, kind, replace=replace)
    if is_special(path):
        with _with_output_error(path), path.open("wb") as stream:
            yield stream
        return
    # A random name, and a file that must be new: no link or file that stands there is followed or overwritten.
    part = path.with_name(f".asrsim-{os.urandom(8).hex()}.part")
    try:
        with _with_output_error(path):
            with part.open("xb") as stream:
                yield stream
            part.replace(path)
    finally:
        with suppress(OSError):
            part.unlink()


@contextmanager
def _with_output_error(path: Path) -> Iterator[None]:
    """Errors of the operating system become OutputError, which names the file."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error


def write_text(path: Path, text: str, kind: str, *, replace: bool = False) -> None:
    """Write a UTF-8 file as :func:`written` does; its folder must exist. Raises OutputError."""
    with written(path, kind, replace=replace) as stream:
        stream.write(text.encode())


def csv_text(headings: Sequence[str], table: Array) -> str:
    """A table (rows, columns) as CSV whose numbers read back with the same bits: `repr` is the shortest such text."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(headings)
    writer.writerows(map(repr, row) for row in table.tolist())
    return text.getvalue()


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write plain data as a JSON document that says which asrsim wrote it. Raises OutputError."""
    from asrsim import __version__

    document = {"generator": f"asrsim {__version__}", **data}
    write_text(path, json.dumps(document, indent=2, ensure_ascii=False) + "\n", "json")


def remove_ours(path: Path, kind: str) -> None:
    """Take a file away if asrsim wrote it, as its mark proves. Raises OutputError."""
    if is_ours(path, kind):
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"{path}: cannot replace it: {error.strerror or error}") from error


def make_folder(folder: Path) -> Path:
    """The folder, made with those above it if it is not there. Raises OutputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        file = next((one for one in (folder, *folder.parents) if one.is_file()), None)
        why = f"{file} is a file" if file is not None else error.strerror or error
        raise OutputError(f"{folder}: cannot make the folder: {why}") from error
    return folder
