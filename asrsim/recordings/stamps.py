"""Times that stand in two columns of a table: seconds and nanoseconds, a date and a time of day."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from asrsim.recordings.delimited import Table
from asrsim.recordings.names import tokens_of
from asrsim.recordings.timebase import EPOCH
from asrsim.samples import Array

MERGED = "time [s]"
"""Name of a time that stood in two columns."""
_DAY = 86_400_000_000_000
"""ns."""
_PARTS = (
    ("sec", "nanosec", 1e-9), ("sec", "nsec", 1e-9), ("secs", "nsecs", 1e-9), ("sec", "usec", 1e-6), ("secs", "usecs", 1e-6),
    ("sec", "msec", 1e-3), ("sec", "mikrosec", 1e-6), ("sec", "microsec", 1e-6), ("seconds", "nanoseconds", 1e-9),
    ("seconds", "microseconds", 1e-6),
)  # fmt: skip
"""Last words of two columns that are one time, and s of the second's unit."""


def past_midnight(table: Table) -> tuple[Table, str | None]:
    """Times of day that begin anew at midnight go on, and what was done."""
    values = table.values
    for column, zero in table.zeros.items():
        if zero < _DAY:
            time = values[:, column]
            days = np.cumsum(np.r_[0.0, np.diff(time) < -0.9 * _DAY * 1e-9])
            if days[-1]:
                values = values.copy()
                values[:, column] = time + days * (_DAY * 1e-9)
    if values is table.values:
        return table, None
    return replace(table, values=values), "the time passes midnight, and goes on"


def one_zero(table: Table) -> tuple[Table, float | None]:
    """All columns of stamps on the zero of the first, but a date beside a time of day; and its Unix time in s."""
    dates = [i for i, zero in table.zeros.items() if zero % _DAY == 0]
    clocks = [i for i, zero in table.zeros.items() if zero < _DAY]
    if not table.zeros or (len(dates) == 1 and len(clocks) == 1 and dates != clocks):
        return table, None
    first = next(iter(table.zeros.values()))
    values = table.values.copy() if len(table.zeros) > 1 else table.values
    for column, zero in table.zeros.items():
        if zero != first:
            values[:, column] += (zero - first) * 1e-9
    return replace(table, values=values), first * 1e-9


def parts_of(names: Sequence[str]) -> tuple[int, int, float] | None:
    """Places of seconds and of their parts among names, and s of the parts' unit; None where there are none."""
    ends = [tokens_of(name)[-1:] for name in names]
    for whole, part, unit in _PARTS:
        if [whole] in ends and [part] in ends:
            return ends.index([whole]), ends.index([part]), unit
    return None


def merge_seconds(table: Table) -> tuple[Table, float | None, str | None]:
    """Seconds and their parts in two columns (a ROS stamp, a timeval) as one time, its Unix zero in s, and what was done."""
    if (parts := parts_of(table.layout.names)) is not None:
        i, j, unit = parts
        seconds, rest = table.values[:, i], table.values[:, j] * unit
        # From the first whole second: a float of 1.7e9 s resolves 2.4e-7 s only.
        finite = seconds[np.isfinite(seconds)]
        zero = float(finite[0]) if len(finite) and abs(finite[0]) > EPOCH else 0.0
        said = f"'{table.layout.names[i]}' and '{table.layout.names[j]}' are read as one time in s"
        return _merged(table, i, j, seconds - zero + rest), zero or None, said
    if table.layout.header_line is None and table.values.shape[1] > 2:
        # What `ros2 topic echo --csv` prints has no header: whole seconds since 1970, then nanoseconds.
        seconds, rest = table.values[:, 0], table.values[:, 1]
        integers = bool(np.all(seconds == np.round(seconds)) and np.all(rest == np.round(rest)))
        if integers and np.min(seconds) > EPOCH and np.max(seconds) < 1e11 and np.min(rest) >= 0 and 1e6 < np.max(rest) < 1e9:
            said = "columns 1 and 2 are read as one time in s and ns"
            return _merged(table, 0, 1, seconds - seconds[0] + rest * 1e-9), float(seconds[0]), said
    return table, None, None


def merge_date(table: Table) -> tuple[Table, float | None, str | None]:
    """A date and a time of day in two columns as one time, its Unix zero in s, and what was done."""
    if len(table.layout.stamps) != 2 or len(table.zeros) != 2:
        return table, None, None
    i, j = table.layout.stamps
    if (table.zeros[i] % _DAY == 0) == (table.zeros[j] % _DAY == 0) or min(table.zeros[i], table.zeros[j]) >= _DAY:
        return table, None, None
    said = f"'{table.layout.names[i]}' and '{table.layout.names[j]}' are read as one time"
    start = (table.zeros[i] + table.zeros[j]) * 1e-9
    return _merged(table, i, j, table.values[:, i] + table.values[:, j]), start, said


def _merged(table: Table, i: int, j: int, time: Array) -> Table:
    """The table with a time in s in the place of column i, and without column j."""
    values = table.values.copy()
    values[:, i] = time
    names = list(table.layout.names)
    names[i] = MERGED
    keep = [k for k in range(len(names)) if k != j]
    index = {old: new for new, old in enumerate(keep)}
    layout = replace(
        table.layout, names=tuple(names[k] for k in keep), units=tuple("" if k == i else table.layout.units[k] for k in keep),
        stamps=tuple(index[k] for k in table.layout.stamps if k not in (i, j)),
        text=tuple(index[k] for k in table.layout.text if k in index),
    )  # fmt: skip
    words = {index[k]: word for k, word in table.words.items() if k in index}
    return replace(table, layout=layout, values=values[:, keep], words=words)
