"""Tables that are no text, read as the text that they would be exported as: Excel workbooks, Parquet and Feather files."""

from __future__ import annotations

import csv
import re
import zipfile
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime, timedelta
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

from asrsim.errors import Problem, RecordingError, listed
from asrsim.extras import library
from asrsim.recordings.unpacked import check_archive, check_unpacked

Lines = tuple[bytes, tuple[Problem, ...]]
"""CSV in UTF-8, and what to know of it."""
SheetReader = Callable[[Path], Lines]
_LONGEST = 64
"""Entries of a list in a cell; longer ones are pictures or scans."""
ROWS, COLUMNS = 1_048_576, 16_384
"""Of a sheet, at most: who names a place beyond is no Excel, and would fill the memory with blank cells."""
_DAYS = range(14, 23), range(45, 48)
"""Excel's own number formats of dates and times."""
_NAMED = re.compile(r'"[^"]*"|\[(?!h+\]|m+\]|s+\])[^\]]*\]|\\.')
"""Parts of a number format that are no letters of a date: text, colours, currencies."""
_ZERO = datetime(1899, 12, 30)
"""Day 0 of Excel's count."""


def sheet_reader(path: Path) -> SheetReader | None:
    """What reads the file as text, by its first bytes; None where nothing here does."""
    with path.open("rb") as stream:
        start = stream.read(6)
    if start.startswith((b"PAR1", b"ARROW1")):
        return _columnar
    if start.startswith(b"PK\x03\x04") and zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            return _workbook if "xl/workbook.xml" in archive.namelist() else None
    return None


def _columnar(path: Path) -> Lines:
    """A Parquet or Feather file. Raises InputError without pyarrow, RecordingError for a broken file."""
    arrow = library("pyarrow", "sweep")
    from pyarrow import compute, feather, parquet
    from pyarrow import csv as writer

    try:
        with path.open("rb") as stream:
            tabled = stream.read(4) == b"PAR1"
        if tabled:
            about = parquet.read_metadata(path)
            groups = (about.row_group(i).total_byte_size for i in range(about.num_row_groups))
            check_unpacked(path, max(sum(groups), 8 * about.num_rows * about.num_columns))
        read = parquet.read_table if tabled else feather.read_table
        text = BytesIO()
        table, unread = _flat(read(path))
        for i, field in enumerate(table.schema):
            if arrow.types.is_duration(field.type):
                seconds = compute.divide(table.column(i).cast(arrow.duration("ns")).cast("int64").cast("float64"), 1e9)
                name = "time" if field.name.startswith("__index") else field.name
                table = table.set_column(i, f"{name} [s]", seconds)
        writer.write_csv(table, text)
    except (OSError, ValueError, arrow.ArrowException) as error:
        raise RecordingError(f"cannot be read: {str(error).splitlines()[0]}", file=path, code="bad-sheet") from None
    message = f"lists of more than {_LONGEST} numbers, or of more and less of them, are not read"
    return text.getvalue(), (Problem(message, file=path, key=listed(unread, 8), code="text-column"),) if unread else ()


def _flat(table: Any) -> tuple[Any, list[str]]:
    """A table without lists and records: a column for each of their entries; and lists that are none of signals."""
    from pyarrow import compute, types

    unread: list[str] = []
    while any(types.is_struct(kind) for kind in table.schema.types):
        table = table.flatten()
    for name in table.column_names:
        column = table.column(name)
        kind = column.type
        if not (types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)):
            continue
        lengths = compute.min_max(compute.list_value_length(column)).as_py()
        place = table.column_names.index(name)
        table = table.remove_column(place)
        if lengths["min"] == lengths["max"] and 0 < lengths["max"] <= _LONGEST and not types.is_nested(kind.value_type):
            for i in range(lengths["max"]):
                table = table.add_column(place + i, f"{name}[{i}]", compute.list_element(column, i))
        else:
            unread.append(name)
    return table, unread


