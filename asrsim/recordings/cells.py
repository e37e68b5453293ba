"""One line and one cell of a delimited text file: split, numbers, dates, and what counts as missing."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

COMMENTS = ("#", "%", "//")
MISSING = {"", "nan", "na", "n/a", "null", "none", "-nan", "nan(ind)", "-nan(ind)", "#n/a", "-", "--"}
"""Cells that mean "no value"."""
_FORTRAN = re.compile(r"[+-]?\d*\.\d*[dD][+-]?\d+")
_GROUPED = re.compile(
    r"[-+]?\d{1,3}(?:(?P<mark>[., ])\d{3}(?:(?P=mark)\d{3})*(?P<decimal>[.,])\d+"
    r"|(?P<sure>['\u2019\u00a0\u2009\u202f])\d{3}(?:(?P=sure)\d{3})*(?:(?P<point>[.,])\d*)?)"
)
"""Marks between thousands: a point or comma beside a decimal mark that tells them apart, or what is nothing else (`1'234`)."""
_STAMP = re.compile(
    r"^(\d{4}[-/]\d\d?[-/]\d\d?|\d\d?[./]\d\d?[./]\d{4}|\d\d?(?P<mark>[./])\d\d?(?P=mark)\d\d(?= \d\d?:)"
    r"|\d\d?-[A-Za-z]{3}-\d{4}|\d{8}(?=[T_])|\d\d?:\d\d|-?\d+ days?)(?=[T_ :.,/-]|$)"
)
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")


_DAY_MONTH = re.compile(r"^(?:[A-Z][a-z]{2},? )?(\d\d?) ([A-Z][a-z]{2})[a-z]*\.? (\d{4})(?= |$)")
_MONTH_DAY = re.compile(
    r"^(?:[A-Z][a-z]{2},? )?([A-Z][a-z]{2})[a-z]*\.? +(\d\d?)(?:, (\d{4}))?"
    r"( \d\d?:\d\d:\d\d\S*(?: [AP]M)?)(?: [A-Z]{3,4})?(?: (\d{4}))?$"
)
"""`31 Mar 2024`, `Sun, 31 Mar 2024`; `Mar 31, 2024 10:00:00`, `Sun Mar 31 10:00:00 2024`."""
_ZONES = {"UTC": 0, "GMT": 0, "WET": 0, "WEST": 1, "CET": 1, "CEST": 2, "MEZ": 1, "MESZ": 2, "EET": 2, "EEST": 3}
"""Names of zones that stand for one offset, in h."""
_ZONE = re.compile(r"(?<=\d) ?(?:(?:UTC|GMT)(?P<hours>[-+]\d\d?)(?::?(?P<minutes>\d\d))?|(?P<name>[A-Z]{3,4}))$")


def printable(text: str) -> str:
    """The text without control characters and halves of characters, which would reach a terminal or fail there."""
    return text if text.isprintable() else "".join(sign if sign.isprintable() else "?" for sign in text)


def split(line: str, separator: str | None, *, quoted: bool) -> list[str]:
    """Cells of a line, stripped of spaces and quotes."""
    if quoted and '"' in line:
        if separator is None:
            return [quoted or plain for quoted, plain in re.findall(r'"([^"]*)"|([^\s"]+)', line)]
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    return [cell.strip() for cell in line.split(separator)]


_LIST = re.compile(r"[\[(]\s*(.*?)\s*[\])]")


def entries(cell: str) -> list[str] | None:
    """Entries of a list in one cell, `[0.1, 0.2]`, `(0.1 0.2)` or `['hip', 'knee']`; None for any other cell."""
    match = _LIST.fullmatch(cell)
    return None if match is None else [part.strip("\"' ") for part in re.split(r"\s*[,;]\s*|\s+", match[1]) if part]


def spread(cells: Sequence[str], widths: Mapping[int, int]) -> list[str]:
    """Cells with the lists among them in their entries; blank ones where a list has another length than its column's."""
    result: list[str] = []
    for i, cell in enumerate(cells):
        if i not in widths:
            result.append(cell)
            continue
        found = entries(cell) or []
        result += found if len(found) == widths[i] else [""] * widths[i]
    return result


def glue(text: str, separator: str | None) -> str:
    """`t [ms]  q1 [deg]`: a unit in brackets belongs to the word before it where spaces separate."""
    if separator is not None:
        return text
    return re.sub(r"\s*([\[(])([^\])]*)([\])])", lambda m: m[1] + m[2].replace(" ", "") + m[3], text)


def number(cell: str, decimal: str) -> float | None:
    """The cell's number, NaN where it is missing, None where it is text."""
    text = cell.replace(",", ".") if decimal == "," else cell
    try:
        return float(text) if "_" not in text else None
    except ValueError:
        if _FORTRAN.fullmatch(text):
            return float(text.replace("D", "E").replace("d", "e"))
        if "\u2212" in cell:  # the minus of typographers
            return number(cell.replace("\u2212", "-"), decimal)
        if (match := _GROUPED.fullmatch(cell)) is not None and (match["decimal"] or match["point"] or decimal) == decimal:
            mark = match["sure"] or match["mark"]
            return float(cell.replace(mark, "").replace(decimal, ".")) if mark != decimal else None
        return float("nan") if cell.lower() in MISSING else None


