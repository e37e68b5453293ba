"""From a delimited text file to series: finds the time columns and cleans them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError
from asrsim.recordings.data import Raw, RawSeries
from asrsim.recordings.delimited import Table, read_table
from asrsim.recordings.mapping import ColumnMap
from asrsim.recordings.messages import named_joints
from asrsim.recordings.names import VOCABULARY, tokens_of
from asrsim.recordings.stamps import MERGED, merge_date, merge_seconds, one_zero
from asrsim.recordings.timebase import clean_time, scale_time, suspect_time
from asrsim.recordings.units import Unit, find_unit, split_header
from asrsim.samples import Array

_TIME_WORDS = {
    "time",
    "t",
    "timestamp",
    "stamp",
    "zeit",
    "uhrzeit",
    "temps",
    "tempo",
    "tiempo",
    "tijd",
    "elapsed",
    "clock",
    "datetime",
    "date",
    "millis",
    "seconds",
    "epoch",
    "unix",
    "utc",
}
_COUNTERS = {"sample", "samples", "index", "idx", "n", "no", "nr", "count", "counter", "frame", "row", "seq", "cycle"}
"""Names of columns that count rows: they rise evenly and are no time."""
_MARKS = (-999.0, 999.0, -9999.0, 9999.0, -99999.0, 99999.0, -1e9, 1e9)
"""Numbers that some recorders write where they have none."""
_ONE_DAY = 86_400.0
"""s: stamps of two clocks that are nearer than this count from one zero."""
_WHOLE = 0.9
"""Share of rows that must have a stamp for all rows to be of one kind of message."""
_MEASURED = {"at", "rise", "delay", "sample", "step", "constant"}


def read_text(path: Path, maps: Sequence[ColumnMap]) -> Table:
    """The table of a text file; raises RecordingError where it has none, or its header does not fit."""
    table = read_table(path)
    if table.layout.misfit and not any(one.column.lstrip("#").isdigit() for one in maps):
        raise RecordingError(
            Problem(message=table.layout.misfit, file=path, line=table.layout.misfit_line, code="header-misfit",
                    hint="Repair that line, or name the columns by their numbers: --map 1=time --map 2=joint_1.link_position")
        )  # fmt: skip
    return table


def series_of(table: Table, path: Path, maps: Sequence[ColumnMap], rate: float | None, *, form: str = "csv") -> Raw:
    """The series of a table on clean times. Raises RecordingError with what was found and expected."""
    findings = list(table.findings)
    table, epoch = one_zero(table)
    for merge in (merge_seconds, merge_date):
        table, start, merged = merge(table)
        epoch = epoch if start is None else start
        if merged is not None:
            findings.append(Problem(message=merged, file=path, code="split-time"))
    names, stated = zip(*(_name_and_unit(table, i) for i in range(len(table.layout.names))), strict=True)
    if rate is not None:
        time = np.arange(len(table.values)) / rate
        bases = [(-1, time, np.ones(len(time), dtype=bool))]
        epoch = None
    else:
        bases, start = _bases(path, table, names, stated, maps, findings)
        epoch = epoch if start is None else start
    joints = named_joints(table.layout.names, table.words, path.stem)
    series: list[RawSeries] = []
    owner: int | None = None
    times: dict[int, tuple[Array, NDArray[np.bool_]]] = {}
    for column, time, keep in bases:
        same = next((times[c] for c, t, k in bases if c in times and t is time and k is keep), None)
        times[column] = same if same is not None else (time[keep], keep)
    for column, label in enumerate(table.layout.names):
        if column in times:
            owner = column
            continue
        if column in table.layout.text or column in table.layout.stamps:
            continue
        # Columns belong to the time column before them; those before the first belong to the first.
        time, keep = times[owner if owner is not None else bases[0][0]]
        unit = stated[column]
        values = table.values[:, column]
        kept, marked = _unmarked(_kept(values, keep))
        if marked is not None:
            findings.append(Problem(message=marked, file=path, key=label, code="missing-mark"))
        joint, quantity = joints.get(column, (None, None))
        symbol = unit.symbol if unit else ""
        series.append(RawSeries(name=label, time=time, values=kept, unit=symbol, joint=joint, quantity=quantity))
    if not series:
        raise RecordingError(
            Problem(message=f"has one column only ('{table.layout.names[0]}'); expected a time and at least one signal",
                    file=path, code="one-column", hint="For a signal without a time give the sampling rate with --rate")
        )  # fmt: skip
    return Raw(format=form, series=tuple(series), findings=tuple(findings), epoch=epoch, names=table.layout.names)


def _kept(values: Array, keep: NDArray[np.bool_]) -> Array:
    kept = values[keep]
    return np.where(np.isinf(kept), np.nan, kept)


def _unmarked(values: Array) -> tuple[Array, str | None]:
    """Numbers that stand for a missing one (-9999 far outside of all others, at least twice) as NaN, and what was found."""
    finite = values[np.isfinite(values)]
    for mark in _MARKS:
        found = finite == mark
        rest = finite[~found]
        if found.sum() > 1 and len(rest) and np.max(np.abs(rest)) < 0.02 * abs(mark):
            return np.where(values == mark, np.nan, values), f"{int(found.sum())} cells are {mark:g}, which is taken as missing"
    return values, None


def _name_and_unit(table: Table, column: int) -> tuple[str, Unit | None]:
    name, unit = split_header(table.layout.names[column])
    # A column that is called by its unit only: `ms`, `nsec`.
    if unit is None and len(name) > 1 and (only := find_unit(name)) is not None and only.si == "s":
        unit = only
    own = table.layout.units[column]
    return name, find_unit(own) if own else unit


def _bases(
    path: Path,
    table: Table,
    names: Sequence[str],
    stated: Sequence[Unit | None],
    maps: Sequence[ColumnMap],
    findings: list[Problem],
) -> tuple[list[tuple[int, Array, NDArray[np.bool_]]], float | None]:
    """Every time column: its index, its time in s and the rows to keep; and the Unix time of the first one's zero."""
    columns, factors = _time_columns(path, table, names, stated, maps, findings)
    said = any(one.role == "time" and one.unit is not None for one in maps)
    bases: list[tuple[int, Array, NDArray[np.bool_]]] = []
    epoch: float | None = None
    for column in columns:
        label = table.layout.names[column]
        values = table.values[:, column]
        if column in table.layout.stamps:
            time, start = values, None
        else:
            time, start, found = scale_time(values, factors.get(column), path=path, name=label)
            findings += found
            if stated[column] is not None and not said:
                findings += suspect_time(values, factors[column], path=path, name=label)
            if bases and start is not None and epoch is not None and abs(start - epoch) < _ONE_DAY:
                time = time + (start - epoch)
        lines = table.lines
        if bases:
            # A further time column may simply be shorter than the table.
            first, other, _ = bases[0]
            both = np.isfinite(time) & np.isfinite(other)
            if both.sum() > 1 and _same_clock(time[both], other[both]):
                findings.append(
                    Problem(message=f"is the same clock as '{table.layout.names[first]}', which is used", file=path, key=label,
                            code="second-time")
                )  # fmt: skip
                bases.append((column, other, bases[0][2]))
                continue
            findings.append(
                Problem(message=f"is a second time base beside '{table.layout.names[first]}'; the columns after it use it",
                        file=path, key=label, code="second-time-base")
            )  # fmt: skip
            filled = np.isfinite(time)
            keep = np.zeros(len(time), dtype=bool)
            kept, found = clean_time(time[filled], lines[filled], path=path, name=label)
            keep[np.flatnonzero(filled)[kept]] = True
        else:
            epoch = start
            keep, found = clean_time(time, lines, path=path, name=label)
        findings += found
        bases.append((column, time, keep))
    return bases, epoch


