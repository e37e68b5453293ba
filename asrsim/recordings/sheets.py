"""Reads JSON files and workbooks as rows of cells."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import date, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import Problem, RecordingError, listed
from asrsim.recordings.arrays import of_tree
from asrsim.recordings.bags import LONGEST, NAMES
from asrsim.recordings.data import Content
from asrsim.recordings.reading import Reading
from asrsim.recordings.text import read_cells

MOST_CELLS = 10_000_000
"""Largest number of cells of a workbook. A small file may encode billions of cells as a few repeated cells."""


def read_json(path: Path, reading: Reading) -> Content:
    """Tables of a JSON file. The file contains one record per line, a list of records (directly or in an object), or an object
    with lists of numbers.

    Raises RecordingError if the file is not JSON or contains no records.
    """
    text = path.read_text(encoding=reading.encoding or "utf-8-sig", errors="replace")
    try:
        return _content(_loaded(text), reading)
    except RecursionError as error:
        raise RecordingError(f"cannot be read as JSON: {error}", code="bad-json") from None


def _content(data: Any, reading: Reading) -> Content:
    """Content from JSON data. Raises RecordingError if the data contain neither records nor arrays."""
    if isinstance(data, dict):
        lists = [one for one in data.values() if isinstance(one, list) and one and isinstance(one[0], dict)]
        if not lists:
            return of_tree(_arrays(data), [], reading)
        data = lists[0]
    records = [dict(_flat(one, "")) for one in data] if isinstance(data, list) else []
    if len(records) < 2:
        raise RecordingError(
            f"is JSON with {len(records)} records; at least 2 are needed",
            code="no-numbers",
            hint="Expected records with a time and signals: one per line, a list of records, or an object of lists",
        )
    labels = list(dict.fromkeys(label for record in records for label in record))
    return read_cells([labels, *([record.get(label, "") for label in labels] for record in records)], reading)


def _arrays(data: Any) -> Any:
    """JSON data, in which arrays replace lists of numbers, and NaN replaces null. Text and lists of unequal length become
    None.
    """
    if isinstance(data, dict):
        return {name: _arrays(one) for name, one in data.items()}
    try:
        return np.array(data, dtype=float)
    except (ValueError, TypeError, OverflowError):
        return None


def _loaded(text: str) -> Any:
    """Data of a JSON text, or records of a text with one record per line. An incomplete last line is ignored, since the file
    may have been truncated.
    """
    try:
        return json.loads(text)
    except ValueError as error:
        *lines, last = [line for line in text.splitlines() if line.strip()] or [text]
        try:
            records = [json.loads(line) for line in lines or [last]]
        except ValueError:
            line = getattr(error, "lineno", None)
            raise RecordingError(f"cannot be read as JSON: {error}", line=line, code="bad-json") from None
        with suppress(ValueError):
            records.append(json.loads(last))
        return records


def _flat(data: Any, prefix: str, around: Sequence[Any] = ()) -> Iterator[tuple[str, str]]:
    """Paths and values of all numbers and texts in a record. Examples of paths are `header.stamp.sec` and `position[0]`.

    around: names of list entries, from the enclosing record.
    """
    if isinstance(data, dict):
        start = f"{prefix}." if prefix else ""
        names: Sequence[Any] = next((data[key] for key in NAMES if isinstance(data.get(key), list)), around)
        for key, value in data.items():
            if isinstance(value, list) and 0 < len(value) == len(names) <= LONGEST and value is not names:
                for name, item in zip(names, value, strict=True):
                    yield from _flat(item, f"{start}{name}.{key}")
            else:
                yield from _flat(value, f"{start}{key}", names)
    elif isinstance(data, list):
        for i, value in enumerate(data if len(data) <= LONGEST else ()):
            yield from _flat(value, f"{prefix}[{i}]", around)
    else:
        yield prefix, "" if data is None else str(int(data)) if isinstance(data, bool) else str(data)


def read_excel(path: Path, reading: Reading) -> Content:
    """Content of the sheet that `reading` names or, if it names no sheet, of the first sheet with two rows of numbers. Raises
    RecordingError.
    """
    from python_calamine import CalamineWorkbook

    book = CalamineWorkbook.from_path(path)
    if reading.sheet is not None and reading.sheet not in book.sheet_names:
        choices = tuple(book.sheet_names)
        raise RecordingError(
            "there is no such sheet", key=reading.sheet, choices=choices, meant=reading.sheet, code="no-such-sheet"
        )
    names = book.sheet_names if reading.sheet is None else [reading.sheet]
    cells = sum(sheet.total_height * sheet.total_width for sheet in map(book.get_sheet_by_name, names))
    if cells > MOST_CELLS:
        raise RecordingError(f"has {cells} cells; at most {MOST_CELLS:g} are read", code="too-many-cells")
    tables = {name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in names}
    full = [name for name, rows in tables.items() if sum(any(isinstance(cell, float) for cell in row) for row in rows) > 1]
    if not full:
        raise RecordingError("has no sheet with rows of numbers", code="no-numbers")
    # Empty the rows with a single filled cell, since such a row is a title and not part of the table.
    rows = [row if sum(cell != "" for cell in row) > 1 else [] for row in tables[full[0]]]
    found = read_cells([[_text(cell) for cell in row] for row in rows], reading)
    if len(full) == 1:
        return found
    message = f"has {len(full)} sheets with numbers: {listed(full, 6)}; the first is read"
    note = Problem(message, code="several-sheets", hint="Name another sheet under `sheet` in the document beside the file")
    return replace(found, findings=(note, *found.findings))


def _text(cell: Any) -> str:
    if isinstance(cell, timedelta):
        return f"{cell.total_seconds():.9f}"
    if isinstance(cell, date | time):
        return cell.isoformat()
    return " ".join(str(cell).split()) if not isinstance(cell, bool) else str(int(cell))