def stamp_ns(cell: str) -> int | None:
    """Nanoseconds since 1970 (UTC where no zone is given; since midnight for a time of day), or None."""
    if cell[:1].isalpha() or cell[2:5].strip()[:1].isalpha():
        cell = _with_months_in_the_middle(cell)
    if not _STAMP.match(cell):
        return None
    if (zone := _ZONE.search(cell)) is not None:
        cell = cell[: zone.start()] + _offset(zone)
    text = cell.replace(",", ".").replace("_", " ")
    text = re.sub(r"^(\d{4}([-/])\d\d?\2\d\d?)[-/](?=\d)", r"\1 ", text)  # 2024/05/06/10:00:00, as ROS writes it
    text = re.sub(r"(:\d\d:\d\d):(\d+)$", r"\1.\2", text)
    half = re.search(r"\s*([AP])\.?M\.?$", text, re.IGNORECASE)
    if half:
        text = text[: half.start()]
    days = re.match(r"^(-?\d+) days? ?", text)
    if days:  # pandas' time since the start
        text = text[days.end() :]
    elif re.fullmatch(r"\d\d?:\d\d\.\d+", text):  # Excel shows minutes and seconds
        text = f"00:{text:0>{len(text) + (text[1] == ':')}}"
    fraction = re.search(r"(:\d\d|[T ]\d{6})\.(\d+)", text)
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
    whole_days = delta.days + (int(days[1]) if days else 0)
    return (whole_days * 86400 + delta.seconds) * 1_000_000_000 + int(digits.ljust(9, "0")[:9] or "0")


def _with_months_in_the_middle(cell: str) -> str:
    """`31-Mar-2024 10:00:00` of what says the same in another order."""
    if (match := _DAY_MONTH.match(cell)) is not None:
        return f"{match[1]}-{match[2]}-{match[3]}{cell[match.end() :]}"
    if (match := _MONTH_DAY.match(cell)) is not None and (year := match[3] or match[5]) is not None:
        return f"{match[2]}-{match[1]}-{year}{match[4]}"
    return cell


def _offset(zone: re.Match[str]) -> str:
    """`+01:00` of a zone that is known; what is written, which is no date then, of another."""
    if zone["name"] is not None:
        return f"+{_ZONES[zone['name']]:02d}:00" if zone["name"] in _ZONES else zone[0]
    return f"{int(zone['hours']):+03d}:{zone['minutes'] or '00'}"


def _moment(text: str) -> datetime:
    if re.match(r"^\d\d?:\d\d", text):
        return datetime.fromisoformat(f"1970-01-01T{text.zfill(len(text) + (text[1] == ':'))}")
    if "/" in text or re.match(r"^\d\d?[.-]", text):
        date, _, clock = text.partition("T" if "T" in text else " ")
        parts = [_MONTHS.index(part.lower()) + 1 if part.isalpha() else int(part) for part in re.split(r"[./-]", date)]
        # 2024/5/6 is year first; 6.5.2024 and 6-May-2024 day first; 5/6/2024 month first.
        swapped = "/" not in date
        parts = [*parts[:2], parts[2] + 2000] if max(parts) < 100 else parts  # 6.5.24, 5/6/24
        year, month, day = parts if parts[0] > 31 else (parts[2], parts[1], parts[0]) if swapped else (parts[2], *parts[:2])
        clock = clock.strip() or "00:00:00"
        return datetime.fromisoformat(f"{year:04d}-{month:02d}-{day:02d}T{clock.zfill(len(clock) + (clock[1:2] == ':'))}")
    return datetime.fromisoformat(text)


def share_of_numbers(cells: Sequence[str], decimal: str) -> float:
    """Share of cells that are numbers, stamps or lists of numbers; 0 for a row of missing ones."""
    kinds = [number(cell, decimal) is not None or stamp_ns(cell) is not None or _is_list(cell, decimal) for cell in cells]
    filled = any(kind and cell.lower() not in MISSING for kind, cell in zip(kinds, cells, strict=True))
    return sum(kinds) / len(cells) if filled else 0.0


def grouped(cells: Sequence[str], decimal: str) -> str | None:
    """A cell whose point or comma stands between thousands, in a column of whole numbers: `8.342` beside `993`, `1.234.567`."""
    marked = [cell for cell in cells if (match := _THOUSANDS.fullmatch(cell)) is not None and match[1][0] != decimal]
    rest = set(cells) - set(marked)
    twice = [cell for cell in marked if len(re.sub(r"\d", "", cell.lstrip("+-"))) > 1]
    if twice or (marked and any(cell.strip("+-").isdecimal() for cell in rest) and all(map(_SMALL.fullmatch, rest - MISSING))):
        return (twice or marked)[0]
    return None


_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(([., ])\d{3}(?:\2\d{3})*)")
_SMALL = re.compile(r"[-+]?\d{1,3}")


def _is_list(cell: str, decimal: str) -> bool:
    found = entries(cell) or []
    return any(entry not in MISSING for entry in found) and all(number(entry, decimal) is not None for entry in found)


def kind_of(cells: Sequence[str], decimal: str) -> str:
    """What a column holds by its cells: `number`, `stamp` or `text`."""
    filled = [cell for cell in cells if cell.lower() not in MISSING]
    if not filled:
        return "number"
    numbers = sum(number(cell, decimal) is not None for cell in filled)
    stamps = sum(stamp_ns(cell) is not None for cell in filled)
    return "number" if 2 * numbers >= len(filled) else "stamp" if 2 * stamps >= len(filled) else "text"