def _same_clock(a: Array, b: Array) -> bool:
    """Whether two times tell the same but for their zero."""
    step = float(np.median(np.abs(np.diff(a)))) or 1e-9
    difference = a - b
    return bool(np.max(np.abs(difference - np.median(difference))) < 0.5 * step)


def _time_columns(
    path: Path,
    table: Table,
    names: Sequence[str],
    stated: Sequence[Unit | None],
    maps: Sequence[ColumnMap],
    findings: list[Problem],
) -> tuple[list[int], dict[int, float]]:
    """The columns that hold time, and s per unit where it is known."""
    labels = table.layout.names
    factors = {i: unit.factor for i, unit in enumerate(stated) if unit is not None and unit.si == "s"}
    for one in maps:
        if one.role != "time":
            continue
        index = find_column(one.column, labels)
        if index is None:
            raise RecordingError(
                Problem(message="there is no such column for the time", file=path, key=one.column, choices=tuple(labels),
                        code="no-time")
            )  # fmt: skip
        if one.unit is not None:
            factors[index] = one.unit.factor
        return [index], factors
    mapped = {find_column(one.column, labels) for one in maps}
    free = [i for i in range(len(labels)) if i not in mapped and i not in table.layout.text]
    named = [i for i in free if _is_time(names[i], stated[i])]
    blank = [i for i in named if i not in table.layout.stamps and np.isfinite(table.values[:, i]).sum() < 2]
    if blank and (len(blank) < len(named) or table.layout.stamps):
        findings += [
            Problem(message="is named as a time but has no numbers; not used", file=path, key=labels[i], code="empty-time")
            for i in blank
        ]
        named = [i for i in named if i not in blank]
    # Messages know when they were sent, which is when they were measured; a recorder knows when it got them.
    sent = [i for i in named if _is_stamp(labels[i]) and np.isfinite(table.values[:, i]).mean() > _WHOLE]
    got = [i for i in named if set(tokens_of(labels[i])) & {"rosbag", "rosbagtimestamp"} or labels[i].lower() in ("time", "__time")]
    if sent and got and len(named) == len({*sent, *got}):
        findings.append(
            Problem(message=f"is when messages were sent, and is used; '{labels[got[0]]}' is when they were recorded", file=path,
                    key=labels[sent[0]], code="second-time", hint=f"Use that with --map '{labels[got[0]]}=time'")
        )  # fmt: skip
        return sent[:1], factors
    if named or table.layout.stamps:
        return sorted({*named, *(i for i in table.layout.stamps if not named)}), factors
    # What is named as a signal is no time, however evenly it rises.
    rising = [i for i in free if _rises(table.values[:, i]) and (_nameless(table, i) or not set(tokens_of(names[i])) & VOCABULARY)]
    # A column without a name that counts 0, 1, 2 is an index: pandas writes one, and it is no time in ms.
    counters = [
        i for i in rising
        if _steps_by_one(table.values[:, i]) and (_nameless(table, i) or set(tokens_of(names[i])) & _COUNTERS)
    ]
    rising = [i for i in rising if i not in counters]
    if counters and not rising:
        raise RecordingError(
            Problem(message=f"no time column found; '{labels[counters[0]]}' counts the rows", file=path, code="no-time",
                    hint="Give the sampling rate with --rate, or name the time with --map COLUMN=time [unit]")
        )  # fmt: skip
    if rising:
        findings.append(
            Problem(message="no column is named as the time; this one rises evenly and is taken", file=path,
                    key=labels[rising[0]], hint="Say otherwise with --map COLUMN=time", code="time-guessed")
        )  # fmt: skip
        return rising[:1], factors
    raise RecordingError(
        Problem(message=f"no time column found among {', '.join(labels[:20])}", file=path, code="no-time",
                hint="Expected a column that rises, named time or t; name it with --map COLUMN=time or give --rate")
    )  # fmt: skip


