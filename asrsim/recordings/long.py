"""Long tables, a row for each signal or joint and time, as wide ones: `time, joint, position` or `time, variable, value`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, zip_longest

import numpy as np
from numpy.typing import NDArray

from asrsim.recordings.delimited import Table
from asrsim.recordings.header import unique
from asrsim.recordings.mapping import ColumnMap
from asrsim.recordings.names import find_column, tokens_of
from asrsim.recordings.time_columns import is_stamp, is_time
from asrsim.recordings.units import find_unit, split_header

_WHOSE = {"id", "joint", "motor", "axis", "drive", "servo", "actuator", "channel", "sensor"}
"""Words of a column that says whose a row is, by a name or a number."""
_WHAT = {"field", "variable", "quantity", "signal", "metric", "measurand"}
"""Words of a column that says what is measured, even where all rows say the same."""
_NAMES = _WHOSE | _WHAT | {"name", "topic", "series", "key", "label", "path"}
"""Words of a column of text that says whose a row is; the runs or episodes of a file are no signals."""
_VALUES = {"value", "values", "val", "wert", "valeur"}
"""Names of a column of numbers of which another column says what they are."""
_TURNS = 0.1
"""Share of rows that are of another signal than the row before, where signals of other instants take turns."""
_MOST_KEYS = 3
"""Columns that together say whose a row is."""


def widened(table: Table, maps: Sequence[ColumnMap]) -> tuple[Table, str | None]:
    """A table whose rows are of one signal each, with columns for each of these; and what was done.

    Any other table stays as it is. Signals of other instants have a column of times each.
    """
    names, values = table.layout.names, table.values
    time = _time_of(table, maps)
    found = None if time is None else _keys_of(table, time)
    if time is None or found is None:
        return table, None
    keys, rows = found
    units = [i for i in table.layout.text if names[i].lower() in ("unit", "units") and i in table.words]
    parts = [i for i in range(len(names)) if i not in (time, *keys, *table.layout.text) and not _is_beside(table, i, rows)]
    shared = all(np.array_equal(values[one, time], values[rows[0], time]) for one in rows)
    # The place in the long table, the name and the rows of each column.
    columns: list[tuple[int, str, NDArray[np.intp]]] = []
    for one in rows:
        if not columns or not shared:
            columns.append((time, names[time], one))
        first = {i: table.words[i][int(values[one[0], i])] for i in (*keys, *units) if i in table.words}
        whose = ".".join(first.get(i) or f"{_plain(names[i])}[{values[one[0], i]:g}]" for i in keys)
        stated = "".join(f" [{first[i]}]" for i in units if len({*values[one, i]}) == 1)
        for i in parts:
            name, unit = split_header(names[i])
            label = whose if name.lower().strip("_") in _VALUES else f"{whose}.{name}"
            if np.isfinite(values[one, i]).any():
                columns.append((i, f"{label} [{unit.symbol}]" if unit is not None else label + stated, one))
    layout = replace(
        table.layout, names=unique([name for _, name, _ in columns]), units=tuple(table.layout.units[i] for i, _, _ in columns),
        stamps=tuple(place for place, (i, _, _) in enumerate(columns) if i in table.layout.stamps), text=(), unnamed=(),
    )  # fmt: skip
    wide = np.array(list(zip_longest(*(values[one, i] for i, _, one in columns), fillvalue=np.nan)))
    told = " and ".join(f"'{names[i]}'" for i in keys)
    message = f"has a row for each {told} at each '{names[time]}', {len(rows)} in all; each is read as columns of its own"
    return replace(table, layout=layout, values=wide, lines=table.lines[max(rows, key=len)], words={}), message


def _time_of(table: Table, maps: Sequence[ColumnMap]) -> int | None:
    """The time that was said, else when messages were sent, else the first that is not the same in all rows."""
    names = table.layout.names
    if (told := next((one for one in maps if one.role == "time"), None)) is not None:
        return find_column(told.column, names)
    times = [
        i for i in range(len(names)) if _is_time(table, i) and np.nanmax(np.abs(np.diff(table.values[:, i])), initial=0) > 0
    ]
    return next((i for i in times if is_stamp(names[i])), next(iter(times), None))


def _is_time(table: Table, column: int) -> bool:
    name, unit = split_header(table.layout.names[column])
    stated = find_unit(table.layout.units[column]) or unit
    return column in table.layout.stamps or (column not in table.layout.text and is_time(name, stated))


def _rises(time: NDArray[np.float64]) -> bool:
    return bool(np.all(np.diff(time) > 0))


def _keys_of(table: Table, time: int) -> tuple[tuple[int, ...], list[NDArray[np.intp]]] | None:
    """The fewest columns whose words or numbers part the rows so that time rises within each part; and the parts' rows."""
    said = {i: {*tokens_of(name)} for i, name in enumerate(table.layout.names)}
    texts = [i for i in table.layout.text if i in table.words and said[i] & _NAMES]
    whole = [i for i in range(len(said)) if said[i] & _WHOSE and i not in (time, *table.layout.text) and _counts(table, i)]
    constant = [i for i in texts if len(table.words[i]) == 1 and said[i] & _WHAT]
    several = [*(i for i in texts if len(table.words[i]) > 1), *whole]
    if _rises(table.values[:, time]):  # of signals that take turns, not of a label that changes now and then
        several = [i for i in several if np.mean(np.diff(table.values[:, i]) != 0) > _TURNS]
    for count in range(1, _MOST_KEYS + 1):
        for keys in combinations(several, count):
            _, first, part = np.unique(table.values[:, keys], axis=0, return_index=True, return_inverse=True)
            rows = [np.flatnonzero(part.ravel() == i) for i in np.argsort(first)]
            if all(len(one) > 1 and _rises(table.values[one, time]) for one in rows):
                return tuple(sorted({*keys, *constant})), rows
    return None


def _plain(name: str) -> str:
    """What is numbered: the joint of `joint_id`, and of `id`."""
    return "_".join(word for word in tokens_of(name) if word != "id") or "joint"


def _counts(table: Table, column: int) -> bool:
    """Whether a column has a few whole numbers only, again and again."""
    values = table.values[:, column]
    return bool(np.all(values == np.round(values)) and 1 < len(np.unique(values)) <= min(64, len(values) // 2))


def _is_beside(table: Table, column: int, rows: Sequence[NDArray[np.intp]]) -> bool:
    """Whether a column is of the table and of no signal: another time, a number of rows or of the signal itself."""
    values = table.values[:, column]
    numbers = column in table.layout.unnamed or all(len({*values[one]}) == 1 and values[one[0]].is_integer() for one in rows)
    return numbers or _is_time(table, column)
