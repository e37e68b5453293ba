"""From a delimited text file to series: finds the time columns and cleans them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError, listed
from asrsim.recordings.cells import number
from asrsim.recordings.data import Raw, RawSeries
from asrsim.recordings.delimited import Table, read_table
from asrsim.recordings.long import widened
from asrsim.recordings.mapping import ColumnMap
from asrsim.recordings.messages import mixed_names, named_joints
from asrsim.recordings.names import find_column
from asrsim.recordings.stamps import merge_date, merge_seconds, one_zero, past_midnight
from asrsim.recordings.time_columns import TIME_WORDS, named_clock, time_columns
from asrsim.recordings.timebase import clean_time, scale_time, suspect_time
from asrsim.recordings.units import Unit, find_unit, split_header, unknown_unit
from asrsim.samples import Array

_MARKS = (-999.0, 999.0, -9999.0, 9999.0, -99999.0, 99999.0, -1e9, 1e9)
"""Numbers that some recorders write where they have none."""
_EXACT = 1e-3
"""Of a step: what two times that are one may be apart by their rounding."""
_ONE_DAY = 86_400.0
"""s: stamps of two clocks that are nearer than this count from one zero."""


def read_text(path: Path, maps: Sequence[ColumnMap]) -> Table:
    """The table of a text file; raises RecordingError where it has none, or its header does not fit."""
    table = read_table(path)
    if table.layout.misfit and not any(one.column.lstrip("#").isdecimal() for one in maps):
        raise RecordingError(
            table.layout.misfit, file=path, line=table.layout.misfit_line, code="header-misfit",
            hint="Repair that line, or name the columns by their numbers: --map 1=time --map 2=joint_1.link_position",
        )  # fmt: skip
    _refuse_one_x(table, path)
    for name, said in table.layout.scaled.items():
        if find_column(name, [one.column for one in maps]) is None:
            raise RecordingError(
                f"its header states {said}, and not whether the numbers have them already", file=path, key=name, code="scaled",
                hint=f"Say so: --map '{name}=JOINT.link_position [unit]', with a factor before the joint where they have not; "
                f"or --map '{name}=ignore'",
            )  # fmt: skip
    return table


def _refuse_one_x(table: Table, path: Path) -> None:
    """Raise where LabVIEW's header tells other starts or steps of the channels than the one column of times can have."""
    if sum(name.partition("#")[0] == "X_Value" for name in table.layout.names) != 1:
        return
    told = {line.split()[0]: [number(cell, table.layout.decimal) for cell in line.split()[1:]]
            for line in table.layout.remarks.splitlines() if line.startswith(("X0", "Delta_X"))}  # fmt: skip
    steps = [step for step in told.get("Delta_X", []) if step]
    for key, values in told.items():
        numbers = [value for value in values if value is not None]
        if len(numbers) > 1 and steps and max(numbers) - min(numbers) > 0.5 * min(steps) * (1.0 if key == "X0" else 0.01):
            raise RecordingError(
                f"its channels have {key} of {', '.join(f'{one:g}' for one in numbers)}, but one column of times", file=path,
                key="X_Value", code="one-x", hint="Save it with one X column a channel (X_Columns Multi)",
            )  # fmt: skip


