"""The layout of a delimited text file, found from its first lines: encoding, separator, decimal mark, header, units."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from asrsim.errors import RecordingError
from asrsim.recordings.abroad import encoding_by_words
from asrsim.recordings.cells import (
    COMMENTS,
    MISSING,
    entries,
    glue,
    grouped,
    kind_of,
    printable,
    share_of_numbers,
    split,
    spread,
)
from asrsim.recordings.dressed import Dress, dressed
from asrsim.recordings.foreign import READ, refuse_foreign, refuse_foreign_line
from asrsim.recordings.header import comment_header, comment_units, find_header, unique, unnamed, with_unknown

_SAMPLE = 200
"""Lines that are looked at to find out how a file is written."""
_RECEIVED = re.compile(r"(\s*\d\d:\d\d:\d\d(?:[.,]\d+)?)\s*->\s*")
"""What Arduino's serial monitor writes before a line: when it came."""
_SEPARATORS: tuple[str | None, ...] = ("\t", ";", ",", "|", None)


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
    unnamed: tuple[int, ...] = ()
    """Columns under a blank in the header; an index is written so."""
    widths: Mapping[int, int] = field(default_factory=dict)
    """Column of the file whose cells are lists -> their length; `names` has one for each entry."""
    received: str = ""
    """What stands for the arrow behind the time at which a line came; empty where lines have none."""
    misfit: str = ""
    """Why a line that looks like a header is not used."""
    misfit_line: int | None = None
    scaled: Mapping[str, str] = field(default_factory=dict)
    """Name -> factor and offset that the header states, where it is not known whether the numbers have them already."""
    remarks: str = ""
    """What comments and lines above the header say."""

    dress: Dress | None = None
    """What stands beside the numbers of every line."""

    def plain(self, line: str) -> str:
        """A line as one of a table."""
        line = _RECEIVED.sub(rf"\g<1>{self.received}", line, count=1) if self.received else line
        return line if self.dress is None else self.dress.plain(line)


def encoding_of(path: Path) -> str:
    """Encoding by byte-order mark, else UTF-8 if the start decodes, else Latin-1. Raises RecordingError for binary files."""
    with path.open("rb") as stream:
        start = stream.read(65536)
    if not start.strip(b"\xef\xbb\xbf \t\r\n"):
        raise RecordingError("the file is empty", file=path, code="empty", hint="Expected a header and rows of numbers")
    if start.startswith((b"\xff\xfe\0\0", b"\0\0\xfe\xff")):
        return "utf-32"
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    refuse_foreign(path, start)
    start = start.rstrip(b"\0")  # a computer that was switched off leaves them
    for encoding, zeros in (("utf-16-le", start[1::2]), ("utf-16-be", start[::2])):
        if zeros.count(b"\0") > 0.9 * len(zeros):
            return encoding
    start = re.sub(rb"(?m)^\0+(?=\r?$)", b"", start)  # and where it went on in the same file
    if b"\0" in start:
        raise RecordingError(
            "is not a text file (it holds zero bytes)", file=path, code="binary",
            hint=f"Expected {READ}; the ending of its name says which",
        )  # fmt: skip
    try:
        start.decode("utf-8")
    except UnicodeDecodeError as error:
        # A character cut at the end of the sample is no sign of another encoding.
        if error.start < len(start) - 4:
            return encoding_by_words(start) or "latin-1"
    return "utf-8-sig"


