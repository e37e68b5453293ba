"""Numbers that carry their name (`q1:0.5,q2:0.3`, as Arduino's plotter takes them) or their unit (`0.5deg`) in every line."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from asrsim.recordings.units import find_unit

_NUMBER = r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?"
_PLAIN_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|nan|inf"
_PAIR = re.compile(rf"(?P<name>[^\W\d][^:=,;\t|]*?)\s*[:=]\s*(?P<number>{_PLAIN_NUMBER})(?:\s*[,;\t|]\s*|\s+|$)", re.IGNORECASE)
_WHEN = re.compile(r"\s*(\d\d:\d\d:\d\d(?:[.,]\d+)?)[\t;,| ]")
"""The time that a terminal writes before a line."""
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
    """Names and numbers of a line of nothing else, but when it came."""
    names: list[str] = []
    numbers: list[str] = []
    if (when := _WHEN.match(line)) is not None:
        names, numbers = ["time"], [when[1]]
    place = when.end() if when is not None else len(line) - len(line.lstrip())
    end = len(line.rstrip())
    while place < end:
        if (match := _PAIR.match(line, place, end)) is None:
            return None
        names.append(match["name"])
        numbers.append(match["number"])
        place = match.end()
    return (tuple(names), numbers) if len(set(names)) == len(names) > 1 else None


def _unit_of(cells: Sequence[str]) -> str:
    """The unit that most cells of a column state, "" where they state none that is known."""
    found = Counter(match[2] for cell in cells if (match := _UNIT.fullmatch(cell)) is not None)
    if not found or (common := found.most_common(1)[0])[1] < _MOST * len(cells) or find_unit(common[0]) is None:
        return ""
    return common[0]
