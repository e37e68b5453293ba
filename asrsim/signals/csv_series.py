"""One column of a text table against time, for playback: read as any recording, but nothing missing is passed over."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asrsim.errors import Problem, RecordingError, did_you_mean, similar_file
from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.recordings.delimited import Table
    from asrsim.recordings.units import Unit

TIME_NAMES = ("time", "t", "stamp", "timestamp", "seconds")
MAX_PROBLEMS = 10
"""Rows of one kind of fault that are named."""


def read_csv_series(path: Path, column: str, time_column: str | None) -> tuple[Array, Array]:
    """Times in s (ascending) and values (SI where the header names the unit) of a column.

    column, time_column: header with or without its unit, or number from 1. Raises RecordingError naming file, line and
    column of everything that is wrong: no such column (the ones that there are), cells that are empty or no numbers, rows
    of another length, times that do not ascend.
    """
    table = _table(path)
    place = _find(path, table, column, "column")
    clock = _clock(path, table) if time_column is None else _find(path, table, time_column, "time")
    problems = [finding for finding in table.findings if finding.code in ("ragged-row", "repeated-header")]
    for index in dict.fromkeys((clock, place)):
        problems += _gaps(path, table, index)
    times = table.values[:, clock]
    finite = np.flatnonzero(np.isfinite(times))
    for bad in np.flatnonzero(np.diff(times[finite]) <= 0.0)[:MAX_PROBLEMS]:
        before, after = finite[bad], finite[bad + 1]
        message = f"time {times[after]:g} does not ascend: {times[before]:g} stands before it"
        line = int(table.lines[after])
        problems.append(Problem(message, file=path, line=line, key=table.layout.names[clock], code="csv-time"))
    if problems:
        raise RecordingError(problems)
    return times * _factor(table, clock), table.values[:, place] * _factor(table, place)


def series_names(path: Path) -> tuple[str, ...]:
    """Headers of all columns without their units. Raises RecordingError for a file that is no table, or no header of one."""
    table = _table(path)
    if table.layout.misfit:
        raise RecordingError(table.layout.misfit, file=path, line=table.layout.misfit_line, code="header-misfit")
    return _names(table)


def _table(path: Path) -> Table:
    try:
        return _read(path, path.stat().st_mtime_ns)
    except OSError as error:
        message = f"cannot be read: {error.strerror}"
        raise RecordingError(message, file=path, hint=similar_file(path), code="no-file") from None


# The columns of one file are asked for one after the other. The time of change keeps the cache honest.
@lru_cache(maxsize=1)
def _read(path: Path, _newest: int) -> Table:
    from asrsim.recordings.delimited import read_table

    return read_table(path)


def _unit(table: Table, index: int) -> Unit | None:
    from asrsim.recordings.units import find_unit, split_header

    row = table.layout.units[index]
    return find_unit(row) if row else split_header(table.layout.names[index])[1]


def _factor(table: Table, index: int) -> float:
    unit = None if index in table.layout.stamps else _unit(table, index)
    return 1.0 if unit is None else unit.factor


def _names(table: Table) -> tuple[str, ...]:
    from asrsim.recordings.units import split_header

    return tuple(split_header(name)[0] for name in table.layout.names)


def _find(path: Path, table: Table, wanted: str, key: str) -> int:
    from asrsim.recordings.names import find_column

    index = find_column(wanted, table.layout.names)
    if index is not None and index not in table.layout.text:
        return index
    message = f"there is no column '{wanted}'" if index is None else f"the column '{wanted}' holds no numbers"
    names = _names(table)
    line = table.layout.header_line
    hint = did_you_mean(wanted, names)
    raise RecordingError(message, file=path, line=line, key=key, choices=names, hint=hint, code="no-column")


def _clock(path: Path, table: Table) -> int:
    names = [name.lower() for name in _names(table)]
    for name in TIME_NAMES:
        if name in names:
            return names.index(name)
    if table.layout.stamps:
        return table.layout.stamps[0]
    raise RecordingError(
        "no column is called time or t",
        file=path,
        line=table.layout.header_line,
        choices=_names(table),
        hint="Name the time's column with the key 'time'",
        code="no-column",
    )


def _gaps(path: Path, table: Table, index: int) -> list[Problem]:
    bad = np.flatnonzero(~np.isfinite(table.values[:, index]))
    name = _names(table)[index]
    problems = [
        Problem("the cell is empty or no finite number", file=path, line=int(table.lines[row]), key=name, code="csv-cell")
        for row in bad[:MAX_PROBLEMS]
    ]
    if bad.size > MAX_PROBLEMS:
        message = f"and {bad.size - MAX_PROBLEMS} more such cells"
        problems.append(Problem(message, file=path, key=name, code="csv-cell"))
    return problems
