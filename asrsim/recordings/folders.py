"""Folders as recordings: a folder contains one file for each quantity or topic, and the files are joined by time."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path

from asrsim.errors import RecordingError, listed
from asrsim.recordings.data import Column, Content, RawColumn, RawTable

FOLDER = "folder"
"""Name of the format of a recording in several files."""
MOST_FILES = 64
"""Largest number of files that are joined into one recording."""


def joined(folder: Path, read: Callable[[Path], Content], suffixes: Collection[str]) -> Content:
    """Content of all files in a folder, with a table for each table of a file. Each column states the name of its file.

    Links and files of other kinds are not read. Raises RecordingError if the folder has no recordings, or too many.

    Args:
        folder: The folder.
        read: Function that reads one file.
        suffixes: File name endings of recordings.
    """
    files = [
        file
        for file in sorted(folder.iterdir())
        if file.suffix.lower() in suffixes and file.is_file() and not file.is_symlink() and not file.name.startswith(".")
    ]
    if not files:
        hint = f"Expected metadata.yaml (a ROS 2 bag), or a file for each quantity with one of {listed(sorted(suffixes), 8)}"
        raise RecordingError("is a folder without recordings", hint=hint, code="no-bag")
    if len(files) > MOST_FILES:
        message = f"has {len(files)} recordings; at most {MOST_FILES} are joined, one for each quantity"
        raise RecordingError(message, hint="Give the file of one recording", code="too-many-files")
    tables: list[RawTable] = []
    findings = []
    for file in files:
        try:
            content = read(file)
        except RecordingError as error:
            raise RecordingError(replace(problem, file=problem.file or file) for problem in error.problems) from None
        findings += [replace(problem, file=problem.file or file) for problem in content.findings]
        for table in content.tables:
            columns = tuple(replace(column, file=file.stem) for column in table.columns)
            tables.append(replace(table, name=f"{file.stem} {table.name}".strip(), columns=columns))
    return Content(tables=tuple(tables), format=FOLDER, findings=tuple(findings))


def require_one_time(tables: Sequence[RawTable]) -> None:
    """Raise RecordingError if tables of several files were not recorded at the same time, or if their clocks differ."""
    tables = [table for table in tables if table.columns and table.columns[0].file]
    dated = {bool(table.zero) for table in tables}
    if len(dated) > 1:
        with_date, without = (listed([t.name for t in tables if bool(t.zero) is dates], 4) for dates in (True, False))
        message = f"its files have two clocks: the times of {with_date} are dates, the times of {without} are not"
        raise RecordingError(message, hint="Give the files one by one, as separate recordings", code="two-clocks")
    if tables and max(table.time[0] for table in tables) >= min(table.time[-1] for table in tables):
        spans = listed([f"{table.name} from {table.time[0]:.6g} to {table.time[-1]:.6g} s" for table in tables], 4)
        message = f"its files were not recorded at the same time: {spans}"
        raise RecordingError(message, hint="Give the files one by one, as separate recordings", code="no-overlap")


def require_one_recording(raw: Sequence[RawColumn], columns: Sequence[Column]) -> None:
    """Raise RecordingError if two files contain the same quantity of a joint, since they are then probably two recordings."""
    owner: dict[str, RawColumn] = {}
    for one, column in zip(raw, columns, strict=True):
        first = owner.setdefault(column.meaning, one) if column.quantity and not column.given and one.file else one
        if first.file != one.file:
            message = f"'{first.name}' and '{one.name}' are both {column.meaning}: are these files two recordings?"
            hint = f"Give one of the files, or state what the column is: --map '{one.name}=JOINT.QUANTITY [unit]', or =ignore"
            raise RecordingError(message, hint=hint, code="two-recordings")
