"""Reads tables that are no text: workbooks by calamine, Parquet and Feather files by pyarrow."""

from __future__ import annotations

from collections import Counter
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
"""Entries of a list in a cell; longer ones are pictures or scans."""


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
