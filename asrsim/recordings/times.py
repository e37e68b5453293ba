"""Finds the time column and the time unit of each table. Removes and reports samples whose time does not increase."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError, counted, listed
from asrsim.plain import one_or_more
from asrsim.recordings.data import EPOCH, LARGEST, Content, RawColumn, RawTable, unique
from asrsim.recordings.folders import require_one_time
from asrsim.recordings.names import find_raw
from asrsim.recordings.reading import Reading
from asrsim.recordings.units import UNITS, Unit, find_unit, split_header
from asrsim.recordings.words import tokens_of
from asrsim.samples import Array

TIME_WORDS = {"time", "t", "timestamp", "timestamps", "stamp", "ts", "tout", "elapsed", "clock", "datetime", "date", "seconds",
              "epoch", "unix", "header", "field", "zeit"}  # fmt: skip
TIME_WORDS |= {name.lower() for name, unit in UNITS.items() if unit.si == "s" and unit.factor <= 1.0}
"""Words in the names of time columns. A name with any other word, such as `sample_time` or `time_constant`, is not a time."""
_SYMBOLS = ("s", "ms", "us", "ns")
_LAST = re.compile(r"[\[(]?[^\W\d_]+[\])]?$")
"""Last word of a name, or its unit."""
_DAY = 86400.0
_COUNTERS = (2.0**16, 2.0**32)
"""Numbers of ticks after which counters restart."""
_DURATIONS = ("dt", "delay", "period", "latency", "duration", "jitter")
FASTEST, SLOWEST = 3e-5, 0.5
"""FASTEST: smallest plausible time step, s.
SLOWEST: largest plausible time step, s. If the time step is outside this range, a stated unit is probably wrong, and an
unstated unit is not assumed to be s.
"""
_DIGITS = 9
"""Number of decimals of a second with which stamps are compared. Slopes over shorter steps would overflow."""
_MOST_JOINTS = 1000
"""Largest number of joints in a column that names the joint of each row."""
_COARSE = 0.1
"""The clock is coarser than the sampling if more than this fraction of the samples repeat the stamp of the previous sample."""
_GAP = 1.7
"""A step longer than this multiple of the usual time step contains missing samples."""


def with_times(content: Content, reading: Reading, findings: list[Problem]) -> Content:
    """Content whose tables have strictly increasing times and no time columns.

    Dates become times since the earliest date in the file. Raises RecordingError if no table has a time and a signal.
    """
    faults: list[Problem] = []
    tables: list[RawTable] = []
    seen: Counter[str] = Counter()
    for prefix, part in [part for table in content.tables for part in _by_joint(table, reading.joint)]:
        try:
            timed = _cleaned(_timed(part, reading, findings), findings)
        except RecordingError as error:
            faults += error.problems
            continue
        if timed.columns:
            where = f"{timed.columns[0].file}/".removeprefix("/") + prefix
            columns = tuple(replace(one, name=unique(where + one.name, seen)) for one in timed.columns)
            tables.append(replace(timed, columns=columns))
    if not tables:
        message = "has only a time column; expected a time and at least one signal"
        hint = "For a signal without a time give the sampling rate with --rate"
        raise RecordingError(faults or Problem(message, code="one-column", hint=hint))
    findings += [replace(one, message=f"table is not read: {one.message}", code="unread") for one in faults]
    first = min((table.zero + round(table.time[0] * 1e9) for table in tables if table.zero), default=0)
    tables = [replace(table, time=table.time + (table.zero - first) * 1e-9) if table.zero else table for table in tables]
    require_one_time(tables)
    return replace(content, tables=tuple(tables))


def _by_joint(table: RawTable, name: str | None) -> list[tuple[str, RawTable]]:
    """Tables of single joints, if the column `name` states the joint of each row. Each table is preceded by the prefix of its
    columns' names, such as `elbow.`.

    If `name` is None, the result is the whole table with the prefix "". Raises RecordingError if there is no such column, or if
    it contains too many joints, as a column of numbers does.
    """
    if name is None:
        return [("", table)]
    column = next((one for one in table.columns if one.name == name), None)
    if column is None:
        names = tuple(one.name for one in table.columns[:12])
        raise RecordingError("the file has no such column", key=f"joint: {name}", choices=names, code="no-joint")
    joints = column.values
    different = dict.fromkeys(joints.tolist())
    if len(different) > min(_MOST_JOINTS, len(joints) // 4):
        message = f"names {len(different)} joints in {len(joints)} rows; expected up to {_MOST_JOINTS} with many rows each"
        raise RecordingError(message, key=f"joint: {name}", code="no-joint")
    others = replace(table, columns=tuple(one for one in table.columns if one is not column), time=np.zeros(len(joints)))
    parts = []
    for joint in different:
        label = str(joint).removesuffix(".0")
        parts.append((f"joint_{label}." if label.isdecimal() else f"{label}.", others.selected(joints == joint)))
    return parts


def is_time(name: str, unit: Unit | None = None) -> bool:
    """Whether a name means a time. All of its words must mean a time, or it must be a single word with a unit of time."""
    words = _stem(name)
    if unit is not None:
        return unit.si == "s" and ({*words} <= TIME_WORDS or (len(words) == 1 and words[0] not in _DURATIONS))
    # Accept X_Value, which is LabVIEW's name for the time.
    return words == ["x", "value"] or (bool(words) and {*words} <= TIME_WORDS and words != ["field"])


def is_named_time(column: RawColumn) -> bool:
    """Whether a column is a time, by its name and unit, or since its cells are dates.

    The last part of a path counts, as in `run.time`. However, a last part such as the `s` of `rad.s` is part of a unit.
    """
    name, unit = split_header(column.name)
    last = re.split(r"[./]", name)[-1] or name
    named = is_time(last, unit) and (last == name or last not in _SYMBOLS)
    return column.zero is not None or named


def unit_of_time(column: RawColumn) -> Unit | None:
    """Unit of a time column, from its header, its name (`nanosec`) or the number of digits of its Unix times; None if it is
    unknown.
    """
    plain, unit = split_header(column.name)
    unit = unit or find_unit(re.split(r"[./]", plain)[-1])
    if unit is not None and unit.si == "s":
        return unit
    size = _median(column.values)
    return UNITS[_SYMBOLS[min(int(np.log10(size / EPOCH) / 3), 3)]] if size > EPOCH else None


def _timed(table: RawTable, reading: Reading, findings: list[Problem]) -> RawTable:
    """Table with its times in s and without its time columns. NaN replaces the number that marks missing values.

    The time is in the columns that the user states. If the user states no column, the time is in the first column whose name
    means a time.
    """
    columns, names = table.columns, [column.name for column in table.columns]
    if (lost := reading.missing) is not None:
        columns = tuple(replace(one, values=np.where(one.values == lost, np.nan, one.values)) for one in columns)
    mapped = {find_raw(one.column, columns) for one in reading.maps}
    named = [i for i, column in enumerate(columns) if is_named_time(column) and i not in mapped]
    if reading.time.rate is not None:
        signals = tuple(column for i, column in enumerate(columns) if i not in named)
        return replace(table, columns=signals, time=np.arange(len(columns[0].values)) / reading.time.rate)
    stated = {name: find_raw(name, columns) for name in reading.time.columns}
    missing = [name for name, place in stated.items() if place is None]
    if missing and not table.name:  # a topic without the stated column uses the times of its messages
        raise RecordingError("the file has no such time column", key=missing[0], choices=tuple(names[:12]), code="no-time")
    places = [place for place in stated.values() if place is not None] or _time_columns(columns, named)
    if not places:
        raise RecordingError(
            f"none of the columns is a time: {listed(names, 20)}",
            code="no-time",
            hint="Name the time column with --map COLUMN=time [unit] or the key `time`, or give the sampling rate with --rate",
        )
    if len(named) > 1 and len(places) == 1 and not stated:
        # A flag column may precede the time column. Therefore look for a second time behind the time column first.
        second = next((place for place in named if place > places[0]), named[0])
        _check_second_time(names, places[0], second, findings)
    alone = len(places) == 1
    seconds, zeros, units = zip(*(_seconds(columns[place], reading, findings, alone=alone) for place in places), strict=True)
    clock: dict[str, object] = {"column": names[places[0]] if alone else [names[place] for place in places]}
    if alone and units[0]:
        clock["unit"] = units[0]
    signals = tuple(column for i, column in enumerate(columns) if i not in (*places, *named))
    zero = sum(zeros) if sum(zeros) > EPOCH * 1e9 else 0
    return replace(table, columns=signals, time=np.sum(seconds, axis=0), clock=clock, zero=zero)


def _time_columns(columns: Sequence[RawColumn], named: Sequence[int]) -> list[int]:
    """Index of the time column: the first column whose name means a time. If this column contains the seconds of a stamp and
    the next column contains the fraction of a second, the result is both indices. A column with at most two different values is
    a flag, and is only used if no other column has more values.
    """
    if len(named) > 1 and _are_one_stamp(*(columns[i] for i in named[:2])):
        return [*named[:2]]
    return ([i for i in named if columns[i].zero is not None or len(np.unique(columns[i].values)) > 2] or [*named])[:1]


def _are_one_stamp(whole: RawColumn, part: RawColumn) -> bool:
    """Whether the first of two columns contains whole seconds, and the second contains the nanoseconds (or microseconds, or
    milliseconds) within each second.
    """
    first, second = _LAST.sub("", whole.name), _LAST.sub("", part.name)
    unit, smaller = unit_of_time(whole), unit_of_time(part)
    if first != second or unit is None or smaller is None or unit.factor != 1.0 or smaller.factor >= 1.0:
        return False
    seconds, parts = (one.values[np.isfinite(one.values)] for one in (whole, part))
    return bool(np.all(seconds == np.round(seconds)) and np.all((parts >= 0.0) & (parts * smaller.factor < 1.0)))


def _check_second_time(names: Sequence[str], first: int, second: int, findings: list[Problem]) -> None:
    """Report a second time column. Raises RecordingError for a table such as `time, q1, time, q2`, which has two clocks."""
    hint = f"State the time of all columns: --map '{names[second]}=time'"
    if second > first + 1 and _stem(names[first]) == _stem(names[second]):
        message = f"is a second time column; state one, and ignore the columns with another time: {listed(names, 20)}"
        raise RecordingError(message, key=names[second], code="second-time", hint=hint)
    message = f"is a second time column; '{names[first]}' is used"
    findings.append(Problem(message, key=names[second], hint=hint, code="second-time"))


def _stem(name: str) -> list[str]:
    """Words of a name, without its numbers. Therefore `t1` and `t2` have equal words, and `time` and `time#2` have equal
    words.
    """
    return [word for word in tokens_of(name) if not word.isdecimal()]


def _seconds(column: RawColumn, reading: Reading, findings: list[Problem], *, alone: bool) -> tuple[Array, int, str]:
    """Times of a column in s, the reading of the clock at time 0 in ns, and the unit of the column ("" for dates).

    Unix times are relative to the first time. alone: whether this column is the whole time, not one of two columns that are
    added.
    """
    name, values = column.name, np.where(np.abs(column.values) < LARGEST, column.values, np.nan)
    if column.zero is not None:
        return _continued(values, (_DAY,), name, "s", findings) if alone else values, column.zero, ""
    if not np.isfinite(values).any():
        raise RecordingError("the time column has no number", key=name, code="no-time")
    unit = reading.time.stated or unit_of_time(column) or (UNITS["s"] if reading.in_seconds else None)
    if unit is None and not alone:
        raise RecordingError(
            "is one of two columns whose sum is the time, so its name must end with a unit of time, such as nanosec",
            key=name,
            code="unknown-unit",
        )
    if reading.time.stated is None and alone:
        _check_steps(values, unit, name=name, findings=findings)
    unit = unit or UNITS["s"]
    if alone:
        values = _continued(values, (_DAY / unit.factor, *_COUNTERS), name, unit.symbol, findings)
    size = _median(values)
    if size * unit.factor <= EPOCH:
        return values * unit.factor, 0, unit.symbol
    zero = float(values[np.abs(values - size) * unit.factor < EPOCH][0])
    # A floating-point number of 1.7e9 s has a resolution of 2.4e-7 s. Rounding restores the written digits, such as 0.2 s
    # instead of 0.20000005 s.
    digits = int(np.floor(-np.log10(np.spacing(size) * unit.factor)))
    return np.round((values - zero) * unit.factor, digits), round(zero * unit.factor * 1e9), unit.symbol


def _continued(values: Array, periods: Sequence[float], name: str, unit: str, findings: list[Problem]) -> Array:
    """Times to which a period is added after each restart, so that they increase when a clock passes midnight or a counter
    restarts. The restarts are reported. Times without restarts are unchanged.

    periods: possible readings after which the clock restarts, in the column's unit.
    """
    known = np.flatnonzero(np.isfinite(values))
    steps = np.diff(values[known])
    falls, usual = steps[steps < 0.0], steps[steps > 0.0]
    if not len(falls) or len(falls) > 0.1 * len(steps):
        return values
    near = 10.0 * float(np.median(usual)) if len(usual) else 0.0
    period = next((one for one in periods if np.all((falls + one > 0.0) & (falls + one <= near)) and near < 0.1 * one), None)
    if period is None:
        return values
    again = f"restarts {counted(len(falls), 'time')} after {period:g} {unit}"
    message = f"{again}, as a clock does at midnight, or a counter when it is full"
    findings.append(
        Problem(f"{message}; this period is added to the times after each restart", key=name, code="restarted-clock")
    )
    found = values.copy()
    found[known[1:]] += period * np.cumsum(steps < 0.0)
    return found


def _median(values: Array) -> float:
    """Median of the values that are numbers; 0 if no value is a number."""
    known = values[np.isfinite(values)]
    return float(np.percentile(known, 50, method="nearest")) if len(known) else 0.0


def _check_steps(values: Array, unit: Unit | None, *, name: str, findings: list[Problem]) -> None:
    """Report time steps that are implausible in the stated unit. Raises RecordingError if they are implausible in s and no unit
    is stated.
    """
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    if len(steps) and np.median(steps) == 0.0:
        return  # most stamps repeat, which `_cleaned` reports
    step = float(np.median(steps[steps > 0])) * (unit.factor if unit else 1.0) if steps.any() else SLOWEST
    if FASTEST <= step <= SLOWEST:
        return
    message = f"its samples are {step:g} {'s' if unit else 'units'} apart: is the time in another unit than s?"
    hint = f"State the unit (s, ms, us, ns, min, h, days): `{name} [ms]` in the header, or --map '{name}=time [ms]'"
    problem = Problem(message, key=name, hint=hint, code="suspected-time" if unit else "time-unit")
    if unit is None:
        raise RecordingError(problem)
    findings.append(problem)


def _coarse_clock(table: RawTable, repeated: NDArray[np.intp]) -> tuple[float, float] | None:
    """Step of a coarse clock, s, and mean rate of the samples, Hz. None unless many samples repeat the stamp, but not the
    values, of the previous sample. repeated: indices of the samples that repeat a stamp.
    """
    stamps, firsts = np.unique(np.round(table.time[np.isfinite(table.time)], _DIGITS), return_index=True)
    if len(repeated) <= max(2, _COARSE * len(table.time)) or len(stamps) < 2:
        return None
    series = [column.values for column in table.columns if column.values.dtype.kind == "f"]
    changed = np.any([values[repeated] != values[repeated - 1] for values in series], axis=0)
    if np.mean(changed) <= _COARSE:
        return None
    # Leave out the first and the last stamp, since they may have fewer samples than the stamps between them.
    begin = min(1, len(stamps) - 2)
    return float(np.min(np.diff(stamps))), float((firsts[-1] - firsts[begin]) / (stamps[-1] - stamps[begin]))


def _cleaned(table: RawTable, findings: list[Problem]) -> RawTable:
    """Table of the samples whose times strictly increase. Removed samples and gaps are reported.

    The first of several samples with equal stamps is kept. Raises RecordingError if many samples are removed, or if the time
    jumps far, as in a file with two time bases or two recordings.
    """
    time, name = table.time, table.name or str(one_or_more(table.clock.get("column", "time"))[0])
    keep = np.ones(len(time), dtype=bool)

    def leave_out(bad: NDArray[np.intp], noun: str, code: str, most: float, why: str) -> None:
        """Remove the samples `bad`. Raises RecordingError if more than the fraction `most` of all samples is bad.

        noun: words for a bad sample in messages; why: reasons in the message of the error.
        """
        if not len(bad):
            return
        keep[bad] = False
        message, line = counted(len(bad), noun), table.line(bad[0])
        if len(bad) > max(2, most * len(time)):
            message += f", the first is {table.places(bad[:1])} with {time[bad[0]]:g} s: {why}"
            raise RecordingError(message, key=name, line=line, hint="Split the file, or give --rate", code=code)
        findings.append(Problem(f"{message}, left out: {table.places(bad)}", key=name, code=code, line=line))

    leave_out(np.flatnonzero(~np.isfinite(time)), "non-numeric time stamp", "bad-time", 1.0, "")
    stamps = np.round(time, _DIGITS)
    valid = np.flatnonzero(keep)
    repeated = valid[1:][np.diff(stamps[valid]) == 0]
    why = (
        "its times have too few digits, or each row belongs to another joint (state the column with the joint: "
        "`joint: name`), or the time is in two columns (state both: `time: [sec, nanosec]`)"
    )
    if (coarse := _coarse_clock(table, repeated)) is not None:
        step, rate = coarse
        message = f"has steps of {step:g} s, so {len(repeated)} of {len(valid)} samples repeat the time of the sample before"
        hint = (
            f"If the samples are even, state --rate {rate:.3g}; if the rows alternate between several joints, state "
            "`joint: name`"
        )
        raise RecordingError(message, key=name, line=table.line(repeated[0]), hint=hint, code="coarse-clock")
    leave_out(repeated, "repeated time stamp", "repeated-time", 0.5, why)
    valid = np.flatnonzero(keep)
    t = stamps[valid]
    # A stamp that jumps back is at or below an earlier stamp. A stamp that jumps ahead is at or above a later stamp. Remove the
    # smaller set.
    behind = np.diff(np.maximum.accumulate(t), prepend=-np.inf) == 0
    ahead = np.diff(np.minimum.accumulate(t[::-1])[::-1], append=np.inf) == 0
    odd = valid[min(behind, ahead, key=np.sum)]
    leave_out(odd, "non-increasing time stamp", "falling-time", 0.1, "the file may contain two clocks or two recordings")
    if keep.sum() < 2:
        message = f"only {counted(int(keep.sum()), 'sample')} with increasing times; at least 2 are needed"
        raise RecordingError(message, key=name, code="too-short")
    found = table.selected(keep)
    t, steps = found.time, np.diff(found.time)
    worst = int(np.argmax(steps))
    if len(steps) > 2 and steps[worst] > max(3600.0, 1e3 * (np.sum(steps) - steps[worst])):
        message = f"time jumps from {t[worst]:g} s to {t[worst + 1]:g} s: the file may contain two clocks or two recordings"
        raise RecordingError(message, key=name, hint="Split the file", code="two-time-bases")
    typical = float(np.median(steps))
    if (missing := int(np.sum(np.round(steps[steps > _GAP * typical] / typical) - 1))) > 0:
        message = f"{counted(missing, 'missing sample')}; the longest gap is {steps[worst]:.4g} s at t = {t[worst]:.6g} s"
        findings.append(Problem(message, key=name, line=found.line(worst), code="dropped-samples"))
    return found
