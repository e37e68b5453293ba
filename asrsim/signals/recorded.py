"""Reads one series of a recording for playback. Missing values, which other uses of recordings skip, are errors in a
playback."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asrsim.errors import Problem, RecordingError
from asrsim.quantities import linear_unit
from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.recordings.data import Column, Content, RawColumn, Recording

_FAULTS = ("ragged-row", "bad-time", "falling-time", "repeated-time")
"""Codes of findings that report samples which the reading of a recording has removed."""


def read_column(path: Path, column: str) -> tuple[Array, Array, float, tuple[str, ...]]:
    """Strictly increasing times (n,) in s and values (n,) of a column, the earliest time of all columns in the file in s, and
    the SI units that the column may have; no unit if neither the file nor the column's name states a unit.

    Values are in SI units where the header or a document states the unit. If only some columns of the file have
    dates, the earliest time is taken from the columns with dates if this column has dates, and otherwise from the columns
    without dates.

    Args:
        path: Path of the recording.
        column: Header of the column with or without unit, or its number from 1; for messages `/topic/field`.

    Raises:
        RecordingError: The column is missing, cells are empty or not numbers, rows have another length, or times do not
            increase. Each problem states file, line and column.
    """
    from asrsim.recordings.data import LARGEST
    from asrsim.recordings.names import find_raw

    content, recording = _read(path)
    columns = [(table, raw) for table in content.tables for raw in table.columns]
    place = find_raw(column, [raw for _, raw in columns])
    table = None if place is None else columns[place][0]
    if table is None:
        unread = [one for one in content.findings if one.code == "unread"]
        message, choices = f"there is no numeric column '{column}'", series_names(path)
        raise RecordingError(
            [Problem(message, file=path, key="column", choices=choices, meant=column, code="no-such-column"), *unread]
        )
    found = recording.channels[columns[place or 0][1].name]
    # Accept repeated times in a bag, since the first message at each time is played. Ignore findings about other topics of the
    # bag.
    faults = _FAULTS[:3] if table.name else _FAULTS
    problems = [one for one in content.findings if one.code in faults and (not table.name or one.key == table.name)]
    bad = np.flatnonzero(~np.isfinite(found.values))
    if len(bad):
        message = f"cells must contain numbers up to {LARGEST:g}, unlike {table.places(bad)}"
        problems.append(Problem(message, file=path, line=table.line(bad[0]), key=found.source, code="missing-numbers"))
    if problems:
        raise RecordingError(problems)
    # Times with a date and times without a date cannot be compared.
    earliest = min(float(one.time[0]) for one in content.tables if bool(one.zero) is bool(table.zero))
    return found.time, found.values, earliest, _units_of(columns[place or 0][1], found)


def _units_of(raw: RawColumn, column: Column) -> tuple[str, ...]:
    """SI units that a column may have, with "1" for a pure number, or the unknown unit in its header. If only the column's
    quantity is known, its joint may be revolute or prismatic."""
    from asrsim.recordings.units import unread_unit

    if column.stated:
        return (column.unit or "1",)
    if raw.joint is None and (unread := unread_unit(raw.header)):
        return (unread,)
    return (column.unit, linear_unit(column.unit)) if column.quantity and column.unit else ()


def series_names(path: Path) -> tuple[str, ...]:
    """Headers of all columns except the time, without units. Raises RecordingError for a file without a table."""
    from asrsim.recordings.units import split_header

    content, _ = _read(path)
    return tuple(split_header(column.name)[0] for table in content.tables for column in table.columns)


def _read(path: Path) -> tuple[Content, Recording]:
    from asrsim.recordings.read import read_cached
    from asrsim.recordings.reading import modified

    return read_cached(path, modified(path), in_seconds=True)
