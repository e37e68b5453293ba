"""The layout of a delimited text file, found from its first lines: encoding, separator, decimal mark, header, units."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from asrsim.errors import Problem, RecordingError
from asrsim.recordings.units import find_unit

COMMENTS = ("#", "%", "//")
MISSING = {"", "nan", "na", "n/a", "null", "none", "-nan", "nan(ind)", "-nan(ind)", "#n/a", "-", "--"}
"""Cells that mean "no value"."""
_SAMPLE = 200
_FOREIGN = (
    (b"PK\x03\x04", "a zip archive (an Excel workbook, numpy's npz, or compressed)"), (b"\x1f\x8b", "compressed by gzip"),
    (b"\x93NUMPY", "a numpy array"), (b"\x89HDF", "an HDF5 file"), (b"PAR1", "a Parquet file"), (b"%PDF", "a PDF document"),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook"), (b"{", "JSON"), (b"[{", "JSON"), (b"<", "HTML or XML"),
    (b"\x89PNG", "a picture"), (b"\xff\xd8\xff", "a picture"), (b"SQLite format 3", "a database; ROS 2 bags end in .db3"),
)  # fmt: skip
"""First bytes of files that laboratories have, and that are no tables of text."""
_SEPARATORS: tuple[str | None, ...] = ("\t", ";", ",", "|", None)
_FORTRAN = re.compile(r"[+-]?\d*\.\d*[dD][+-]?\d+")
_STAMP = re.compile(r"^(\d{4}[-/]\d\d?[-/]\d\d?|\d\d?[./]\d\d?[./]\d{4}|\d\d:\d\d)(?=[T :]|$)")


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How to read the lines of a file."""

    encoding: str
    separator: str | None
    """None: runs of white space."""
    decimal: str
    """`.` or `,`."""
    names: tuple[str, ...]
    """Header, or column_1, column_2, ..."""
    units: tuple[str, ...]
    """Units of a row of their own under the header, else empty strings."""
    header_line: int | None
    first_line: int
    """Line of the first row of numbers, counted from 1."""
    skipped: tuple[int, ...]
    """Lines before it that are neither header nor comment nor blank."""
    quoted: bool
    stamps: tuple[int, ...]
    """Columns that hold dates or times of day."""
    text: tuple[int, ...]
    """Columns that hold other text."""


def encoding_of(path: Path) -> str:
    """Encoding by byte-order mark, else UTF-8 if the start decodes, else Latin-1. Raises RecordingError for binary files."""
    with path.open("rb") as stream:
        start = stream.read(65536)
    if not start.strip(b"\xef\xbb\xbf \t\r\n"):
        raise RecordingError(
            Problem(message="the file is empty", file=path, code="empty", hint="Expected a header and rows of numbers")
        )
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    for magic, what in _FOREIGN:
        if start.startswith(magic):
            raise RecordingError(
                Problem(message=f"is {what}, which is not read here", file=path, code="foreign-format",
                        hint="Expected CSV, MCAP, a ROS bag or a MATLAB file; export or unpack it as CSV")
            )  # fmt: skip
    if b"\0" in start:
        raise RecordingError(
            Problem(message="is not a text file (it holds zero bytes)", file=path, code="binary",
                    hint="Expected CSV, MCAP, a ROS bag or a MATLAB file; the ending of its name says which")
        )  # fmt: skip
    try:
        start.decode("utf-8")
    except UnicodeDecodeError as error:
        # A character cut at the end of the sample is no sign of another encoding.
        if error.start < len(start) - 4:
            return "latin-1"
    return "utf-8-sig"


def split(line: str, separator: str | None, *, quoted: bool) -> list[str]:
    """Cells of a line, stripped of spaces and quotes."""
    if quoted and '"' in line:
        if separator is None:
            return [cell.strip('"') for cell in line.split()]
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
    if not _STAMP.match(cell):
        return None
    text = cell.replace(",", ".")
    half = re.search(r"\s*([AP])\.?M\.?$", text, re.IGNORECASE)
    if half:
        text = text[: half.start()]
    fraction = re.search(r"(:\d\d)\.(\d+)", text)
    digits = fraction[2] if fraction else ""
    whole = text if fraction is None else text[: fraction.start(2) - 1] + text[fraction.end(2) :]
    try:
        moment = _moment(whole)
        if half:
            moment = moment.replace(hour=moment.hour % 12 + (12 if half[1].upper() == "P" else 0))
    except ValueError:
        return None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    epoch = datetime(1970, 1, 1, tzinfo=UTC)
    delta = moment - epoch
    return (delta.days * 86400 + delta.seconds) * 1_000_000_000 + int(digits.ljust(9, "0")[:9] or "0")


