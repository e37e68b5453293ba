"""Reads tables that are no text: JSON, workbooks by calamine, Parquet and Feather files by pyarrow."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import Problem, RecordingError, listed
from asrsim.extras import library
from asrsim.recordings.data import Content, RawColumn, RawTable
from asrsim.recordings.reading import Reading
from asrsim.recordings.text import read_cells

_LONGEST = 64
"""Entries of a list in a record or cell; longer ones are pictures or scans."""
_START = re.compile(rb"\s*(?:\xef\xbb\xbf)?\s*(?:\{|\[\s*(?:\{|\[\s*[\[{\"\-\d]))")


def is_json(path: Path) -> bool:
    """Whether a file begins as JSON does: with an object, or a list of objects or lists."""
    with path.open("rb") as stream:
        return _START.match(stream.read(4096)) is not None


def read_json(path: Path, reading: Reading) -> Content:
    """The table of a JSON file. Raises RecordingError where it is no JSON, or holds no records."""
    text = path.read_text(encoding=reading.encoding or "utf-8-sig", errors="replace")
    units: Mapping[str, Any] = {}
    try:
        data = json.loads(text)
        records = _records(data)
        if isinstance(data, Mapping) and isinstance(told := data.get("units"), Mapping):
            units = told
    except (ValueError, RecursionError) as error:
        records = _of_lines(text, error)
    if len(records) < 2:
        raise RecordingError(
            f"is JSON with {len(records)} records; at least 2 are needed", code="no-numbers",
            hint="Expected records with a time and signals: one a line, a list of them, or lists by name",
        )  # fmt: skip
    labels = list(dict.fromkeys(label for record in records for label in record))
    header = [f"{label} [{units[label]}]" if label in units else label for label in labels]
    return read_cells("json", [header, *([record.get(label, "") for label in labels] for record in records)], reading)


def _of_lines(text: str, whole: Exception) -> list[dict[str, str]]:
    """Records of lines; the last one of a log that was cut off may be none."""
    records: list[dict[str, str]] = []
    lines = [line.strip().rstrip(",") for line in text.splitlines() if line.strip()]
    for count, line in enumerate(lines, start=1):
        try:
            records.append(dict(_flat(json.loads(line), "")))
        except (ValueError, RecursionError):
            if count < len(lines) or len(lines) < 3:
                line_number = getattr(whole, "lineno", None)
                raise RecordingError(f"cannot be read as JSON: {whole}", line=line_number, code="bad-json") from None
    return records


def _records(data: Any) -> list[dict[str, str]]:
    """Records of a whole document: a list of them, its longest list of objects, or its lists by name."""
    if isinstance(data, Mapping) and isinstance(names := data.get("columns"), list) and isinstance(data.get("data"), list):
        data = [dict(zip(map(str, names), row, strict=False)) for row in data["data"]]
    lists = dict(_lists(data, "")) if isinstance(data, Mapping) else {"": data} if isinstance(data, list) else {}
    tables = [one for name, one in lists.items() if one and (isinstance(one[0], Mapping) or not name)]
    if tables:
        return [dict(_flat(one, "")) for one in max(tables, key=len)]
    length = max((len(one) for one in lists.values()), default=0)
    columns = {name: one for name, one in lists.items() if len(one) == length > 1}
    return [dict(_flat({name: one[i] for name, one in columns.items()}, "")) for i in range(length if columns else 0)]


def _lists(data: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, list[Any]]]:
    """Lists by their path."""
    for key, value in data.items():
        if isinstance(value, Mapping):
            yield from _lists(value, f"{prefix}{key}.")
        elif isinstance(value, list):
            yield f"{prefix}{key}", value


def _flat(data: Any, prefix: str) -> Iterator[tuple[str, str]]:
    """A record's numbers and words by their path: `header.stamp.sec`, `position[0]`."""
    if isinstance(data, Mapping):
        for key, value in data.items():
            yield from _flat(value, f"{prefix}.{key}" if prefix else str(key))
    elif isinstance(data, list):
        for i, value in enumerate(data if len(data) <= _LONGEST else ()):
            yield from _flat(value, f"{prefix}[{i}]" if prefix else f"column_{i + 1}")
    else:
        yield prefix, "" if data is None else str(int(data)) if isinstance(data, bool) else str(data)


