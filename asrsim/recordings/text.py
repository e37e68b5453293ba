"""Reads delimited text: how it is laid out by its first lines, then blocks of lines, fast where they are clean."""

from __future__ import annotations

import csv
import itertools
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError, listed
from asrsim.recordings.data import Content, RawColumn, RawTable
from asrsim.recordings.reading import SEPARATORS, Reading
from asrsim.recordings.units import find_unit
from asrsim.samples import Array

COMMENTS = ("#", "%", "//")
MISSING = {"", "nan", "na", "n/a", "null", "none", "-nan", "nan(ind)", "-nan(ind)", "#n/a", "-", "--"}
"""Cells that mean "no value"."""
_FORTRAN = re.compile(r"[+-]?\d*\.\d*[dD][+-]?\d+")
_STAMP = re.compile(
    r"(?:(?P<y>\d{4})[-/.](?P<m>\d\d?)[-/.](?P<d>\d\d?)|(?P<a>\d\d?)(?P<sign>[./])(?P<b>\d\d?)[./](?P<year>\d{4}))?"
    r"(?:(?:^|[T _/-])(?P<hour>\d\d?):(?P<minute>\d\d)(?::(?P<second>\d\d)(?:[.,:](?P<fraction>\d+))?)?"
    r"\s*(?P<half>[AaPp][Mm])?)?\s*(?P<zone>Z|UTC|GMT|[-+]\d\d:?\d\d)?"
)
"""A date, a time of day, or both. Before the year points mean day first, slashes month first."""


def printable(text: str) -> str:
    """The text without control characters and halves of characters, which would reach a terminal or fail there."""
    return text if text.isprintable() else "".join(sign if sign.isprintable() else "?" for sign in text)


def split(line: str, separator: str | None, *, quoted: bool) -> list[str]:
    """Cells of a line, stripped of blanks and quotes."""
    if quoted and '"' in line:
        if separator is None:
            return [inner or plain for inner, plain in re.findall(r'"([^"]*)"|([^\s"]+)', line)]
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    return [cell.strip() for cell in line.split(separator)]


def number(cell: str, decimal: str) -> float | None:
    """The cell's number, NaN where it is missing, None where it is text."""
    text = cell.replace(",", ".") if decimal == "," else cell
    try:
        return float(text) if "_" not in text else None
    except ValueError:
        if _FORTRAN.fullmatch(text):
            return float(text.replace("D", "E").replace("d", "e"))
        return float("nan") if cell.lower() in MISSING else None


def stamp_ns(cell: str) -> int | None:
    """Nanoseconds since 1970 (UTC where no zone is given; since midnight for a time of day), or None."""
    found = _STAMP.fullmatch(cell)
    if found is None or not (found["y"] or found["a"] or found["minute"]):
        return None
    year, month, day = found["y"] or found["year"] or 1970, found["m"] or found["a"] or 1, found["d"] or found["b"] or 1
    if found["sign"] == ".":
        month, day = day, month
    hour = int(found["hour"] or 0)
    if found["half"]:
        hour = hour % 12 + (12 if found["half"].lower() == "pm" else 0)
    zone, offset = found["zone"] or "", timedelta()
    if zone[:1] in ("+", "-"):
        offset = timedelta(hours=int(zone[1:3]), minutes=int(zone[-2:])) * (-1 if zone[0] == "-" else 1)
    try:
        moment = datetime(int(year), int(month), int(day), hour, int(found["minute"] or 0), int(found["second"] or 0),
                          tzinfo=timezone(offset))  # fmt: skip
    except ValueError:
        return None
    since = moment - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86400 + since.seconds) * 1_000_000_000 + int((found["fraction"] or "0").ljust(9, "0")[:9])


def is_value(cell: str, decimal: str) -> bool:
    """Whether a cell is a number, missing, or a date."""
    return number(cell, decimal) is not None or stamp_ns(cell) is not None


def share_of_values(cells: Sequence[str], decimal: str) -> float:
    """Share of cells that are numbers, missing or dates; 0 for a row of missing ones."""
    values = [is_value(cell, decimal) for cell in cells]
    filled = any(value and cell.lower() not in MISSING for value, cell in zip(values, cells, strict=True))
    return sum(values) / len(cells) if filled else 0.0