def sniff(path: Path) -> Layout:
    """The layout of the file; raises RecordingError where it holds no table of numbers."""
    encoding = encoding_of(path)
    lines, comments, declared = _first_lines(path, encoding)
    received = _received([text for _, text in lines])
    if received:
        lines = [(count, _RECEIVED.sub(rf"\g<1>{received}", text, count=1)) for count, text in lines]
    dress = dressed([text for _, text in lines])
    if dress is not None:
        lines = [(count, dress.plain(text)) for count, text in lines]
    quoted = any('"' in text for _, text in lines)
    separator, decimal, columns = _separator(lines, quoted=quoted, declared=declared)
    rows = [(count, split(glue(text, separator), separator, quoted=quoted)) for count, text in lines]
    if separator is None:  # names with blanks in them stand further apart than these
        wide = [re.split(r"\s{2,}", text.strip()) for _, text in lines]
        rows = [(n, far if len(far) == columns else near) for (n, near), far in zip(rows, wide, strict=True)]
    first = _first_of_numbers(rows, columns, decimal)
    if first is None:
        refuse_foreign_line(path, *lines[0])
        raise RecordingError(
            "no row of numbers found", file=path, line=lines[0][0], value=lines[0][1][:60], code="no-numbers",
            hint="Expected columns separated by comma, semicolon, tab or spaces, with at most a header above",
        )  # fmt: skip
    data = [cells for _, cells in rows[first:] if len(cells) == columns]
    header = find_header(rows[:first], data, decimal)
    names, header_at, misfit = header.names, header.line if header.names else None, header.misfit
    if names is None:
        before = [(n, c) for n, c in comments if n < rows[first][0] and comment_units(c, separator, columns) is None]
        names = comment_header(before[-1][1], separator, columns, decimal) if before else None
        header_at, misfit = (before[-1][0], "") if names else (None, misfit)
    if dress is not None and len(dress.names) == columns:
        names, header_at, misfit = list(dress.names), rows[first][0], ""
    if names and received:
        names = ["time", *names[1:]]
    used = {header_at, header.units_line}
    widths = _widths(data)
    names = names or [f"column_{i + 1}" for i in range(columns)]
    if widths:
        data = [spread(cells, widths) for cells in data]
        names = [label for i, name in enumerate(names) for label in _labels(name, widths.get(i))]
        columns = len(names)
    above = [text for n, text in comments if n < rows[first][0]]
    told = header.units or next((found for text in above if (found := comment_units(text, separator, columns))), None)
    told = list(dress.units) if dress is not None and len(dress.units) == columns else told
    stated = told if told and not widths else [""] * columns
    for i, name in enumerate(names):
        if (cell := grouped([cells[i] for cells in data if len(cells) == columns], decimal)) is not None:
            raise RecordingError(
                f"numbers have marks between their thousands: {printable(cell)}", file=path, key=name, code="thousands",
                hint="Export it without them",
            )  # fmt: skip
    kinds = [kind_of([cells[i] for cells in data], decimal) for i in range(columns)]
    return Layout(
        encoding=encoding, separator=separator, decimal=decimal, quoted=quoted,
        names=unique([with_unknown(*pair) for pair in zip(names, stated, strict=True)]), unnamed=unnamed(names),
        widths=widths, units=tuple(stated), header_line=header_at, first_line=rows[first][0],
        skipped=tuple(n for n, _ in rows[:first] if n not in used),
        remarks="\n".join([*above, *(text for n, text in lines[:first] if n not in used)]),
        received=received, dress=dress, scaled=header.scaled, misfit=misfit, misfit_line=header.line if misfit else None,
        stamps=tuple(i for i, kind in enumerate(kinds) if kind == "stamp"),
        text=tuple(i for i, kind in enumerate(kinds) if kind == "text"),
    )  # fmt: skip


def _first_lines(path: Path, encoding: str) -> tuple[list[tuple[int, str]], list[tuple[int, str]], str | None]:
    """Lines and comments with their numbers, and the separator that a line for Excel declares."""
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
        declared, lines = match[1], lines[1:]
    if not lines:
        raise RecordingError("holds comments only", file=path, code="empty", hint="Expected rows of numbers")
    return lines, comments, declared


def _first_of_numbers(rows: Sequence[tuple[int, list[str]]], columns: int, decimal: str) -> int | None:
    """Which of the rows is the first of numbers; None where there is none."""
    share = [share_of_numbers(cells, decimal) if len(cells) == columns else 0.0 for _, cells in rows]
    share = [0.0 if _is_told(cells, lead=not rows[-1][1][0]) else own for own, (_, cells) in zip(share, rows, strict=True)]
    # "Samples 400 400" among the lines above a header is no row of numbers: it has fewer of them than most, and none follow.
    usual = max(0.5, sorted(share)[len(share) // 2])
    followed = zip(share, [*share[1:], 1.0], strict=True)
    return next((i for i, (own, after) in enumerate(followed) if own >= 0.5 and max(own, after) >= usual), None)


def _is_told(cells: Sequence[str], *, lead: bool) -> bool:
    """Whether a row with numbers is one of a header: `Offset 0 Offset 0`, or numbers of bodies behind a blank that no row of
    numbers begins with.

    lead: such rows do begin with one.
    """
    keys = {*cells[::2]}
    paired = len(cells) > 3 and len(cells) % 2 == 0 and len(keys) == 1 and any(sign.isalpha() for sign in cells[0])
    return (paired and cells[0].lower() not in MISSING) or (len(cells) > 2 and not cells[0] and not lead)


def _received(texts: Sequence[str]) -> str:
    """The separator that stands for the arrow of Arduino's serial monitor: that of the rest of most lines; empty without it."""
    rests = [text[match.end() :] for text in texts if (match := _RECEIVED.match(text))]
    if 2 * len(rests) < len(texts):
        return ""
    return next((mark for mark in "\t;,|" if 2 * sum(mark in rest for rest in rests) > len(rests)), " ")


def _widths(data: Sequence[Sequence[str]]) -> dict[int, int]:
    """Columns of lists, with the length that most have."""
    found: dict[int, int] = {}
    for i in range(len(data[0])):
        lists = [entries(cells[i]) for cells in data if cells[i]]
        lengths = Counter(len(one) for one in lists if one is not None)
        if lists and 2 * sum(lengths.values()) > len(lists):
            found[i] = lengths.most_common(1)[0][0]
    return found


def _labels(name: str, width: int | None) -> list[str]:
    return [name] if width is None else [f"{name}[{i}]" for i in range(width)]


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
            # A separator that ends each line makes a blank cell there, which is no sign against it.
            whole = [row if row[-1] or columns < 3 else row[:-1] for row in rows if len(row) == columns]
            good = sum(share_of_numbers(row, decimal) for row in whole) / len(rows)
            # One column is the last resort; a point is preferred where both marks explain the file.
            score = (round(good - (0.4 if columns == 1 else 0.0), 3), -rank, separator, decimal, columns)
            if score[:2] > best[:2]:
                best = score
    return best[2], best[3], best[4]
