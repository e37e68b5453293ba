"""The header of a delimited text file: which line holds the names, which the units, and whether they fit the columns."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from asrsim.recordings.cells import glue, number, printable, share_of_numbers, split
from asrsim.recordings.names import VOCABULARY, tokens_of
from asrsim.recordings.units import find_unit, unknown_unit

_REMARKS = {"", "comment", "comments", "remark", "remarks", "note", "notes"}
"""Last names of headers over columns that no row fills (LabVIEW's "Comment")."""
_NO_UNIT = {"", "-", "[-]", "(-)", "einheit", "einheiten"}
"""What stands in a row of units over a column without one, or over the row's own name."""


@dataclass(frozen=True, kw_only=True)
class Header:
    """What stands above the numbers."""

    names: list[str] | None = None
    """One a column; None: there is none, or it does not fit."""
    units: list[str] | None = None
    """Of a row of their own, below the names or above them."""
    units_line: int | None = None
    """Where these are, or another row that belongs to the header."""
    line: int | None = None
    misfit: str = ""
    """Why a line that looks like a header is not used."""
    scaled: Mapping[str, str] = field(default_factory=dict)
    """Name -> the factor and offset that the header states, of columns that have other ones than 1 and 0."""


def find_header(rows: Sequence[tuple[int, list[str]]], data: Sequence[Sequence[str]], decimal: str) -> Header:
    """The header among the lines above the numbers; `data`: the first rows of numbers, all of one length."""
    columns = len(data[0])
    rows = [(count, _fitted(cells, data)) for count, cells in rows if not cells[0].startswith("***")]
    if not rows:
        return Header()
    fitting = [(count, cells) for count, cells in rows if len(cells) == columns]
    if (paired := _pairs(rows, columns, decimal)) is not None:
        return paired
    count, cells = rows[-1]
    if len(cells) != columns:
        return Header(misfit=_misfit(cells, columns, decimal), line=count)
    if share_of_numbers(cells, decimal) >= 0.5:
        return Header()
    if len(fitting) > 1 and cells[0] and not any(cells[1:]):
        # pandas writes the name of its index below those of the columns.
        above = find_header(rows[:-1], data, decimal)
        if above.names is not None:
            return replace(above, names=[cells[0], *above.names[1:]], units_line=above.units_line or count)
    if len(fitting) > 1 and _says_one_thing(cells):  # "Interp: linear", "DT_DOUBLE" of every column
        return find_header(rows[:-1], data, decimal)
    # A row of units is the last one, the one before the names, or any that begins by saying so (LabVIEW's Y_Unit_Label).
    places = [i for i, (_, row) in enumerate(fitting) if i >= len(fitting) - 2 or "unit" in row[0].lower()]
    for place in reversed(places):
        if len(fitting) > 1 and (units := units_of(fitting[place][1])) is not None:
            others = fitting[:-1] if place == len(fitting) - 1 else fitting[place + 1 :]
            return Header(names=_grouped(others, columns), units=units, line=others[-1][0], units_line=fitting[place][0])
    return Header(names=_grouped(fitting, columns), line=count)


def _pairs(rows: Sequence[tuple[int, list[str]]], columns: int, decimal: str) -> Header | None:
    """The header of a file whose channels have a column of times each, as TwinCAT's scope writes it: `Name; q1; Name; q2`."""
    told = {
        cells[0].lower(): (count, cells[1::2]) for count, cells in rows if len({*cells[::2]}) == 1 and len(cells) == columns
    }
    if columns < 4 or "name" not in told:
        return None
    line, names = told["name"]
    factors = told.get("scalefactor", (None, ["1"] * len(names)))[1]
    offsets = told.get("offset", (None, ["0"] * len(names)))[1]
    numbers = [
        (name, number(factor, decimal), number(offset, decimal))
        for name, factor, offset in zip(names, factors, offsets, strict=True)
    ]
    scaled = {name: f"factor {factor:g} and offset {offset or 0:g}" for name, factor, offset in numbers
              if factor is not None and (factor, offset or 0.0) != (1.0, 0.0)}  # fmt: skip
    units_line, units = told.get("unit", (None, [""] * len(names)))
    return Header(names=[name for own in names for name in ("time", own)], units=[unit for own in units for unit in ("", own)],
                  line=line, units_line=units_line, scaled=scaled)  # fmt: skip


def _says_one_thing(cells: Sequence[str]) -> bool:
    """Whether a row has one remark for all columns, which is no name of a signal nor a unit: `double,double,double`."""
    filled = {cell for cell in cells if cell}
    return sum(map(bool, cells)) > 1 and len(filled) == 1 and not VOCABULARY & {*tokens_of(*filled)} and units_of(cells) is None


def units_of(cells: Sequence[str]) -> list[str] | None:
    """The units of a row of units, "" where it has none; None for any other row. Half of them may be of no spelling known."""
    cells = [re.sub(r"(?i)^unit: *(?=.)", "", cell) for cell in cells]  # MATLAB's "Unit: deg"
    units = ["" if cell.lower() in _NO_UNIT else cell.strip("[](){}<> ") for cell in cells]
    units = ["", *units[1:]] if "unit" in units[0].lower() else units
    filled = [unit for unit in units if unit]
    known = sum(find_unit(unit) is not None for unit in filled)
    unlike = any(find_unit(unit) is None and unknown_unit(f"q [{unit}]") is None for unit in filled)
    return None if unlike or 2 * known <= len(filled) else units


def _fitted(cells: list[str], data: Sequence[Sequence[str]]) -> list[str]:
    """The names over their columns where one is missing or too many and it is clear which."""
    columns = len(data[0])
    while len(cells) > columns and cells[-1].lower() in _REMARKS:
        cells = cells[:-1]
    if len(cells) != columns - 1:
        return cells
    if not any(row[-1] for row in data):
        return [*cells, ""]
    # R and pandas write row numbers without a name for them.
    if counts_rows([row[0] for row in data]):
        return ["", *cells]
    return cells


def counts_rows(cells: Sequence[str]) -> bool:
    """Whether the cells are 0, 1, 2, ... or 1, 2, 3, ..., as numbers or in quotes."""
    plain = [cell.strip("\"'") for cell in cells]
    return len(plain) > 1 and any(plain == [str(i + start) for i in range(len(plain))] for start in (0, 1))


def _misfit(cells: Sequence[str], columns: int, decimal: str) -> str:
    """What is wrong with a header of another length; "" for a line that is no header (a title, a pair of key and value)."""
    words = sum(bool(cell) and share_of_numbers([cell], decimal) == 0.0 for cell in cells)
    if len(cells) == 2 * columns - 1 and re.search(r"\D[-+.]?\d[\d.,eE+-]*$", cells[columns - 1]) and words <= columns:
        return f"the first row of numbers is glued to the header ({columns} columns, {len(cells)} fields in its line)"
    if words < max(2, 0.5 * min(columns, len(cells))) or (len(cells) <= 2 < columns - 1):
        return ""
    return f"the header has {len(cells)} names, its rows have {columns} fields"


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


def comment_header(text: str, separator: str | None, columns: int, decimal: str) -> list[str] | None:
    """A header in the last comment line, as numpy.savetxt writes it."""
    plain = text.lstrip(" #%/").strip()
    for candidate in dict.fromkeys((separator, ",", ";", "\t", None)):
        cells = split(glue(plain, candidate), candidate, quoted='"' in plain)
        if len(cells) == columns:
            # A row of numbers that somebody took out names nothing, however else it could be split.
            return cells if share_of_numbers(cells, decimal) < 0.5 else None
    return None


def comment_units(text: str, separator: str | None, columns: int) -> list[str] | None:
    """A row of units in a comment line, `# units: s, deg, deg`; None for any other."""
    plain = re.sub(r"^[ #%/]*(?:units?\s*:)?", "", text, flags=re.IGNORECASE).strip()
    cells = split(plain, separator, quoted=False)
    return units_of(cells) if len(cells) == columns else None


def with_unknown(name: str, unit: str) -> str:
    """A unit of a row that is of no spelling known stays with the name, so that it is asked about."""
    return f"{name} [{unit}]" if unit and find_unit(unit) is None else name


def unique(names: Sequence[str]) -> tuple[str, ...]:
    """Names without repeats or blanks: the second q becomes q#2, a blank one column_4."""
    seen: Counter[str] = Counter()
    result = []
    for i, name in enumerate(names):
        name = printable(name.strip()) or f"column_{i + 1}"
        seen[name] += 1
        result.append(name if seen[name] == 1 else f"{name}#{seen[name]}")
    return tuple(result)


def unnamed(names: Sequence[str]) -> tuple[int, ...]:
    """Places of blank names, and of pandas' word for them."""
    return tuple(i for i, name in enumerate(names) if not name.strip() or name.startswith("Unnamed:"))