def _workbook(path: Path) -> Lines:
    """The first sheet of an Excel workbook with two rows of numbers. Raises RecordingError where there is none."""
    from lxml.etree import LxmlError

    try:
        check_archive(path)
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            shared = ["".join(one.itertext("{*}t")) for one in _parts(archive, "xl/sharedStrings.xml", "si")]
            timed = _timed(archive)
            sheets = sorted((name for name in names if re.fullmatch(r"xl/worksheets/sheet\d+\.xml", name)), key=_number)
            tables = {name: list(_rows(archive, name, shared, timed)) for name in sheets}
    except (OSError, KeyError, ValueError, IndexError, zipfile.BadZipFile, LxmlError) as error:
        raise RecordingError(f"cannot be read as a workbook: {error}", file=path, code="bad-sheet") from None
    full = [name for name, rows in tables.items() if sum(any(map(_is_number, row)) for row in rows) > 1]
    if not full:
        raise RecordingError("has no sheet with rows of numbers", file=path, code="no-numbers")
    # Blank cells at a row's end are not in the file; a title in one cell is no row of the table.
    width = max(map(len, tables[full[0]]))
    tabled = ((row, any(map(_is_number, row)) or sum(map(bool, row)) > 1) for row in tables[full[0]])
    filled = (row + [""] * (width - len(row)) if whole else row for row, whole in tabled)
    text = "".join(map(_line, filled))
    message = f"has {len(full)} sheets with numbers, of which the first is read"
    return text.encode(), (Problem(message, file=path, code="several-sheets"),) if len(full) > 1 else ()


def _line(row: Sequence[str]) -> str:
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerow([" ".join(cell.split()) for cell in row])
    return text.getvalue()


def _number(name: str) -> int:
    return int(re.sub(r"\D", "", name))


def _is_number(cell: str) -> bool:
    return re.fullmatch(r"[-+]?\d*[.,]?\d+([eE][-+]?\d+)?", cell) is not None


def _parts(archive: zipfile.ZipFile, name: str, tag: str) -> Iterator[Any]:
    """Elements of a part of the workbook, each forgotten after its turn; none where there is no such part."""
    from lxml.etree import iterparse

    if name not in archive.namelist():
        return
    with archive.open(name) as stream:
        for _, element in iterparse(stream, tag=f"{{*}}{tag}", resolve_entities=False):
            yield element
            element.clear()


def _timed(archive: zipfile.ZipFile) -> list[bool]:
    """Of each style of cells, whether its numbers are days: by Excel's own formats of dates, or one with letters of dates."""
    styles = "xl/styles.xml"
    codes = {int(one.get("numFmtId")): one.get("formatCode", "") for one in _parts(archive, styles, "numFmt")}
    forms = [int(one.get("numFmtId", 0)) for table in _parts(archive, styles, "cellXfs") for one in table]
    return [
        any(form in days for days in _DAYS) or re.search("[dhmsy]", _NAMED.sub("", codes.get(form, "")).lower()) is not None
        for form in forms
    ]


def _rows(archive: zipfile.ZipFile, name: str, shared: Sequence[str], timed: Sequence[bool]) -> Iterator[list[str]]:
    """Rows of cells as text, blank ones where the sheet has none, so that lines are its rows."""
    last = 0
    for row in _parts(archive, name, "row"):
        number = int(row.get("r", last + 1))
        if number > ROWS:
            raise ValueError(f"row {number} is none of a sheet")
        yield from ([] for _ in range(number - last - 1))
        last, cells = number, list[str]()
        for cell in row:
            place = _column(cell.get("r", "")) or len(cells) + 1
            if place > COLUMNS:
                raise ValueError(f"column {place} is none of a sheet")
            cells += [""] * (place - 1 - len(cells))
            cells.append(_text(cell, shared, timed))
        yield cells


def _column(place: str) -> int:
    """27 of `AA3`."""
    count = 0
    for letter in re.sub(r"[^A-Z]", "", place):
        count = 26 * count + ord(letter) - ord("A") + 1
    return count


def _text(cell: Any, shared: Sequence[str], timed: Sequence[bool]) -> str:
    kind = cell.get("t", "n")
    if kind == "inlineStr":
        return "".join(cell.itertext("{*}t"))
    value = cell.findtext("{*}v") or ""
    if kind == "s":
        return shared[int(value)]
    style = int(cell.get("s", 0))
    if kind == "n" and value and style < len(timed) and timed[style]:
        days = float(value)
        moment = _ZERO + timedelta(seconds=round(days * 86400, 6))
        return moment.isoformat(timespec="microseconds") if days >= 1.0 else f"{moment:%H:%M:%S.%f}"
    return value
