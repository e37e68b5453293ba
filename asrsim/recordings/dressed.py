"""Numbers that carry their name (`q1:0.5,q2:0.3`, as Arduino's plotter takes them) or their unit (`0.5deg`) in every line.

Lines with names may have a head: the time at which a terminal, a logger or ROS's console wrote them, and what these say beside
it (`[INFO] [1700000000.25] [arm]: q1: 0.5 deg`).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from asrsim.recordings.units import find_unit

_NUMBER = r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?"
_PLAIN_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|nan|inf"
_PAIR = re.compile(
    rf"(?P<name>[^\W\d][^:=,;\t|]*?)\s*[:=]\s*(?P<number>{_PLAIN_NUMBER})(?:\s*(?P<unit>(?:°|[^\W\d_])[^\s,;|:=]*)(?!\s*[:=]))?"
    r"(?:\s*[,;\t|]\s*|\s+|$)",
    re.IGNORECASE,
)
_TIME = (
    r"(?P<day>\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?(?:Z|[-+]\d\d:?\d\d)?)|(?P<clock>\d\d:\d\d:\d\d(?:[.,]\d+)?)|"
    r"(?P<unix>\b\d{9,10}\.\d+)(?:, (?P<simulated>\d+\.\d+)(?=\]))?|[\[(](?P<since>\d+(?:\.\d+)?)[\])]"
)
_WHEN = re.compile(_TIME)
"""The time in a head: a date, the time of day, seconds since 1970 (with the time of a simulation, as ROS 1 writes it), a count
in brackets."""
_HEAD_END = re.compile(
    rf"(?:{_TIME}|[\])}}>]:?|:|-|\b(?:DEBUG|INFO|NOTICE|WARN(?:ING)?|ERROR|TRACE))(?:[,;|]\s*|\s+)", re.IGNORECASE
)
_COLOURS = re.compile(r"\x1b\[[\d;]*m")
_UNIT = re.compile(rf'\s*"?\s*({_NUMBER})\s*([^\W\d_][^\s"]*|°[^\s"]*|%)\s*"?\s*')
_MOST = 0.8
"""Share of the lines that must be so."""


@dataclass(frozen=True, kw_only=True)
class Dress:
    """What stands beside the numbers of every line."""

    separator: str
    names: tuple[str, ...] = ()
    """Of the columns, where lines name them."""
    units: tuple[str, ...] = ()
    """Of the columns, "" without one, where cells state them."""

    def plain(self, line: str) -> str:
        """The line without it; one that has another is left as it is, and will be no row of numbers."""
        if self.names:
            found = _pairs(line)
            return line if found is None or found[0] != self.names else self.separator.join(found[1])
        cells = line.rstrip("\r\n").split(self.separator)
        if len(cells) != len(self.units):
            return line
        bare = [_UNIT.fullmatch(cell) if unit else None for cell, unit in zip(cells, self.units, strict=True)]
        kept = [match[1] if match is not None and match[2] == unit else cell
                for cell, unit, match in zip(cells, self.units, bare, strict=True)]  # fmt: skip
        return self.separator.join(kept)


def dressed(lines: Sequence[str]) -> Dress | None:
    """What most of these lines have beside their numbers; None without it."""
    pairs = Counter(found[0] for line in lines if (found := _pairs(line)) is not None)
    if pairs and (common := pairs.most_common(1)[0])[1] >= _MOST * len(lines):
        return Dress(separator="\t", names=common[0])
    separator = next((mark for mark in "\t;|," if sum(mark in line for line in lines) >= _MOST * len(lines)), None)
    if separator is None:
        return None
    rows = [line.split(separator) for line in lines]
    width = Counter(map(len, rows)).most_common(1)[0][0]
    rows = [row for row in rows if len(row) == width]
    units = tuple(_unit_of([row[i] for row in rows]) for i in range(width))
    return Dress(separator=separator, units=units) if any(units) else None


def _pairs(line: str) -> tuple[tuple[str, ...], list[str]] | None:
    """Names and numbers of a line that has nothing else behind its head."""
    line = _COLOURS.sub("", line).strip()
    best: tuple[tuple[str, ...], list[str]] | None = None
    head = 0
    for end in (0, *(match.end() for match in _HEAD_END.finditer(line))):
        # As much as possible is head, or what a logger writes before the first name would belong to it.
        if (found := _chain(line, end)) is not None and (best is None or len(found[0]) >= len(best[0])):
            best, head = found, end
    if best is None or (when := _WHEN.search(line, 0, head)) is None:
        return best
    time = when["simulated"] or next(text for text in when.groups() if text)
    return ("time", *best[0]), [time, *best[1]]


def _chain(line: str, place: int) -> tuple[tuple[str, ...], list[str]] | None:
    """Names and numbers of the line from there on, if there is nothing else."""
    names: list[str] = []
    numbers: list[str] = []
    while place < len(line):
        if (match := _PAIR.match(line, place)) is None:
            return None
        unit = match["unit"]
        if unit and find_unit(unit) is None:
            return None
        names.append(f"{match['name']} [{unit}]" if unit else match["name"])
        numbers.append(match["number"])
        place = match.end()
    return (tuple(names), numbers) if len(set(names)) == len(names) > 1 else None


def _unit_of(cells: Sequence[str]) -> str:
    """The unit that most cells of a column state, "" where they state none that is known."""
    found = Counter(match[2] for cell in cells if (match := _UNIT.fullmatch(cell)) is not None)
    if not found or (common := found.most_common(1)[0])[1] < _MOST * len(cells) or find_unit(common[0]) is None:
        return ""
    return common[0]
