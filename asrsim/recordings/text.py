"""Reads delimited text and cells of sheets. The first lines decide the layout; then the columns are converted in blocks."""

from __future__ import annotations

import csv
import itertools
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from asrsim.errors import Problem, RecordingError, counted, listed, printable
from asrsim.recordings.data import Content, RawColumn, RawTable
from asrsim.recordings.reading import SEPARATORS, Reading
from asrsim.samples import Array

COMMENTS = ("#", "%", "//")
MISSING = {"", "nan", "na", "n/a", "null", "none", "-nan", "#n/a", "-", "--"}
"""Cells that mean "no value"."""
_EPOCH, _MICROSECOND = datetime(1970, 1, 1, tzinfo=UTC), timedelta(microseconds=1)
_SAMPLE = 200
"""Number of lines at the start of a file that decide its layout."""
_BLOCK = 1000
"""Lines that are read at a time. Larger blocks are slower, as Python's garbage collector visits the rows of a block often."""
Row = tuple[int, list[str]]
"""Line number and cells of a row."""


def split(line: str, separator: str | None) -> list[str]:
    """Cells of a line without surrounding blanks and quotes. separator: None for runs of blanks."""
    if " " not in line and '"' not in line:  # most files: no cell needs more work
        return line.split(separator)
    if separator is not None and '"' in line and len(line) < csv.field_size_limit():
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    return [cell.strip(' "') for cell in line.split(separator)]


def number(cell: str, decimal: str) -> float | None:
    """Number in the cell; NaN for a missing value, None for text."""
    try:
        return float(cell.replace(",", ".") if decimal == "," else cell) if "_" not in cell else None
    except ValueError:
        return float("nan") if cell.lower() in MISSING else None


def stamp_ns(cell: str) -> int | None:
    """Unix time in ns of an ISO 8601 date (UTC by default), or ns since midnight for a time of day; None for other text."""
    for text in (cell, f"1970-01-01T{cell}"):
        with suppress(ValueError):
            moment = datetime.fromisoformat(text)
            return ((moment if moment.tzinfo else moment.replace(tzinfo=UTC)) - _EPOCH) // _MICROSECOND * 1000
    return None


def kind_of(cell: str, decimal: str) -> str:
    """Kind of a cell: `missing`, `number`, `stamp` (a date or time) or `text`."""
    if cell.lower() in MISSING:
        return "missing"
    return "number" if number(cell, decimal) is not None else "stamp" if stamp_ns(cell) is not None else "text"


def share_of_values(cells: Sequence[str], decimal: str) -> float:
    """Fraction of cells that are numbers, dates or missing; 0 if all cells are missing."""
    kinds = [kind_of(cell, decimal) for cell in cells]
    return 1.0 - kinds.count("text") / len(kinds) if {*kinds} != {"missing"} else 0.0


@dataclass(kw_only=True)
class CellColumn:
    """Column of cells, which are converted to numbers block by block."""

    name: str
    kind: str
    """Kind of the cells: number, stamp, text, or joint for the joints' names, which stay text in `blocks`."""
    zero: int | None = None
    """First date or time of day in the column, ns."""
    blocks: list[Array] = field(default_factory=list)
    faults: list[int] = field(default_factory=list)
    """Lines of the cells that are not numbers."""
    example: str = ""
    """First cell that is not a number."""

    def add(self, cells: Sequence[str], lines: Sequence[int], decimal: str) -> None:
        """Convert cells; text becomes NaN and is reported with its line."""
        # Python reads 1_000 as a number, but no instrument writes numbers like this.
        plain = self.kind == "number" and "_" not in "".join(cells)
        try:
            values = [*map(float, cells)] if plain else []
        except ValueError:
            values = []
        values = values or [self._value(cell, line, decimal) for cell, line in zip(cells, lines, strict=True)]
        self.blocks.append(np.array(values, dtype=float))

    def _value(self, cell: str, line: int, decimal: str) -> float:
        value = number(cell, decimal) if self.kind == "number" else None
        if self.kind == "stamp" and (moment := stamp_ns(cell)) is not None:
            self.zero = moment if self.zero is None else self.zero
            value = (moment - self.zero) * 1e-9
        if value is None:
            self.example = self.example or printable(cell[:30])
            self.faults.append(line)
        return float("nan") if value is None else value


