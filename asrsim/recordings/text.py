"""Reads delimited text and cells of sheets. The layout is detected from the first lines. Then the columns are converted in
blocks of lines.
"""

from __future__ import annotations

import csv
import itertools
import math
import re
from codecs import getincrementaldecoder
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from asrsim.errors import Problem, RecordingError, counted, listed, printable
from asrsim.recordings.data import Content, RawColumn, RawTable, places_text, unique
from asrsim.recordings.joint_names import list_widths, message_names, name_columns, spread, with_joints
from asrsim.recordings.marks import EITHER, GROUPS, POINT, number_in, use_of_other, with_point
from asrsim.recordings.reading import SEPARATORS, Reading
from asrsim.recordings.units import find_unit, split_header
from asrsim.samples import Array

COMMENTS = ("#", "%", "//")
MISSING = {"", "nan", "na", "n/a", "null", "none", "-nan", "#n/a", "-", "--"}
"""Cells that mean "no value"."""
_EPOCH, _MICROSECOND = datetime(1970, 1, 1, tzinfo=UTC), timedelta(microseconds=1)
_SAMPLE = 200
"""Number of lines at the start of a file from which its layout is detected."""
_BLOCK = 1000
"""Number of lines that are read at a time. Larger blocks are slower, since Python's garbage collector visits the rows of a
block often.
"""
_BRACKETS = " []()<>{}"
_ONLY_BRACKETS = re.compile(r"\s*(?:[\[(][^\])\s]*[\])]\s*)+")
"""Pattern of a row that contains only units in brackets, without names."""
_LONGEST = 200
"""Largest length of a joint's name, in characters."""
NumberedLine = tuple[int, list[str]]
"""Line number and cells of a row."""


def split(line: str, separator: str | None) -> list[str]:
    """Cells of a line, without surrounding blanks and quotes. separator: character between cells; None: any number of
    blanks.
    """
    if " " not in line and '"' not in line:  # most files have no blanks or quotes to remove
        return line.split(separator)
    if separator is not None and '"' in line and len(line) < csv.field_size_limit():
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    return [cell.strip(' "') for cell in line.split(separator)]


def parse(cell: str, decimal: str) -> tuple[str, float]:
    """Kind of a cell (`missing`, `number`, `stamp` or `text`), and its value. The value is NaN for missing values and text.

    The value of a stamp is in ns: the Unix time of an ISO 8601 date (UTC by default), or the time since midnight for a time of
    day.
    """
    if cell.lower() in MISSING:
        return "missing", math.nan
    with suppress(ValueError):
        return "number", number_in(cell, decimal)
    # Excel writes 62 s as 01:02, which would be read as one hour and two minutes. Therefore a time of day must have two colons.
    for text in (cell, f"1970-01-01T{cell}") if cell.count(":") != 1 else ():
        with suppress(ValueError):
            moment = datetime.fromisoformat(text.replace("/", "-"))
            return "stamp", ((moment if moment.tzinfo else moment.replace(tzinfo=UTC)) - _EPOCH) // _MICROSECOND * 1000
    return "text", math.nan


def kinds_of(cells: Iterable[str], decimal: str) -> list[str]:
    """Kind of each cell: `missing`, `number`, `stamp` or `text`."""
    return [parse(cell, decimal)[0] for cell in cells]


def share_of_values(kinds: Sequence[str]) -> float:
    """Fraction of cells that are numbers, dates or missing; 0 if all cells are missing."""
    return 1.0 - kinds.count("text") / len(kinds) if {*kinds} != {"missing"} else 0.0