def kind_of(cells: Sequence[str], decimal: str) -> str:
    """What a column holds by its cells: `number`, `stamp` or `text`."""
    filled = [cell for cell in cells if cell.lower() not in MISSING]
    numbers = sum(number(cell, decimal) is not None for cell in filled)
    stamps = sum(stamp_ns(cell) is not None for cell in filled)
    return "number" if 2 * numbers >= len(filled) else "stamp" if 2 * stamps >= len(filled) else "text"


_SAMPLE = 200
"""Lines by which it is found out how a file is laid out."""
_BLOCK = 20_000
"""Lines read at a time; bounds the memory beside the numbers themselves."""
_PLACE = r"(.*?)(?:name|position|velocity|effort)[\[_]?(\d+)\]?"
"""An entry of a JointState: `field.name0`, `position[1]`."""
Row = tuple[int, list[str]]
"""Line and cells."""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How the rows of a table are read."""

    separator: str | None = ","
    """None: runs of white space."""
    decimal: str = "."
    quoted: bool = False
    names: tuple[str, ...]
    units: tuple[str, ...]
    """Of a row of their own beside the names, else empty."""
    kinds: tuple[str, ...]
    """Of columns: number, stamp or text."""
    header_line: int | None
    first: int
    """Line of the first row of numbers."""
    skipped: tuple[int, ...] = ()
    """Lines above it that are neither header nor comment."""


_FAULTS = {
    "ragged-row": "{count} rows with {cell} instead of {columns} fields, or the like, are left out",
    "repeated-header": "the header is repeated {count} times, as in two recordings in one file",
    "not-a-number": "{count} cells are no numbers and count as missing, such as '{cell}'",
    "missing-cells": "{count} of {rows} cells are empty",
}
"""Code of what is wrong with lines or cells -> what is said of it."""


@dataclass
class Faults:
    """Lines and cells that were no plain numbers, by what was wrong with them."""

    found: dict[tuple[str, int], tuple[list[int], str]] = field(default_factory=dict)
    """Code and column (-1: whole lines) -> lines and the first cell."""
    words: dict[int, set[str]] = field(default_factory=dict)
    """Column of text -> its first two words."""

    def add(self, code: str, line: int, column: int = -1, cell: object = "") -> None:
        """Note one."""
        self.found.setdefault((code, column), ([], printable(str(cell)[:30])))[0].append(line)

    def problems(self, layout: Layout, rows: int) -> Iterator[Problem]:
        """One for each kind and column."""
        for (code, column), (lines, cell) in sorted(self.found.items()):
            if code == "missing-cells" and len(lines) == rows:
                continue
            said = _FAULTS[code].format(count=len(lines), cell=cell, columns=len(layout.names), rows=rows)
            where = f"line{'s' if len(lines) > 1 else ''} {listed(lines, 8)}"
            yield Problem(f"{said}: {where}", line=lines[0], key=layout.names[column] if column >= 0 else None, code=code)
        if texts := [name for name, kind in zip(layout.names, layout.kinds, strict=True) if kind == "text"]:
            yield Problem("text is not read", key=listed(texts, 6), code="text-column")


def read_text(path: Path, reading: Reading) -> Content:
    """The table of a text file. Raises RecordingError if there is none."""
    encoding = reading.encoding or _encoding(path)
    with path.open(encoding=encoding, errors="replace") as stream:
        lines = [(i, line.strip("\r\n")) for i, line in enumerate(itertools.islice(stream, _SAMPLE + 100), start=1)]
    comments = [(i, line) for i, line in lines if line.lstrip().startswith(COMMENTS)]
    filled = [(i, line) for i, line in lines if line.strip("\0 \t") and not line.lstrip().startswith(COMMENTS)][:_SAMPLE]
    if not filled:
        raise RecordingError("holds no rows", code="empty", hint="Expected a header and rows of numbers")
    quoted = any('"' in line for _, line in filled)
    separator, decimal = _separator([line for _, line in filled], reading, quoted=quoted)
    glued = [(i, _glued(line, separator)) for i, line in filled]
    rows = [(i, split(line, separator, quoted=quoted)) for i, line in glued]
    above = [(i, _comment_cells(line, separator)) for i, line in comments]
    layout = layout_of(rows, above, reading, decimal, separator, quoted=quoted)
    faults, zeros = Faults(), dict[int, int]()
    blocks: list[Array] = []
    numbers: list[NDArray[np.int64]] = []
    with path.open(encoding=encoding, errors="replace") as stream:
        for start, block in _blocks(itertools.islice(stream, layout.first - 1, None), layout.first):
            values, kept = _fast(block, layout), np.arange(start, start + len(block), dtype=np.int64)
            if values is None:
                cells = ((i, split(line.strip("\r\n"), separator, quoted=quoted)) for i, line in enumerate(block, start=start))
                values, kept = rows_of(cells, layout, faults, zeros)
            blocks.append(values)
            numbers.append(kept)
    found = content_of_table("text", np.concatenate(blocks), np.concatenate(numbers), layout, faults, zeros)
    word = next(word for word, sign in SEPARATORS.items() if sign == separator)
    header = layout.header_line or 0
    return replace(found, layout={"separator": word, "decimal": decimal, "encoding": encoding, "header": header})


def read_cells(form: str, rows: list[list[str]], reading: Reading) -> Content:
    """The table of rows of cells, as a sheet or a list of records has them."""
    counted = [(i, row) for i, row in enumerate(rows, start=1) if any(row)]
    if not counted:
        raise RecordingError("holds no rows", code="empty")
    width = max(len(row) for _, row in counted)
    counted = [(i, row + [""] * (width - len(row))) for i, row in counted]
    layout = layout_of(counted[: 2 * _SAMPLE], [], reading, ".", ",", quoted=False)
    faults, zeros = Faults(), dict[int, int]()
    values, lines = rows_of((row for row in counted if row[0] >= layout.first), layout, faults, zeros)
    return content_of_table(form, values, lines, layout, faults, zeros)


def layout_of(
    rows: Sequence[Row], comments: Sequence[Row], reading: Reading, decimal: str, separator: str | None,
    *, quoted: bool,
) -> Layout:  # fmt: skip
    """The layout by the first rows. Raises RecordingError where they hold no table, or a header of another length."""
    lengths = [len(cells) for _, cells in rows[len(rows) // 2 :]]
    columns = Counter(lengths).most_common(1)[0][0]
    after = reading.header or 0
    share = [share_of_values(cells, decimal) if len(cells) == columns and i > after else 0.0 for i, cells in rows]
    # "Samples 400 400" above a header is no row of numbers: it has fewer of them than most rows.
    usual = max(0.5, sorted(share)[len(share) // 2])
    pairs = enumerate(zip(share, [*share[1:], 1.0], strict=True))
    place = next((i for i, (own, then) in pairs if own >= 0.5 and max(own, then) >= usual), None)
    if place is None:
        raise RecordingError(
            "no row of numbers found", line=rows[0][0], value=" ".join(rows[0][1])[:60], code="no-numbers",
            hint="Expected columns separated by comma, semicolon, tab or blanks, with at most a header above",
        )  # fmt: skip
    first = rows[place][0]
    data = [cells for _, cells in rows[place:] if len(cells) == columns]
    titles = sorted([*rows[:place], *(row for row in comments if row[0] < first)])
    if reading.header is not None:
        titles = [row for row in titles if row[0] == reading.header]
    fitting = [(i, _fitted(cells, data)) for i, cells in titles]
    fitting = [(i, cells) for i, cells in fitting if len(cells) == columns and share_of_values(cells, decimal) < 0.5]
    units = next((row for row in reversed(fitting[-2:]) if len(fitting) > 1 and _are_units(row[1])), None)
    header = next((row for row in reversed(fitting) if row is not units), None)
    last = rows[place - 1] if place else None
    words = sum(bool(cell) and share_of_values([cell], decimal) == 0.0 for cell in last[1]) if last else 0
    known = {row[0] for row in (header, units) if row is not None}
    by_numbers = any(name.lstrip("#").isdecimal() for name in (*(one.column for one in reading.maps), *reading.time.columns))
    misfit = last is not None and last[0] > max(known, default=0) and words >= max(2, 0.5 * columns) and len(last[1]) > 2
    if last is not None and misfit and not by_numbers and reading.header is None:
        raise RecordingError(
            f"the header has {len(last[1])} names, its rows have {columns} fields", line=last[0], code="header-misfit",
            hint="Repair that line, or name the columns by their numbers: --map 1=time --map 2=joint_1.link_position",
        )  # fmt: skip
    names = header[1] if header else [""] * columns
    return Layout(
        separator=separator, decimal=decimal, quoted=quoted, names=_unique(names),
        units=tuple(_unit(cell) for cell in units[1]) if units else ("",) * columns,
        kinds=tuple(kind_of([cells[i] for cells in data], decimal) for i in range(columns)),
        header_line=header[0] if header else None, first=first,
        skipped=tuple(i for i, _ in rows[:place] if i not in known),
    )  # fmt: skip


def rows_of(rows: Iterable[Row], layout: Layout, faults: Faults, zeros: dict[int, int]) -> tuple[Array, NDArray[np.int64]]:
    """Numbers of rows, and their lines. Rows of another length are left out, cells that are no numbers are NaN; both noted."""
    columns = len(layout.names)
    found: list[list[float]] = []
    kept: list[int] = []
    header = [re.sub(r"#\d+$", "", name) for name in layout.names]
    for line, cells in rows:
        if not any(cell.strip("\0") for cell in cells) or cells[0].startswith(COMMENTS):
            continue
        while len(cells) > columns and not cells[-1]:
            cells.pop()
        if len(cells) != columns:
            faults.add("ragged-row", line, cell=len(cells))
        elif cells == header:
            faults.add("repeated-header", line)
        else:
            found.append([_value(cell, i, line, layout, faults, zeros) for i, cell in enumerate(cells)])
            kept.append(line)
    return np.array(found, dtype=float).reshape(len(found), columns), np.array(kept, dtype=np.int64)


def _value(cell: str, column: int, line: int, layout: Layout, faults: Faults, zeros: dict[int, int]) -> float:
    """One cell's number; NaN, and a note of it, where it has none."""
    kind = layout.kinds[column]
    if kind == "text":
        if len(words := faults.words.setdefault(column, set())) < 2:
            words.add(cell)
        return float("nan")
    if kind == "stamp":
        moment = stamp_ns(cell)
        if moment is not None:
            return (moment - zeros.setdefault(column, moment)) * 1e-9
    elif (value := number(cell, layout.decimal)) is not None:
        if cell.lower() in MISSING:
            faults.add("missing-cells", line, column)
        return value
    faults.add("not-a-number", line, column, cell)
    return float("nan")