def series_of(table: Table, path: Path, maps: Sequence[ColumnMap], rate: float | None, *, form: str = "csv") -> Raw:
    """The series of a table on clean times. Raises RecordingError with what was found and expected."""
    findings = list(table.findings)
    table, passed = past_midnight(table)
    if passed is not None:
        findings.append(Problem(passed, file=path, code="midnight"))
    table, epoch = one_zero(table)
    for merge in (merge_seconds, merge_date):
        table, start, merged = merge(table)
        epoch = epoch if start is None else start
        if merged is not None:
            findings.append(Problem(merged, file=path, code="split-time"))
    mixed = mixed_names(table.layout.names, table.layout.text, _same_in_all(table))
    if mixed is not None and not maps:
        raise RecordingError(
            "names other joints from row to row: its columns are of several joints", file=path, key=mixed, code="mixed-joints",
            hint="Keep the rows of one publisher, or say with --map what a column is",
        )  # fmt: skip
    table, made = widened(table, maps)
    if made is not None:
        findings.append(Problem(made, file=path, code="long-table"))
    names, stated = zip(*(_name_and_unit(table, i) for i in range(len(table.layout.names))), strict=True)
    if rate is not None:
        time = np.arange(len(table.values)) / rate
        bases = [(-1, time, np.ones(len(time), dtype=bool))]
        epoch = None
    else:
        bases, start = _bases(path, table, names, stated, maps, findings)
        epoch = epoch if start is None else start
    joints = named_joints(table.layout.names, _same_in_all(table), path.stem)
    series: list[RawSeries] = []
    owners = _owners(table, [column for column, _, _ in bases])
    times: dict[int, tuple[Array, NDArray[np.bool_]]] = {}
    for column, time, keep in bases:
        same = next((times[c] for c, t, k in bases if c in times and t is time and k is keep), None)
        times[column] = same if same is not None else (time[keep], keep)
    for column, owner in owners.items():
        time, keep = times[owner]
        label, unit = table.layout.names[column], stated[column]
        values = table.values[:, column]
        kept, marked = _unmarked(_kept(values, keep))
        if marked is not None:
            findings.append(Problem(marked, file=path, key=label, code="missing-mark"))
        joint, quantity = joints.get(column, (None, None))
        symbol = unit.symbol if unit else ""
        series.append(RawSeries(name=label, time=time, values=kept, unit=symbol, joint=joint, quantity=quantity))
    if not series:
        raise RecordingError(
            f"has one column only ('{table.layout.names[0]}'); expected a time and at least one signal", file=path,
            code="one-column", hint="For a signal without a time give the sampling rate with --rate",
        )  # fmt: skip
    return Raw(format=form, series=tuple(series), findings=tuple(findings), epoch=epoch, names=table.layout.names,
               remarks=table.layout.remarks)  # fmt: skip


def _owners(table: Table, clocks: Sequence[int]) -> dict[int, int]:
    """Signal's column -> the time column that it belongs to: the one before it, or behind it where signals begin and a time
    ends the table. Where times do not take turns with signals, or stand behind them, one that is named as the column's own
    comes first; columns before the first time belong to that."""
    names, layout = table.layout.names, table.layout
    signals = [i for i in range(len(names)) if i not in clocks and i not in layout.text and i not in layout.stamps]
    filled = [i for i in signals if np.isfinite(table.values[:, i]).any()]
    behind = bool(filled) and filled[0] < clocks[0] and filled[-1] < clocks[-1]
    turns = not behind and all(b > a + 1 for a, b in pairwise(clocks))
    by_name = {} if turns else {names[clock]: clock for clock in clocks}
    owners: dict[int, int] = {}
    for column in signals:
        near = [c for c in clocks if c > column] if behind else [c for c in reversed(clocks) if c < column]
        own = named_clock(names[column], list(by_name)) if len(by_name) > 1 else None
        owners[column] = by_name[own] if own is not None else next(iter(near), clocks[0])
    return owners


def _same_in_all(table: Table) -> dict[int, str]:
    """Column of text -> its one word, where it is the same in all rows."""
    return {column: found[0] for column, found in table.words.items() if len(found) == 1}


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
    own = find_unit(table.layout.units[column])
    return name, own or unit