@dataclass(kw_only=True)
class CellColumn:
    """Column of cells. The cells are converted to numbers block by block."""

    name: str
    kind: str
    """Kind of the cells: number, stamp, text or joint. Cells of the kind joint are names of joints, and stay text in
    `blocks`.
    """
    zero: int | None = None
    """First date or time of day in the column, ns; None for other kinds."""
    blocks: list[Array] = field(default_factory=list)
    faults: list[int] = field(default_factory=list)
    """Line numbers of the cells that are not numbers."""
    example: str = ""
    """First cell that is not a number."""
    doubtful: list[tuple[int, int, str]] = field(default_factory=list)
    """Index, line number and text of each number with an ambiguous mark, such as `1.234`. The mark may be a decimal mark or
    separate groups of digits.
    """
    uses: set[str] = field(default_factory=set)
    """Uses of the mark that is not the decimal mark in the other numbers of the column: `marks.GROUPS`, `marks.POINT`."""

    def add(self, cells: Sequence[str], lines: Sequence[int], decimal: str) -> None:
        """Convert cells and append them as a block. Text becomes NaN, and its line is stored in `faults`."""
        text = "".join(cells) if self.kind == "number" else "_"
        plain = "_" not in text and (decimal == "." or "." not in text)
        try:
            values = [*map(float, [cell.replace(",", ".") for cell in cells] if decimal == "," else cells)] if plain else []
        except ValueError:
            values = []
        if not values:
            rows = enumerate(zip(cells, lines, strict=True), start=sum(map(len, self.blocks)))
            values = [self._value(cell, line, decimal, row) for row, (cell, line) in rows]
        self.blocks.append(np.array(values, dtype=float))

    def values(self, decimal: str, *, stated: bool) -> Array:
        """Values (n,) of the column. Raises RecordingError if the use of a mark is ambiguous and no other cell shows it.

        stated: whether the user states the decimal mark.
        """
        values: Array = np.concatenate(self.blocks)
        if not self.doubtful or GROUPS in self.uses or (stated and POINT not in self.uses):
            return values
        if POINT not in self.uses:
            _, line, cell = self.doubtful[0]
            choices = f"{number_in(cell, decimal):g}", f"{with_point(cell):g}"
            message = "is ambiguous: its mark may be a decimal mark or separate thousands, and the file uses points and commas"
            hint = "State the decimal mark in the document beside the file: `decimal: ','` or `decimal: '.'`"
            raise RecordingError(message, line=line, key=self.name, value=cell, choices=choices, hint=hint, code="two-marks")
        for row, _, cell in self.doubtful:
            values[row] = with_point(cell)
        return values

    def _value(self, cell: str, line: int, decimal: str, row: int) -> float:
        kind, value = parse(cell, decimal)
        if kind == "number" and (use := use_of_other(cell, decimal)):
            if use == EITHER:
                self.doubtful.append((row, line, cell))
            else:
                self.uses.add(use)
        if kind != self.kind and (kind, self.kind) != ("missing", "number"):
            self.example = self.example or printable(cell[:30])
            self.faults.append(line)
            return math.nan
        if kind == "stamp":
            self.zero = int(value) if self.zero is None else self.zero
            return (value - self.zero) * 1e-9
        return value


@dataclass(frozen=True, kw_only=True)
class TableLayout:
    """Layout of a table of cells."""

    decimal: str
    stated: bool
    """Whether the user states the decimal mark."""
    header: int
    """Line number of the header with the names; 0: the file has no header."""
    first: int
    """Line number of the first row of numbers."""
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    """Kind of each column: number, stamp, text or joint, as in `CellColumn`."""
    skipped: tuple[NumberedLine, ...]
    """Rows with values above the first row of numbers, which have a different number of cells."""

    def content(self, rows: Iterable[NumberedLine]) -> Content:
        """Content with a table of the rows, and with one problem for each kind of fault.

        Blank lines and comments are skipped. Rows with another number of cells are skipped and reported. Raises RecordingError
        if no number is left.
        """
        columns = [CellColumn(name=name, kind=kind) for name, kind in zip(self.names, self.kinds, strict=True)]
        lines: list[int] = []
        ragged = list(self.skipped)
        waiting = iter(rows)
        while block := [*itertools.islice(waiting, _BLOCK)]:
            whole = block
            if not _are_plain(block, len(columns)):
                # A power failure may leave null bytes at the end of a file.
                filled = [row for row in block if "".join(row[1]).strip("\0 \t") and not row[1][0].startswith(COMMENTS)]
                whole = [row for row in filled if len(row[1]) == len(columns)]
                ragged += [row for row in filled if len(row[1]) != len(columns)]
            if whole:
                numbers, cells = zip(*whole, strict=True)
                lines += numbers
                for column, texts in zip(columns, zip(*cells, strict=True), strict=True):
                    if column.kind == "joint":
                        column.blocks.append(np.array([text[:_LONGEST] for text in texts]))
                    elif column.kind != "text":
                        column.add(texts, numbers, self.decimal)
        kept = [(place, column) for place, column in enumerate(columns, start=1) if column.blocks]
        if all(column.kind == "joint" for _, column in kept):
            raise RecordingError("contains no row of numbers", code="no-numbers")
        findings = []
        if ragged:
            message = (
                f"skipped {counted(len(ragged), 'row')}: expected {len(columns)} fields, found {len(ragged[0][1])} in the first"
            )
            findings.append(_problem(message, [line for line, _ in ragged], "ragged-row"))
        for column in columns:
            if column.faults:
                message = f"{counted(len(column.faults), 'cell')} without a number, such as '{column.example}', read as missing"
                findings.append(_problem(message, column.faults, "not-a-number", column.name))
        if unread := [column.name for column in columns if column.kind == "text"]:
            findings.append(Problem("text is not read", key=listed(unread, 6), code="text-column"))
        if not self.header and self.names[0] != "column_1":
            arrays = [*dict.fromkeys(name.partition("[")[0] for name in self.names)]
            message = f"has no header; its rows are the arrays of a JointState message: {', '.join(arrays)}"
            hint = "If other arrays were recorded, name the columns: --map 'velocity[0]=elbow.link_torque'"
            findings.append(Problem(message, hint=hint, code="no-header"))
        elif not self.header:
            message = "has no header; columns are called column_1, column_2, ..."
            findings.append(Problem(message, hint="Name them with --map 2=joint_1.link_position", code="no-header"))
        raw = tuple(
            RawColumn(name=column.name, values=column.values(self.decimal, stated=self.stated), zero=column.zero, place=place)
            for place, column in kept
        )
        table = with_joints(RawTable(columns=raw, lines=np.array(lines, dtype=np.int64)), findings)
        return Content(tables=(table,), findings=tuple(findings))