def content_of_table(
    form: str, values: Array, lines: NDArray[np.int64], layout: Layout, faults: Faults, zeros: dict[int, int]
) -> Content:
    """The table with its findings, one a kind."""
    findings = [*faults.problems(layout, len(values))]
    if layout.skipped:
        said = f"passed over above the numbers: lines {listed(layout.skipped, 8)}"
        findings.append(Problem(said, code="preamble"))
    if layout.header_line is None:
        said, hint = "has no header; columns are called column_1, column_2, ...", "Name them with --map 2=joint_1.link_position"
        findings.append(Problem(said, hint=hint, code="no-header"))
    joints = _named_joints(layout, faults)
    columns = tuple(
        RawColumn(name=name, values=np.ascontiguousarray(values[:, i]), unit=layout.units[i], zero=zeros.get(i), place=i + 1,
                  joint=joints.get(re.sub(_PLACE, r"\1name\2", name)))
        for i, name in enumerate(layout.names)
        if layout.kinds[i] != "text"
    )  # fmt: skip
    table = RawTable(columns=columns, lines=lines)
    return Content(format=form, tables=(table,), findings=tuple(findings))


def _named_joints(layout: Layout, faults: Faults) -> dict[str, str]:
    """Of a JointState in a table: the column of a name, `field.name0`, and the joint whose name all of its rows have."""
    found: dict[str, str] = {}
    for column, words in faults.words.items():
        if re.fullmatch(_PLACE, label := layout.names[column]) is not None:
            if len(words) > 1:
                raise RecordingError(
                    "names other joints from row to row: its columns are of several joints", key=label, code="mixed-joints",
                    hint="Keep the rows of one publisher",
                )  # fmt: skip
            found[re.sub(_PLACE, r"\1name\2", label)] = printable(next(iter(words)))
    return found