def find_column(wanted: str, labels: Sequence[str]) -> int | None:
    """Index of a column by its header, with or without unit, by case-blind name, or by its number from 1."""
    plain = [split_header(label)[0] for label in labels]
    for candidates in (labels, plain, [label.lower() for label in labels], [label.lower() for label in plain]):
        for spelling in (wanted, wanted.lower()):
            if spelling in candidates:
                return list(candidates).index(spelling)
    if wanted.lstrip("#").isdigit() and 1 <= int(wanted.lstrip("#")) <= len(labels):
        return int(wanted.lstrip("#")) - 1
    return None


def _is_time(name: str, unit: Unit | None) -> bool:
    words = {word for word in tokens_of(name) if not word.isdigit()}
    if unit is not None and unit.si != "s":
        return False
    if words == {"x", "value"}:  # LabVIEW
        return True
    if words & _MEASURED and not words & {"stamp", "timestamp"}:
        return False
    return bool(words & _TIME_WORDS) or (unit is not None and unit.si == "s" and len(words) <= 1)


def _is_stamp(label: str) -> bool:
    """Whether a column is the stamp in the header of messages."""
    return label == MERGED or {"header", "stamp"} <= set(tokens_of(label))


def _nameless(table: Table, column: int) -> bool:
    return column in table.layout.unnamed or table.layout.header_line is None


def _steps_by_one(values: Array) -> bool:
    finite = values[np.isfinite(values)]
    return bool(np.median(np.diff(finite)) == 1.0)


def _rises(values: Array) -> bool:
    """Increases nearly always, by nearly the same step."""
    finite = values[np.isfinite(values)]
    if len(finite) < 3 or len(finite) < 0.9 * len(values):
        return False
    steps = np.diff(finite)
    typical = float(np.median(steps))
    return typical > 0 and float(np.mean(np.abs(steps - typical) < typical)) > 0.95