def _bases(
    path: Path,
    table: Table,
    names: Sequence[str],
    stated: Sequence[Unit | None],
    maps: Sequence[ColumnMap],
    findings: list[Problem],
) -> tuple[list[tuple[int, Array, NDArray[np.bool_]]], float | None]:
    """Every time column: its index, its time in s and the rows to keep; and the Unix time of the first one's zero."""
    columns, factors = time_columns(path, table, names, stated, maps, findings)
    said = any(one.role == "time" and one.unit is not None for one in maps)
    bases: list[tuple[int, Array, NDArray[np.bool_]]] = []
    epoch: float | None = None
    owners = _owners(table, columns)
    for column in columns:
        label = table.layout.names[column]
        values = table.values[:, column]
        if column in table.layout.stamps:
            time, start = values, None
        else:
            _refuse_unknown_unit(label, factors.get(column), path)
            time, start, found = scale_time(values, factors.get(column), path=path, name=label)
            findings += found
            if column in factors and stated[column] is not None and not said:
                findings += suspect_time(values, factors[column], path=path, name=label)
            if bases and start is not None and epoch is not None and abs(start - epoch) < _ONE_DAY:
                time = time + (start - epoch)
        lines = table.lines
        if bases:
            # A further time column may simply be shorter than the table.
            first, other, _ = bases[0]
            both = np.isfinite(time) & np.isfinite(other)
            # Dates side by side are of two clocks of which one goes wrong; what counts from a start is later where it says so.
            one = label.partition("#")[0] == table.layout.names[first].partition("#")[0]
            counts = start is None and column not in table.layout.stamps and np.nanmax(other) > np.nanmin(time)
            apart = (one or bool(counts)) and {first, column} <= set(owners.values())
            if both.sum() > 1 and _same_clock(time[both], other[both], apart=apart):
                findings.append(
                    Problem(f"is the same clock as '{table.layout.names[first]}', which is used", file=path, key=label,
                            code="second-time")
                )  # fmt: skip
                bases.append((column, other, bases[0][2]))
                continue
            users = listed([table.layout.names[signal] for signal, owner in owners.items() if owner == column], 8)
            findings.append(
                Problem(f"is a second time base beside '{table.layout.names[first]}'; it is that of {users or 'no signal'}",
                        file=path, key=label, code="second-time-base")
            )  # fmt: skip
            filled = np.isfinite(time)
            keep = np.zeros(len(time), dtype=bool)
            kept, found = clean_time(time[filled], lines[filled], path=path, name=label)
            keep[np.flatnonzero(filled)[kept]] = True
        else:
            epoch = start
            _refuse_short_stamps(table, column, path)
            keep, found = clean_time(time, lines, path=path, name=label)
        findings += found
        bases.append((column, time, keep))
    return bases, epoch


def _refuse_unknown_unit(label: str, factor: float | None, path: Path) -> None:
    unit = unknown_unit(label) if factor is None else None
    if unit is not None and unit.lower() not in TIME_WORDS:
        raise RecordingError(
            f"the unit of this time is not known: {unit}", file=path, key=label, code="unknown-unit",
            hint=f"State it: --map '{label}=time [ms]'",
        )  # fmt: skip


def _refuse_short_stamps(table: Table, column: int, path: Path) -> None:
    """Raise where most stamps repeat the one before though the other columns go on: what is between them is not known."""
    repeated = np.diff(table.values[:, column]) == 0
    others = np.delete(table.values, [column, *table.layout.text], axis=1)
    moved = np.any(np.diff(others, axis=0) != 0, axis=1, where=np.isfinite(others[1:]) & np.isfinite(others[:-1]))
    if repeated.sum() > 0.5 * len(repeated) and moved[repeated].mean() > 0.5:
        names = table.layout.names
        rows = " or there is a row for each of " + ", ".join(names[i] for i in table.layout.text) if table.layout.text else ""
        raise RecordingError(
            f"{repeated.sum()} of {len(repeated) + 1} rows have the time of the row before, and other numbers: "
            f"time is written with too few digits{rows}", file=path, key=names[column], code="repeated-time",
            hint="Give the sampling rate with --rate" + (", or a column to each of these" if rows else ""),
        )  # fmt: skip


def _same_clock(a: Array, b: Array, *, apart: bool) -> bool:
    """Whether two times tell the same but for their zero; apart: each has columns of its own, and its zero counts."""
    step = float(np.median(np.abs(np.diff(a)))) or 1e-9
    later = a - b
    zero = float(np.median(later))
    return bool(np.max(np.abs(later - zero)) < 0.5 * step) and not (apart and abs(zero) > _EXACT * step)