def _encoding(path: Path) -> str:
    """By the byte-order mark, else UTF-8 or UTF-16 if the start is, else Latin-1. Raises RecordingError for binary files."""
    with path.open("rb") as stream:
        start = stream.read(65536).rstrip(b"\0")
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    for encoding, zeros in (("utf-16-le", start[1::2]), ("utf-16-be", start[::2])):
        if zeros and zeros.count(b"\0") > 0.9 * len(zeros):
            return encoding
    if b"\0" in re.sub(rb"(?m)^\0+(?=\r?$)", b"", start):
        raise RecordingError(
            "is not a text file (it holds zero bytes)", file=path, code="binary", hint="The ending of its name says the format"
        )
    try:
        start.decode("utf-8")
    except UnicodeDecodeError as error:
        # A character cut at the end of the sample is no sign of another encoding.
        if error.start < len(start) - 4:
            return "latin-1"
    return "utf-8-sig"


def _separator(lines: Sequence[str], reading: Reading, *, quoted: bool) -> tuple[str | None, str]:
    """Separator and decimal mark that turn most cells of the later lines into numbers, of those that are not stated."""
    sample = lines[len(lines) // 2 :]
    best: tuple[float, str | None, str] = (-1.0, None, ".")
    for separator in [SEPARATORS[reading.separator]] if reading.separator else SEPARATORS.values():
        rows = [split(line, separator, quoted=quoted) for line in sample]
        columns = Counter(len(row) for row in rows).most_common(1)[0][0]
        for decimal in (reading.decimal,) if reading.decimal else (".", ","):
            if decimal == separator and not quoted:
                continue
            # A separator that ends each line makes a blank cell there, which is no sign against it.
            whole = [row if row[-1] or columns < 3 else row[:-1] for row in rows if len(row) == columns]
            good = sum(share_of_values(row, decimal) for row in whole) / len(rows)
            score = round(good - (0.4 if columns == 1 else 0.0), 3)  # one column is the last resort
            if score > best[0]:
                best = score, separator, decimal
    return best[1], best[2]


def _glued(line: str, separator: str | None) -> str:
    """`t [ms]  q1 [deg]`: a unit in brackets belongs to the word before it where blanks separate."""
    if separator is not None:
        return line
    return re.sub(r"\s*([\[(])([^\])]*)([\])])", lambda m: m[1] + m[2].replace(" ", "") + m[3], line)


def _comment_cells(line: str, separator: str | None) -> list[str]:
    """The cells of a comment, which may be the header: `# t, q1`, `%Time (s)`."""
    plain = re.sub(r"^[ #%/]*(?:units?\s*:)?", "", line, flags=re.IGNORECASE).strip()
    used = separator if separator is None or separator in plain else next((sign for sign in "\t;," if sign in plain), None)
    return split(_glued(plain, used), used, quoted='"' in plain)


def _fitted(cells: list[str], data: Sequence[Sequence[str]]) -> list[str]:
    """The names over their columns where one is missing or too many and it is clear which."""
    columns = len(data[0])
    while len(cells) > columns and cells[-1].lower() in ("", "comment", "comments", "remark", "note"):
        cells = cells[:-1]
    if len(cells) == columns - 1:
        if not any(row[-1] for row in data):
            return [*cells, ""]
        index = [row[0].strip("\"'") for row in data]
        if any(index == [str(i + start) for i in range(len(index))] for start in (0, 1)):
            return ["", *cells]  # pandas and R write row numbers without a name for them
    return cells


def _unit(cell: str) -> str:
    return "" if cell.strip("[]()- ").lower() in ("", "unit", "units") else cell.strip("[](){}<> ")


def _are_units(cells: Sequence[str]) -> bool:
    units = [unit for cell in cells if (unit := _unit(cell))]
    return 2 * sum(find_unit(unit) is not None for unit in units) > len(units)


def _unique(names: Sequence[str]) -> tuple[str, ...]:
    """Names without repeats or blanks: the second q becomes q#2, a blank one column_4."""
    seen: Counter[str] = Counter()
    result = []
    for i, name in enumerate(names):
        name = printable(name.strip()) or f"column_{i + 1}"
        seen[name] += 1
        result.append(name if seen[name] == 1 else f"{name}#{seen[name]}")
    return tuple(result)


def _blocks(stream: Iterator[str], first: int) -> Iterator[tuple[int, list[str]]]:
    start = first
    while block := list(itertools.islice(stream, _BLOCK)):
        yield start, block
        start += len(block)


def _fast(block: list[str], layout: Layout) -> Array | None:
    """All lines at once by NumPy's C reader; None if any line needs a closer look."""
    if layout.quoted or {*layout.kinds} != {"number"}:
        return None
    if layout.decimal == ",":
        block = [line.replace(",", ".") for line in block]
    try:
        values = np.loadtxt(block, delimiter=layout.separator, comments=None, ndmin=2)
    except ValueError:
        return None
    # Blank lines are passed over by the reader and would shift the line numbers.
    return values if values.shape == (len(block), len(layout.names)) else None