@dataclass(kw_only=True)
class Rows:
    """Table of cells: its layout, and the rows that were read."""

    separator: str | None
    """Separator of cells; None: runs of white space."""
    decimal: str
    header: int
    """Line of the names; 0: the file has no names."""
    first: int
    """Line of the first row of numbers."""
    columns: tuple[CellColumn, ...]
    lines: list[int] = field(default_factory=list)
    ragged: list[Row] = field(default_factory=list)
    """Skipped rows, which have another number of cells."""

    def add(self, rows: Iterable[Row]) -> None:
        """Convert rows. Blank lines and comments are skipped, and rows of another length are skipped and reported."""
        whole: list[Row] = []
        for line, row in rows:
            # A power failure may leave zero bytes at the end of a file.
            if "".join(row).strip("\0 \t") and not row[0].startswith(COMMENTS):
                (whole if len(row) == len(self.columns) else self.ragged).append((line, row))
        if not whole:
            return
        lines, table = zip(*whole, strict=True)
        self.lines += lines
        for column, cells in zip(self.columns, zip(*table, strict=True), strict=True):
            if column.kind == "joint":
                column.blocks.append(np.array(cells))
            elif column.kind != "text":
                column.add(cells, lines, self.decimal)

    def content(self, form: str) -> Content:
        """Content with the table, and one problem for each kind of fault."""
        findings = []
        if self.ragged:
            rows, first = counted(len(self.ragged), "row"), len(self.ragged[0][1])
            message = f"skipped {rows} with {first} instead of {len(self.columns)} fields (or another number)"
            findings.append(_problem(message, [line for line, _ in self.ragged], "ragged-row"))
        for column in self.columns:
            if column.faults:
                cells = counted(len(column.faults), "cell")
                message = f"{cells} without a number, such as '{column.example}', read as missing"
                findings.append(_problem(message, column.faults, "not-a-number", column.name))
        if texts := [column.name for column in self.columns if column.kind == "text"]:
            findings.append(Problem("text is not read", key=listed(texts, 6), code="text-column"))
        if not self.header:
            message = "has no header; columns are called column_1, column_2, ..."
            findings.append(Problem(message, hint="Name them with --map 2=joint_1.link_position", code="no-header"))
        columns = tuple(
            RawColumn(name=column.name, values=np.concatenate(column.blocks), zero=column.zero, place=i)
            for i, column in enumerate(self.columns, start=1)
            if column.kind != "text"
        )
        table = RawTable(columns=columns, lines=np.array(self.lines, dtype=np.int64))
        return Content(format=form, tables=(table,), findings=tuple(findings))


def _problem(message: str, lines: Sequence[int], code: str, key: str | None = None) -> Problem:
    places = f"line{'s' if len(lines) > 1 else ''} {listed(lines, 8)}"
    return Problem(f"{message}: {places}", line=lines[0], key=key, code=code)