def _are_plain(rows: Sequence[NumberedLine], width: int) -> bool:
    """Whether all rows have this number of cells and begin with a number. No row is then blank or a comment."""
    first = [cells[0] for _, cells in rows if len(cells) == width]
    try:
        return len([*map(float, first)]) == len(rows)
    except ValueError:
        return False


def _problem(message: str, lines: Sequence[int], code: str, key: str | None = None) -> Problem:
    return Problem(f"{message}: {places_text('line', lines)}", line=lines[0], key=key, code=code)


def read_text(path: Path, reading: Reading) -> Content:
    """Content of a text file. Raises RecordingError if it contains no table."""
    encoding = reading.encoding or _encoding(path)
    with path.open(encoding=encoding, errors="replace") as stream:
        start = [(i, line.strip("\r\n")) for i, line in enumerate(itertools.islice(stream, _SAMPLE), start=1)]
        start = [(i, line) for i, line in start if line.strip("\0 \t") and i >= (reading.header or 0)]
        plain = [line for _, line in start if not line.lstrip().startswith(COMMENTS)]
        if not plain:
            raise RecordingError("holds no rows", code="empty", hint="Expected a header and rows of numbers")
        word, decimal = _separator(plain[len(plain) // 2 :], reading)
        separator = SEPARATORS[word]
        widths = list_widths([split(line, separator) for line in plain])
        layout = layout_of([(i, spread(_cells(line, separator), widths)) for i, line in start], reading, decimal)
        stream.seek(0)
        numbered = enumerate(itertools.islice(stream, layout.first - 1, None), start=layout.first)
        rows = ((i, split(line.strip("\r\n"), separator)) for i, line in numbered)
        found = layout.content(((i, spread(cells, widths)) for i, cells in rows) if widths else rows)
    return replace(found, layout={"separator": word, "decimal": decimal, "encoding": encoding, "header": layout.header})


def read_cells(rows: list[list[str]], reading: Reading) -> Content:
    """Content from rows of cells of a sheet or of a list of records. Raises RecordingError if the rows contain no table."""
    width = max((len(row) for row in rows), default=0)
    numbered = [(i, row) for i, row in enumerate(rows, start=1) if any(row) and i >= (reading.header or 0)]
    filled = [(i, row + [""] * (width - len(row))) for i, row in numbered]
    if not filled:
        raise RecordingError("holds no rows", code="empty")
    widths = list_widths([row for _, row in filled[:_SAMPLE]])
    filled = [(i, spread(row, widths)) for i, row in filled] if widths else filled
    layout = layout_of(filled[:_SAMPLE], reading, ".")
    return layout.content([row for row in filled if row[0] >= layout.first])


def layout_of(rows: Sequence[NumberedLine], reading: Reading, decimal: str) -> TableLayout:
    """Layout of a table, derived from its first rows. Raises RecordingError if they contain no table, or if the header does not
    fit.
    """
    kinds = [kinds_of(cells, decimal) for _, cells in rows]
    # Names of joints in the rows do not count as text, since a row may contain more names than numbers.
    naming: dict[int, list[int]] = {}
    for (_, cells), kind in zip(rows, kinds, strict=True):
        kind[:] = ["missing" if i in naming and one == "text" else one for i, one in enumerate(kind)]
        naming = naming or name_columns(_uncommented(cells))
    # A row of the table differs from lines above it, such as "Samples 400 400" or "Operator Ada", by the kind of its first
    # cell.
    shape = Counter((len(row), row[0] == "text") for row in kinds[len(rows) // 2 :]).most_common(1)[0][0]
    columns, lowest = shape[0], reading.header or 0
    # For each row, the fraction of its cells that are values; None for comments and for rows of another shape.
    shares = [
        share_of_values(kind)
        if (len(kind), kind[0] == "text") == shape and line > lowest and not cells[0].startswith(COMMENTS)
        else None
        for (line, cells), kind in zip(rows, kinds, strict=True)
    ]
    below = [*shares[1:], None]
    place = next((i for i, both in enumerate(zip(shares, below, strict=True)) if _begins(*both)), None)
    if place is None:
        raise RecordingError(
            "contains no row of numbers",
            line=rows[0][0],
            value=" ".join(rows[0][1])[:60],
            code="no-numbers",
            hint="Expected columns separated by comma, semicolon, tab or blanks, below an optional header; for topics a bag, "
            "or what `ros2 topic echo --csv` prints",
        )
    above = [(line, _uncommented(cells)) for line, cells in rows[:place]]
    # In LabVIEW's measurement files the last name is Comment, but only rows with a comment have a cell in this column.
    above = [(line, names[:columns] if names[columns:] == ["Comment"] else names) for line, names in above]
    # Some programs write a separator at the end of each row, but not at the end of the header.
    blank = all(not cells[-1] for _, cells in rows[place:] if len(cells) == columns)
    widths = (columns, columns - blank)
    above = [row for row in above if len(row[1]) in widths]
    fitting = [row for row in above if _may_name(row, reading.header, decimal)]
    header, names = _with_units(above, fitting) if fitting else (0, [""] * columns)
    if place and not fitting and reading.header is None and len(rows[place - 1][1]) not in (1, 2, columns):
        line, names = rows[place - 1]
        raise RecordingError(
            f"the header has {len(names)} names, but the rows have {columns} fields",
            line=line,
            code="header-misfit",
            hint="Repair that line, or state `header: 0` in the document beside the file and name the columns by their numbers",
        )
    members = map(Counter, zip(*(kind for kind in kinds[place:] if len(kind) == columns), strict=True))
    common = [max(("number", "stamp", "text"), key=counts.__getitem__) for counts in members]
    if not header:
        names = message_names(rows[place][1], common) or names
    labels = _unique([*names, ""][:columns])
    naming = name_columns(labels)
    return TableLayout(
        decimal=decimal,
        stated=reading.decimal is not None,
        header=header,
        first=rows[place][0],
        names=labels,
        kinds=tuple(
            "joint" if name == reading.joint or i in naming else kind
            for i, (name, kind) in enumerate(zip(labels, common, strict=True))
        ),
        skipped=tuple(
            row for row, kind in zip(rows[:place], kinds, strict=False) if row[0] > header > 0 and share_of_values(kind) >= 0.5
        ),
    )


def _may_name(row: NumberedLine, stated: int | None, decimal: str) -> bool:
    """Whether a row may be the header. It must be the stated row or, if no row is stated, contain mostly text."""
    return row[0] == stated if stated is not None else share_of_values(kinds_of(row[1], decimal)) < 0.5


def _with_units(above: Sequence[NumberedLine], fitting: Sequence[NumberedLine]) -> NumberedLine:
    """Header: the last row that may be the header, with units from a row of units below or above it.

    above: rows above the numbers, with the same number of cells as the rows of numbers; fitting: rows of `above` that may be
    the header.
    """
    place = above.index(fitting[-1])
    if _are_units(above[place][1]) and len(fitting) > 1 and above.index(fitting[-2]) == place - 1:
        place -= not _are_units(above[place - 1][1])
    (line, names), beside = above[place], [*above[place + 1 : place + 2], *above[max(place - 1, 0) : place]]
    units = next((cells for _, cells in beside if _are_units(cells)), [""] * len(names))
    return line, [
        f"{split_header(name)[0]} [{unit.strip(_BRACKETS)}]" if unit.strip(_BRACKETS + "-1") else name
        for name, unit in zip(names, (*units, ""), strict=False)
    ]


def _are_units(cells: Sequence[str]) -> bool:
    """Whether a row is a row of units. All of its cells must be units, or at least two and at least half of its cells."""
    filled = [cell for cell in cells if cell.strip(_BRACKETS + "-")]
    known = sum(find_unit(cell) is not None for cell in filled)
    return 0 < known >= (len(filled) if known < 2 else 0.5 * len(filled))


def _begins(share: float | None, below: float | None) -> bool:
    """Whether a row is the first row of numbers. All of its cells must be values, or at least half of its cells and half of the
    next row's cells. share, below: fraction of values in the row and in the next row.
    """
    return share is not None and (share == 1.0 or (share >= 0.5 and (below is None or below >= 0.5)))


def _encoding(path: Path) -> str:
    """Encoding of a text file: UTF-16 if the file has its byte-order mark, otherwise UTF-8 if the start of the file is valid
    UTF-8, otherwise Latin-1. Raises RecordingError if the file is binary.
    """
    with path.open("rb") as stream:
        start = stream.read(65536)
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if b"\0" in start.rstrip(b"\0"):
        message = "is not a text file (it contains zero bytes)"
        raise RecordingError(
            message,
            code="binary",
            hint="Rename the file: its ending must state its format. A reader of your own needs --plugin FILE",
        )
    try:
        getincrementaldecoder("utf-8")().decode(start)  # the sample may end within a character
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _separator(lines: Sequence[str], reading: Reading) -> tuple[str, str]:
    """Word for the separator, and decimal mark, with which most cells are numbers. Values that `reading` states are kept."""

    def score(layout: tuple[str, str]) -> float:
        """Fraction of the cells that are values. It is reduced for a layout with one column, so that such a layout is chosen
        only if no other layout fits.
        """
        word, decimal = layout
        rows = [split(line, SEPARATORS[word]) for line in lines]
        columns = Counter(map(len, rows)).most_common(1)[0][0]
        # A separator at the end of each line gives a blank last cell, which must not reduce the score.
        whole = [row if row[-1] or columns < 3 else row[:-1] for row in rows if len(row) == columns]
        widths = list_widths(whole)
        good = sum(share_of_values(kinds_of(spread(row, widths), decimal)) for row in whole) / len(rows)
        # If a point or a comma may be the decimal mark of all cells, prefer the mark for which fewer cells contain the other
        # mark.
        other = sum(bool(use_of_other(cell, decimal)) for row in whole for cell in row) / (columns * len(rows))
        return round(good - (0.4 if columns == 1 else 0.0) - 0.1 * other, 3)

    words = [reading.separator] if reading.separator else [*SEPARATORS]
    marks = [reading.decimal] if reading.decimal else [".", ","]
    quoted = bool(reading.decimal) or any('"' in line for line in lines)
    layouts = [(word, mark) for word in words for mark in marks if word != mark or quoted]
    best, most = layouts[0], -math.inf
    # First try the separators that occur in the lines. Stop at the highest score, 1, which no layout with one column has.
    for layout in sorted(layouts, key=lambda one: all(len(split(line, SEPARATORS[one[0]])) == 1 for line in lines)):
        found = score(layout)
        if found > most:
            best, most = layout, found
        if found == 1.0:
            break
    return best


def _cells(line: str, separator: str | None) -> list[str]:
    """Cells of a line above the numbers. If blanks separate cells, a unit in brackets stays in the cell of the word before
    it.
    """
    if separator is None and not _ONLY_BRACKETS.fullmatch(line):
        line = re.sub(r"^\s*(#|%|//)\s*", r"\1", line)
        line = re.sub(r"\s*([\[(])([^\])]*)([\])])", lambda m: m[1] + m[2].replace(" ", "") + m[3], line)
    return split(line, separator)


def _uncommented(cells: list[str]) -> list[str]:
    """Cells of a header, without the comment sign of headers such as `# t, q1` and `%Time (s)`."""
    return [cells[0].lstrip(" #%/"), *cells[1:]] if cells[0].startswith(COMMENTS) else cells


def _unique(names: Sequence[str]) -> tuple[str, ...]:
    """Unique names. A second column q becomes q#2, and a fourth column without a name becomes column_4."""
    plain = [printable(name.strip(" \t,;")) or f"column_{i}" for i, name in enumerate(names, start=1)]
    seen: Counter[str] = Counter()
    return tuple(unique(name, seen) for name in plain)
