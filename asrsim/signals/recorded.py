"""Reads a series of a recording for playback. Missing values, which other uses of recordings skip, are errors here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asrsim.errors import Problem, RecordingError
from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.recordings.data import Content, RawColumn, RawTable
    from asrsim.recordings.reading import Reading

MAX_PROBLEMS = 10
"""Largest number of rows that are listed for one kind of fault."""


def read_column(path: Path, column: str, time_column: str | None) -> tuple[Array, Array]:
    """Ascending times in s and values of a column, in SI units where the header or a document states the unit.

    Args:
        path: The recording.
        column: Header of the column with or without unit, or its number from 1; for messages `/topic/field`.
        time_column: Time column in the same form, or `header` for the stamps in messages; None: found by name.

    Raises:
        RecordingError: The column is missing, cells are empty or not numbers, rows have another length, or times do not
            ascend. Each problem states file, line and column.
    """
    from asrsim.recordings.data import RawSeries
    from asrsim.recordings.names import find_raw
    from asrsim.recordings.read import in_si

    content, reading = _read(path, time_column, *_newest(path))
    table = next((one for one in content.tables if find_raw(column, one.columns) is not None), None)
    if table is None:
        raise _no_column(path, [one for each in content.tables for one in each.columns], column, "column")
    values = table.columns[find_raw(column, table.columns) or 0]
    seconds, clocks = _times(path, table, reading)
    problems = [finding for finding in content.findings if finding.line is not None and finding.key is None]  # skipped rows
    for one in dict.fromkeys((*clocks, values)):
        problems += _gaps(path, table, one)
    kept = np.isfinite(seconds)
    if table.name:  # of messages with equal stamps, the last is used, as a receiver that polls would do
        kept[:-1] &= np.diff(seconds) != 0.0
    finite = np.flatnonzero(kept)
    for bad in np.flatnonzero(np.diff(seconds[finite]) <= 0.0)[:MAX_PROBLEMS]:
        before, after = finite[bad], finite[bad + 1]
        message = f"time {seconds[after]:.9g} follows {seconds[before]:.9g}, but times must ascend"
        name = table.name or (clocks[0].name if clocks else None)
        problems.append(Problem(message, file=path, line=_line(table, after), key=name, code="csv-time"))
    if problems:
        raise RecordingError(problems)
    stated = next(
        (one for one in reading.maps if find_raw(one.column, [values]) is not None and not one.column.isdecimal()), None
    )
    return seconds[kept], in_si(RawSeries(column=values, time=seconds, values=values.values), stated).values[kept]


def series_names(path: Path) -> tuple[str, ...]:
    """Headers of all columns without units. Raises RecordingError for a file without a table."""
    from asrsim.recordings.units import split_header

    content, _ = _read(path, None, *_newest(path))
    return tuple(split_header(column.name)[0] for table in content.tables for column in table.columns)


def _newest(path: Path) -> tuple[int, int]:
    """Modification times of the file and of the document beside it, ns: keys of the cache, so that changes are noticed."""
    from asrsim.recordings.reading import reading_file

    beside = reading_file(path)
    return path.stat().st_mtime_ns if path.exists() else 0, beside.stat().st_mtime_ns if beside else 0


# Cached, as a scenario often plays several columns of one file.
@lru_cache(maxsize=2)
def _read(path: Path, time_column: str | None, _file: int, _document: int) -> tuple[Content, Reading]:
    from asrsim.recordings.formats import content_of
    from asrsim.recordings.reading import TimeKeys, resolve_reading

    reading = resolve_reading(None, path)
    if time_column is not None:
        reading = replace(reading, time=TimeKeys(column=time_column))
    return content_of(path, reading), reading


def _times(path: Path, table: RawTable, reading: Reading) -> tuple[Array, list[RawColumn]]:
    """Times in s, and the columns whose sum they are: the stated columns, else the first with the name of a time."""
    from asrsim.recordings.names import find_raw
    from asrsim.recordings.times import is_named_time, unit_of_time

    if reading.time.rate is not None:
        return np.arange(len(table.columns[0].values)) / reading.time.rate, []
    clocks: list[RawColumn] = []
    for name in reading.time.columns:
        place = find_raw(name, table.columns)
        if place is None:
            raise _no_column(path, table.columns, name, "time")
        clocks.append(table.columns[place])
    clocks = clocks or [column for column in table.columns if is_named_time(column)][:1]
    if not clocks:
        names = tuple(column.name for column in table.columns)
        hint = "Name the time column with the key 'time'"
        raise RecordingError("no column is called time or t", file=path, choices=names, hint=hint, code="no-column")
    parts: list[Array] = []
    for clock in clocks:
        unit = unit_of_time(clock)
        zero = clock.zero * 1e-9 if table.name and clock.zero else 0.0
        parts.append(zero + clock.values * (reading.time.factor or (1.0 if unit is None else unit.factor)))
    return np.sum(parts, axis=0), clocks


def _no_column(path: Path, columns: Sequence[RawColumn], wanted: str, key: str) -> RecordingError:
    from asrsim.recordings.units import split_header

    names = tuple(split_header(column.name)[0] for column in columns)
    message = f"there is no numeric column '{wanted}'"
    return RecordingError(message, file=path, key=key, choices=names, meant=wanted, code="no-column")


def _line(table: RawTable, row: int) -> int | None:
    return None if table.lines is None else int(table.lines[row])


def _gaps(path: Path, table: RawTable, column: RawColumn) -> list[Problem]:
    bad = np.flatnonzero(~np.isfinite(column.values))
    problems = [
        Problem("the cell must contain a finite number", file=path, line=_line(table, row), key=column.name, code="csv-cell")
        for row in bad[:MAX_PROBLEMS]
    ]
    if bad.size > MAX_PROBLEMS:
        message = f"and {bad.size - MAX_PROBLEMS} more such cells"
        problems.append(Problem(message, file=path, key=column.name, code="csv-cell"))
    return problems