def read_excel(path: Path, reading: Reading) -> Content:
    """The sheet that is named, else the first of a workbook with two rows of numbers. Raises RecordingError without one."""
    from python_calamine import CalamineWorkbook

    book = CalamineWorkbook.from_path(path)
    if reading.sheet is not None and reading.sheet not in book.sheet_names:
        raise RecordingError("there is no such sheet", key=reading.sheet, choices=tuple(book.sheet_names), meant=reading.sheet)
    names = book.sheet_names if reading.sheet is None else [reading.sheet]
    tables = {name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in names}
    full = [name for name, rows in tables.items() if sum(any(isinstance(cell, float) for cell in row) for row in rows) > 1]
    if not full:
        raise RecordingError("has no sheet with rows of numbers", code="no-numbers")
    # A title in one cell is no row of the table.
    rows = [row if sum(cell != "" for cell in row) > 1 else [] for row in tables[full[0]]]
    found = read_cells("excel", [[_text(cell) for cell in row] for row in rows], reading)
    found = replace(found, layout={"sheet": full[0]})
    if len(full) == 1:
        return found
    message = f"has {len(full)} sheets with numbers, of which the first is read: {listed(full, 6)}"
    note = Problem(message, code="several-sheets", hint="State another in the document beside it: `sheet:`")
    return replace(found, findings=(note, *found.findings))


def _text(cell: Any) -> str:
    if isinstance(cell, timedelta):
        return f"{cell.total_seconds():.9f}"
    if isinstance(cell, date | datetime | time):
        return cell.isoformat()
    return " ".join(str(cell).split()) if not isinstance(cell, bool) else str(int(cell))


def read_arrow(path: Path, reading: Reading) -> Content:
    """A Parquet or Feather file: a column for each number, also of records and of short lists."""
    arrow = library("pyarrow", "sweep")
    from pyarrow import compute, feather, parquet, types

    with path.open("rb") as stream:
        table = (parquet.read_table if stream.read(4) == b"PAR1" else feather.read_table)(path)
    while any(types.is_struct(kind) for kind in table.schema.types):
        table = table.flatten()
    columns: list[RawColumn] = []
    unread: list[str] = []
    for name in table.column_names:
        column = table.column(name)
        kind = column.type
        if types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
            lengths = compute.min_max(compute.list_value_length(column)).as_py()
            flat = lengths["min"] == lengths["max"] and 0 < lengths["max"] <= _LONGEST and not types.is_nested(kind.value_type)
            parts = {f"{name}[{i}]": compute.list_element(column, i) for i in range(lengths["max"])} if flat else {}
        else:
            parts = {name: column}
        for label, part in parts.items():
            if types.is_temporal(part.type):
                instants = part.cast(arrow.int64()) if not types.is_date(part.type) else part.cast(arrow.timestamp("ns"))
                unit = {"s": 1e9, "ms": 1e6, "us": 1e3}.get(getattr(part.type, "unit", "ns"), 1.0)
                ns = instants.cast(arrow.int64()).to_numpy().astype(np.int64) * int(unit)
                zero = None if types.is_duration(part.type) else int(ns[0])
                label = "time" if label.startswith("__index") else label
                stated = "s" if zero is None else ""
                columns.append(RawColumn(name=label, values=(ns - (zero or 0)) * 1e-9, zero=zero, unit=stated))
            elif types.is_integer(part.type) or types.is_floating(part.type) or types.is_boolean(part.type):
                columns.append(RawColumn(name=label, values=part.cast(arrow.float64()).to_numpy().astype(float)))
            else:
                unread.append(label)
        unread += [] if parts else [name]
    if not columns or table.num_rows < 2:
        raise RecordingError("has no columns of numbers", code="no-numbers")
    note = Problem(f"text and lists of more than {_LONGEST} numbers are not read", key=listed(unread, 8), code="text-column")
    repeated = [name for name, count in Counter(column.name for column in columns).items() if count > 1]
    if repeated:
        raise RecordingError("names repeat", key=listed(repeated, 6), code="repeated-header")
    return Content(format="arrow", tables=(RawTable(columns=tuple(columns)),), findings=(note,) if unread else ())
