"""One line and one cell of a table of text: split, numbers, dates, and what counts as missing."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta, timezone

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