def read_text(path: Path, reading: Reading) -> Content:
    """Content of a text file. Raises RecordingError if it contains no table."""
    encoding = reading.encoding or _encoding(path)
    with path.open(encoding=encoding, errors="replace") as stream:
        lines = [(i, line.strip("\r\n")) for i, line in enumerate(itertools.islice(stream, _SAMPLE), start=1)]
    lines = [(i, line) for i, line in lines if line.strip("\0 \t")]
    plain = [line for _, line in lines if not line.lstrip().startswith(COMMENTS)]
    if not plain:
        raise RecordingError("holds no rows", code="empty", hint="Expected a header and rows of numbers")
    separator, decimal = _separator(plain[len(plain) // 2 :], reading)
    rows = layout_of([(i, _cells(line, separator)) for i, line in lines], reading, decimal, separator)
    with path.open(encoding=encoding, errors="replace") as stream:
        numbered = enumerate(itertools.islice(stream, rows.first - 1, None), start=rows.first)
        while block := [*itertools.islice(numbered, _BLOCK)]:
            rows.add((i, split(line.strip("\r\n"), separator)) for i, line in block)
    word = next(word for word, sign in SEPARATORS.items() if sign == separator)
    layout: dict[str, str | int] = {"separator": word, "decimal": decimal, "encoding": encoding, "header": rows.header}
    return replace(rows.content("text"), layout=layout)


def read_cells(form: str, rows: list[list[str]], reading: Reading) -> Content:
    """Content made of rows of cells, from a sheet or a list of records."""
    width = max((len(row) for row in rows), default=0)
    filled = [(i, row + [""] * (width - len(row))) for i, row in enumerate(rows, start=1) if any(row)]
    if not filled:
        raise RecordingError("holds no rows", code="empty")
    found = layout_of(filled[:_SAMPLE], reading, ".", ",")
    found.add(row for row in filled if row[0] >= found.first)
    return found.content(form)


def layout_of(rows: Sequence[Row], reading: Reading, decimal: str, separator: str | None) -> Rows:
    """Layout derived from the first rows. Raises RecordingError if they contain no table, or the header does not fit."""
    # The kind of the first cell distinguishes rows of the table from lines above, such as "Samples 400 400" or "Operator Ada".
    shapes = Counter((len(cells), kind_of(cells[0], decimal) == "text") for _, cells in rows[len(rows) // 2 :])
    (columns, begins_with_text), _ = shapes.most_common(1)[0]

    def share(row: Row) -> float | None:
        """Fraction of the row's cells that are values; None for comments and rows of another shape."""
        line, cells = row
        if len(cells) != columns or line <= (reading.header or 0) or cells[0].startswith(COMMENTS):
            return None
        same_kind = (kind_of(cells[0], decimal) == "text") == begins_with_text
        return share_of_values(cells, decimal) if same_kind else None

    shares = [*map(share, rows)]
    below = [*shares[1:], None]
    place = next((i for i, both in enumerate(zip(shares, below, strict=True)) if _begins(*both)), None)
    if place is None:
        raise RecordingError(
            "contains no row of numbers", line=rows[0][0], value=" ".join(rows[0][1])[:60], code="no-numbers",
            hint="Expected columns separated by comma, semicolon, tab or blanks, below an optional header",
        )  # fmt: skip
    above = [(line, _uncommented(cells)) for line, cells in rows[:place] if reading.header in (None, line)]
    # In LabVIEW's measurement files the last name is Comment, but only rows with a comment have that cell.
    above = [(line, names[:columns] if names[columns:] == ["Comment"] else names) for line, names in above]
    # Some programs end each row, but not the header, with a separator.
    blank = all(not cells[-1] for _, cells in rows[place:] if len(cells) == columns)
    fitting = [row for row in above if len(row[1]) in (columns, columns - blank) and share_of_values(row[1], decimal) < 0.5]
    header, names = fitting[-1] if fitting else (0, [""] * columns)
    if place and not fitting and reading.header is None and len(rows[place - 1][1]) > 2:
        line, names = rows[place - 1]
        raise RecordingError(
            f"the header has {len(names)} names, but the rows have {columns} fields", line=line, code="header-misfit",
            hint="Repair that line, or state `header: 0` in the document beside the file and name the columns by their numbers",
        )  # fmt: skip
    kinds = [Counter(kind_of(cells[i], decimal) for _, cells in rows[place:] if len(cells) == columns) for i in range(columns)]
    common = [max(("number", "stamp", "text"), key=lambda kind: counts[kind]) for counts in kinds]
    members = tuple(
        CellColumn(name=name, kind="joint" if name == reading.joint else kind)
        for name, kind in zip(_unique([*names, ""][:columns]), common, strict=True)
    )
    skipped = [row for row in rows[:place] if row[0] > header > 0 and share_of_values(row[1], decimal) >= 0.5]
    return Rows(separator=separator, decimal=decimal, header=header, first=rows[place][0], columns=members, ragged=skipped)


def _begins(share: float | None, below: float | None) -> bool:
    """Whether a row begins the table: all of its cells are values, or at least half of its cells and half of the next row's."""
    return share is not None and (share == 1.0 or (share >= 0.5 and (below is None or below >= 0.5)))


def _encoding(path: Path) -> str:
    """Encoding, by the byte-order mark; else UTF-8 if the start is valid, else Latin-1. Raises RecordingError if binary."""
    with path.open("rb") as stream:
        start = stream.read(65536)
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if b"\0" in start.rstrip(b"\0"):
        message = "is not a text file (it contains zero bytes)"
        raise RecordingError(message, code="binary", hint="Give it the ending of its format")
    try:
        start.decode("utf-8")
    except UnicodeDecodeError as error:
        # The end of the sample may split a valid character.
        return "latin-1" if error.start < len(start) - 4 else "utf-8-sig"
    return "utf-8-sig"


def _separator(lines: Sequence[str], reading: Reading) -> tuple[str | None, str]:
    """Separator and decimal mark that make most cells numbers; a separator or mark stated in `reading` is kept."""

    def score(separator: str | None, decimal: str) -> float:
        """Fraction of the lines' cells that are values; a layout with one column is chosen only if no other fits."""
        rows = [split(line, separator) for line in lines]
        columns = Counter(map(len, rows)).most_common(1)[0][0]
        # A separator at the end of each line makes a blank last cell, which must not lower the score.
        whole = [row if row[-1] or columns < 3 else row[:-1] for row in rows if len(row) == columns]
        good = sum(share_of_values(row, decimal) for row in whole) / len(rows)
        return round(good - (0.4 if columns == 1 else 0.0), 3)

    separators = [SEPARATORS[reading.separator]] if reading.separator else SEPARATORS.values()
    marks = (reading.decimal,) if reading.decimal else (".", ",")
    layouts = [(separator, mark) for separator in separators for mark in marks if mark != separator or reading.decimal]
    return max(layouts, key=lambda layout: score(*layout))


def _cells(line: str, separator: str | None) -> list[str]:
    """Cells of a line above the numbers. If blanks separate cells, a unit in brackets stays with the word before it."""
    if separator is None:
        line = re.sub(r"^\s*(#|%|//)\s*", r"\1", line)
        line = re.sub(r"\s*([\[(])([^\])]*)([\])])", lambda m: m[1] + m[2].replace(" ", "") + m[3], line)
    return split(line, separator)


def _uncommented(cells: list[str]) -> list[str]:
    """Cells of a header without a comment sign, as in `# t, q1` and `%Time (s)`."""
    return [cells[0].lstrip(" #%/"), *cells[1:]] if cells[0].startswith(COMMENTS) else cells


def _unique(names: Sequence[str]) -> tuple[str, ...]:
    """Unique names: the second column q becomes q#2, and a fourth column without name becomes column_4."""
    seen: Counter[str] = Counter()
    result = []
    for i, name in enumerate(names):
        name = printable(name.strip(" \t,;")) or f"column_{i + 1}"
        seen[name] += 1
        result.append(name if seen[name] == 1 else f"{name}#{seen[name]}")
    return tuple(result)
