"""One column of a plain CSV file against time: header, comma, semicolon or tab, `#` comments, units in brackets."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np

from asrsim.errors import Problem, RecordingError, did_you_mean
from asrsim.signals.base import Array

TIME_NAMES = ("time", "t", "stamp", "timestamp", "seconds")
TO_SI = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0,
    "rad": 1.0, "deg": math.pi / 180.0, "°": math.pi / 180.0, "m": 1.0, "mm": 1e-3, "cm": 1e-2,
    "N": 1.0, "N m": 1.0, "Nm": 1.0, "N*m": 1.0, "mN m": 1e-3, "mNm": 1e-3, "1": 1.0, "-": 1.0, "": 1.0,
}  # fmt: skip
"""Factors of the units that a header may name in brackets."""

MAX_PROBLEMS = 10
_HEADER = re.compile(r"^(.*?)\s*[\[(]([^\])]*)[\])]\s*$")


def split_header(cell: str) -> tuple[str, str | None]:
    """Name and unit of a header such as `q1 [deg]`."""
    cell = cell.strip().strip('"').strip()
    found = _HEADER.match(cell)
    return (found[1], found[2].strip()) if found and found[1] else (cell, None)


def read_csv_series(path: Path, column: str, time_column: str | None) -> tuple[Array, Array]:
    """Times in s (ascending) and values (SI where the header names the unit) of a column.

    Raises RecordingError naming file, line and column of everything that is wrong: no header, no such column (the ones
    that there are), cells that are empty or no numbers, times that do not ascend.
    """
    header, header_line, rows = _rows(path)
    time_index = _time_index(path, header, header_line, time_column)
    index = _find(path, header, header_line, column, key="column")
    times: list[float] = []
    values: list[float] = []
    problems: list[Problem] = []
    previous = -math.inf
    for line, row in rows:
        stamp, number = (_cell(path, header, row, line, place, problems) for place in (time_index, index))
        if stamp is not None and stamp <= previous:
            message = f"time {stamp:g} does not ascend: {previous:g} stands before it"
            problems.append(Problem(message=message, file=path, line=line, key=header[time_index].strip(), code="csv-time"))
        if stamp is not None:
            previous = stamp
        if stamp is not None and number is not None:
            times.append(stamp)
            values.append(number)
        if len(problems) > MAX_PROBLEMS:
            problems.append(Problem(message="and possibly more like these", file=path, code="csv-cell"))
            break
    if problems:
        raise RecordingError(problems)
    if not times:
        raise RecordingError(Problem(message="has a header but no rows", file=path, code="empty"))
    return (
        np.array(times) * _factor(path, header[time_index], header_line),
        np.array(values) * _factor(path, header[index], header_line),
    )


def _cell(path: Path, header: list[str], row: list[str], line: int, place: int, problems: list[Problem]) -> float | None:
    """A finite number, or None with the problem noted."""
    text = row[place].strip() if place < len(row) else ""
    try:
        number = float(text)
        what = "is not finite"
    except ValueError:
        number = math.nan
        what = "is not a number" if text else "the cell is empty"
    if math.isfinite(number):
        return number
    name, _ = split_header(header[place])
    problems.append(Problem(message=what, file=path, line=line, key=name, value=text or None, code="csv-cell"))
    return None


def _rows(path: Path) -> tuple[list[str], int, list[tuple[int, list[str]]]]:
    """Header, its line, and numbered rows."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise RecordingError(Problem(message="is no UTF-8 text", file=path, code="encoding")) from None
    except OSError as error:
        raise RecordingError(Problem(message=f"cannot be read: {error.strerror}", file=path, code="no-file")) from None
    lines = [
        (number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise RecordingError(Problem(message="is empty", file=path, code="empty"))
    header_line, header_text = lines[0]
    separator = max(",;\t", key=header_text.count)
    try:
        cells = list(csv.reader([line for _, line in lines], delimiter=separator, strict=False))
    except csv.Error as error:
        raise RecordingError(Problem(message=f"is no sound CSV: {error}", file=path, code="csv")) from None
    if len(cells) != len(lines):
        raise RecordingError(Problem(message="a quoted cell runs over several lines", file=path, code="csv"))
    header = cells[0]
    if all(_is_number(cell) for cell in header):
        message = "has no header: its first line must name the columns"
        raise RecordingError(Problem(message=message, file=path, line=header_line, value=header_text[:60], code="csv-header"))
    return header, header_line, [(number, row) for (number, _), row in zip(lines[1:], cells[1:], strict=True)]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _find(path: Path, header: list[str], line: int, wanted: str, *, key: str) -> int:
    """Index of a column by its header, whole or without its unit."""
    names = [split_header(cell)[0] for cell in header]
    for options in ([cell.strip() for cell in header], names):
        if options.count(wanted) == 1:
            return options.index(wanted)
        if wanted in options:
            raise RecordingError(Problem(message=f"several columns are called '{wanted}'", file=path, line=line, key=key))
    raise RecordingError(
        Problem(
            message=f"there is no column '{wanted}'",
            file=path,
            line=line,
            key=key,
            choices=tuple(names),
            hint=did_you_mean(wanted, names),
            code="no-column",
        )
    )


def _time_index(path: Path, header: list[str], line: int, wanted: str | None) -> int:
    if wanted is not None:
        return _find(path, header, line, wanted, key="time")
    names = [split_header(cell)[0].lower() for cell in header]
    for name in TIME_NAMES:
        if name in names:
            return names.index(name)
    raise RecordingError(
        Problem(
            message="no column is called time or t",
            file=path,
            line=line,
            choices=tuple(split_header(cell)[0] for cell in header),
            hint="Name the time's column with the key 'time'",
            code="no-column",
        )
    )


def _factor(path: Path, cell: str, line: int) -> float:
    name, unit = split_header(cell)
    if unit is None:
        return 1.0
    if unit not in TO_SI:
        message = f"the unit '{unit}' of column '{name}' is not known"
        hint = "Rename the header, and give the factor with the key 'scale' if one is needed"
        raise RecordingError(
            Problem(message=message, file=path, line=line, choices=tuple(u for u in TO_SI if u), hint=hint, code="unit")
        )
    return TO_SI[unit]