def _moment(text: str) -> datetime:
    if re.match(r"^\d\d:\d\d", text):
        return datetime.fromisoformat(f"1970-01-01T{text}")
    if "/" in text or re.match(r"^\d\d?\.", text):
        date, _, clock = text.partition("T" if "T" in text else " ")
        parts = [int(part) for part in re.split(r"[./]", date)]
        # 2024/5/6 is year first; 6.5.2024 day first; 5/6/2024 month first.
        year, month, day = parts if parts[0] > 31 else (parts[2], parts[1], parts[0]) if "." in date else (parts[2], *parts[:2])
        return datetime.fromisoformat(f"{year:04d}-{month:02d}-{day:02d}T{clock or '00:00:00'}")
    return datetime.fromisoformat(text)


def sniff(path: Path) -> Layout:
    """The layout of the file; raises RecordingError where it holds no table of numbers."""
    encoding = encoding_of(path)
    lines: list[tuple[int, str]] = []
    comments: list[tuple[int, str]] = []
    with path.open(encoding=encoding, errors="replace") as stream:
        for count, line in enumerate(stream, start=1):
            text = line.strip("\r\n")
            if not text.strip():
                continue
            (comments if text.lstrip().startswith(COMMENTS) else lines).append((count, text))
            if len(lines) >= _SAMPLE:
                break
    declared = None
    if lines and (match := re.fullmatch(r"sep=(.)", lines[0][1].strip().strip('"'), re.IGNORECASE)):
        declared = match[1]  # the line by which Excel is told the separator
        lines = lines[1:]
    if not lines:
        raise RecordingError(Problem(message="holds comments only", file=path, code="empty", hint="Expected rows of numbers"))
    quoted = any('"' in text for _, text in lines)
    separator, decimal, columns = _separator(lines, quoted=quoted, declared=declared)
    rows = [(count, split(_glue(text, separator), separator, quoted=quoted)) for count, text in lines]
    share = [_numeric(cells, decimal) if len(cells) == columns else 0.0 for _, cells in rows]
    # "Samples 400 400" among the lines above a header is no row of numbers: it has fewer of them than most, and none follow.
    usual = max(0.5, sorted(share)[len(share) // 2])
    followed = zip(share, [*share[1:], 1.0], strict=True)
    first = next((i for i, (own, after) in enumerate(followed) if own >= 0.5 and max(own, after) >= usual), None)
    if first is None:
        raise RecordingError(
            Problem(message="no row of numbers found", file=path, line=lines[0][0], value=lines[0][1][:60], code="no-numbers",
                    hint="Expected columns separated by comma, semicolon, tab or spaces, with at most a header above")
        )  # fmt: skip
    names, units, header_at = _header(rows[:first], columns, decimal)
    if names is None:
        before = [(n, c) for n, c in comments if n < rows[first][0]]
        names = _comment_header(before[-1][1], separator, columns, decimal) if before else None
        header_at = before[-1][0] if names else None
    used = {header_at} | ({rows[first - 1][0]} if units else set())
    data = [cells for _, cells in rows[first:] if len(cells) == columns]
    kinds = [_kind([cells[i] for cells in data], decimal) for i in range(columns)]
    return Layout(
        encoding=encoding, separator=separator, decimal=decimal, quoted=quoted,
        names=_unique(names or [f"column_{i + 1}" for i in range(columns)]),
        units=tuple(units or [""] * columns), header_line=header_at, first_line=rows[first][0],
        skipped=tuple(n for n, _ in rows[:first] if n not in used),
        stamps=tuple(i for i, kind in enumerate(kinds) if kind == "stamp"),
        text=tuple(i for i, kind in enumerate(kinds) if kind == "text"),
    )  # fmt: skip


def _glue(text: str, separator: str | None) -> str:
    """`t [ms]  q1 [deg]`: a unit in brackets belongs to the word before it where spaces separate."""
    return text if separator is not None else re.sub(r"\s+(?=[\[(][^\])]*[\])])", "", text)


def _separator(lines: Sequence[tuple[int, str]], *, quoted: bool, declared: str | None) -> tuple[str | None, str, int]:
    """Separator, decimal mark and number of columns that turn most cells of the later lines into numbers."""
    sample = [text for _, text in lines[len(lines) // 2 :]]
    best: tuple[float, int, str | None, str, int] = (-1.0, 0, None, ".", 1)
    for rank, separator in enumerate((declared,) if declared else _SEPARATORS):
        rows = [split(text, separator, quoted=quoted) for text in sample]
        columns = Counter(len(row) for row in rows).most_common(1)[0][0]
        for decimal in (".", ","):
            if decimal == separator and not quoted:
                continue
            good = sum(_numeric(row, decimal) for row in rows if len(row) == columns) / len(rows)
            # One column is the last resort; a point is preferred where both marks explain the file.
            score = (round(good - (0.4 if columns == 1 else 0.0), 3), -rank, separator, decimal, columns)
            if score[:2] > best[:2]:
                best = score
    return best[2], best[3], best[4]


def _numeric(cells: Sequence[str], decimal: str) -> float:
    """Share of cells that are numbers or stamps; 0 for a row of missing ones."""
    kinds = [number(cell, decimal) is not None or stamp_ns(cell) is not None for cell in cells]
    filled = any(kind and cell.lower() not in MISSING for kind, cell in zip(kinds, cells, strict=True))
    return sum(kinds) / len(cells) if filled else 0.0


def _kind(cells: Sequence[str], decimal: str) -> str:
    filled = [cell for cell in cells if cell.lower() not in MISSING]
    if not filled:
        return "number"
    numbers = sum(number(cell, decimal) is not None for cell in filled)
    stamps = sum(stamp_ns(cell) is not None for cell in filled)
    return "number" if 2 * numbers >= len(filled) else "stamp" if 2 * stamps >= len(filled) else "text"


def _header(
    rows: Sequence[tuple[int, list[str]]], columns: int, decimal: str
) -> tuple[list[str] | None, list[str] | None, int | None]:
    """Names, units and line of the header among the lines above the numbers."""
    # Trailing remarks (LabVIEW's "Comment") have a name but no numbers.
    rows = [(count, cells[:columns] if len(cells) == columns + 1 else cells) for count, cells in rows]
    fitting = [(count, cells) for count, cells in rows if len(cells) in (columns, columns - 1)]
    if not fitting or fitting[-1][0] != rows[-1][0]:
        return None, None, None
    count, cells = fitting[-1]
    cells = cells + [""] * (columns - len(cells))
    if _numeric(cells, decimal) >= 0.5:
        return None, None, None
    filled = [cell for cell in cells if cell not in ("", "-")]
    if len(fitting) > 1 and filled and all(find_unit(cell) for cell in filled):
        names = _grouped(fitting[:-1], columns)
        return names, [cell.strip("[](){}<> ") for cell in cells], fitting[-2][0]
    return _grouped(fitting, columns), None, count


def _grouped(rows: Sequence[tuple[int, list[str]]], columns: int) -> list[str]:
    """The names of the last row; where they repeat, each behind the group's name in the row above ("Joint 1" over three)."""
    names = rows[-1][1] + [""] * (columns - len(rows[-1][1]))
    filled = [name for name in names if name]
    if len(set(filled)) == len(filled) or len(rows) < 2 or rows[-2][0] != rows[-1][0] - 1:
        return names
    groups, last = [], ""
    for cell in rows[-2][1] + [""] * (columns - len(rows[-2][1])):
        last = cell or last
        groups.append(last)
    return [f"{group} {name}".strip() if group != name else name for group, name in zip(groups, names, strict=True)]


def _comment_header(text: str, separator: str | None, columns: int, decimal: str) -> list[str] | None:
    """A header in the last comment line, as numpy.savetxt writes it."""
    plain = text.lstrip(" #%/").strip()
    for candidate in dict.fromkeys((separator, ",", ";", "\t", None)):
        cells = split(_glue(plain, candidate), candidate, quoted='"' in plain)
        if len(cells) == columns and _numeric(cells, decimal) < 0.5:
            return cells
    return None


def _unique(names: Sequence[str]) -> tuple[str, ...]:
    """Names without repeats or blanks: the second q becomes q#2, a blank one column_4."""
    seen: Counter[str] = Counter()
    result = []
    for i, name in enumerate(names):
        name = name.strip() or f"column_{i + 1}"
        seen[name] += 1
        result.append(name if seen[name] == 1 else f"{name}#{seen[name]}")
    return tuple(result)
