"""Finds the time column and time unit of each table, and removes samples whose time does not increase. All is reported."""

from __future__ import annotations

import json
import re
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError, listed
from asrsim.recordings.data import Content, RawColumn, RawSeries, RawTable
from asrsim.recordings.names import find_raw, tokens_of
from asrsim.recordings.reading import Reading
from asrsim.recordings.units import Unit, find_unit, split_header
from asrsim.samples import Array

TIME_WORDS = {"time", "times", "t", "timestamp", "timestamps", "stamp", "ts", "tout", "elapsed", "clock", "datetime", "date",
              "seconds", "sec", "secs", "millis", "micros", "nanos", "epoch", "unix", "utc", "header", "field", "rosbag",
              "zeit", "s", "ms", "us", "ns"}  # fmt: skip
"""Words that make a column's name a time. A name with any other word is not a time: `sample_time`, `time_constant`."""
_DURATIONS = ("dt", "delay", "period", "latency", "duration", "jitter")
_FRACTIONS = {"nanosec": 1e-9, "nsec": 1e-9, "nsecs": 1e-9, "nanoseconds": 1e-9, "usec": 1e-6, "usecs": 1e-6}
"""Last word in the name of a column with fractions of a second -> size of its unit, s."""
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
EPOCH = 1e8
"""Times above this value are Unix times (1973 and later), s."""
FASTEST, SLOWEST = 3e-5, 0.5
"""Plausible time steps, s: outside of this range, a stated unit is suspected to be wrong, and no unit is assumed."""
_DIGITS = 9
"""Decimals of a second to which stamps are compared; slopes over shorter steps would overflow."""
_SAME_CLOCK = 1.0
"""Largest difference between header stamps and times of recording on one clock, s."""
_GAP = 1.7
"""Ratio to the usual time step above which a step contains missing samples."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Time of a table, and the columns that it was made of."""

    name: str
    seconds: Array
    """Times (n,), s; NaN where a row has none."""
    zero: int = 0
    """Clock reading at which `seconds` is 0, ns; 0 for times that are neither dates nor stamps."""
    used: frozenset[int] = frozenset()
    """Indices of the columns that are times, not signals."""
    described: str = ""
    """Column and unit of the time, in the syntax of a reading document."""


def series_of(content: Content, reading: Reading, findings: list[Problem]) -> tuple[list[RawSeries], float | None]:
    """All columns at strictly increasing times, and the Unix time of time 0 in s (None without dates).

    Dates count from the earliest date in the file. Raises RecordingError where no table has a time.
    """
    faults: list[Problem] = []
    found: list[tuple[RawTable, Clock, NDArray[np.bool_]]] = []
    for table in content.tables:
        try:
            if table.received is None or any(find_raw(name, table.columns) is not None for name in reading.time.columns):
                clock = _of_columns(table, reading, findings)
            else:
                clock = _of_messages(table, reading, findings)
            found.append((table, clock, clean_time(clock.seconds, table.lines, name=clock.name, findings=findings)))
        except RecordingError as error:
            faults += error.problems
    starts = [clock.zero + round(clock.seconds[keep][0] * 1e9) for _, clock, keep in found if clock.zero > EPOCH * 1e9]
    first = min(starts, default=0)
    series: list[RawSeries] = []
    for table, clock, keep in found:
        zero = clock.zero - first if clock.zero > EPOCH * 1e9 else clock.zero if table.received is not None else 0
        time = clock.seconds[keep] + zero * 1e-9
        series += [
            RawSeries(column=column, time=time, values=column.values[keep], clock=clock.described)
            for i, column in enumerate(table.columns) if i not in clock.used
        ]  # fmt: skip
    if not series:
        message = "has only a time column; expected a time and at least one signal"
        hint = "For a signal without a time give the sampling rate with --rate"
        raise RecordingError(faults or Problem(message, code="one-column", hint=hint))
    findings += [replace(one, message=f"table is not read: {one.message}", code="unread") for one in faults]
    return series, first * 1e-9 if starts else None


def _of_messages(table: RawTable, reading: Reading, findings: list[Problem]) -> Clock:
    """Time of messages: header stamps if the user chose them or they agree with the times of recording, which are used else."""
    received, stamped = np.asarray(table.received), table.stamped
    lag = np.inf if stamped is None else float(np.median(stamped - received)) * 1e-9
    by_header = reading.time.columns == ("header",) or (reading.time.columns != ("received",) and abs(lag) < _SAME_CLOCK)
    ns = stamped if by_header and stamped is not None else received
    if stamped is not None and not by_header and not reading.time.columns:
        message = f"two time bases: header stamps differ by {abs(lag):.6g} s from the time of recording, which is used"
        findings.append(
            Problem(message, key=table.name, code="two-time-bases", hint="Use the stamps with `time: header` in its document")
        )
    if table.stamped is None:
        findings += [
            Problem("has the name of a time, but the time of recording is used", key=column.name, code="two-time-bases",
                    hint=f"To use this column: --map '{column.name}=time [unit]'")
            for column in table.columns if is_named_time(column)
        ]  # fmt: skip
    zero = int(np.median(ns))
    return Clock(name=table.name, seconds=np.asarray((ns - zero) * 1e-9, dtype=np.float64), zero=zero)


def is_time(name: str, unit: Unit | None = None) -> bool:
    """Whether a name means a time: all of its words do, or it is a single word with a unit of time."""
    words = [word for word in tokens_of(name) if not word.isdecimal()]
    if unit is not None:
        return unit.si == "s" and ({*words} <= TIME_WORDS or (len(words) == 1 and words[0] not in _DURATIONS))
    # LabVIEW calls the time X_Value.
    return words == ["x", "value"] or (bool(words) and {*words} <= TIME_WORDS | {*_FRACTIONS} and words != ["field"])


def is_named_time(column: RawColumn) -> bool:
    """Whether a column is a time, by its name and unit, or because its cells are dates."""
    name, unit = split_header(column.name)
    return column.zero is not None or is_time(re.split(r"[./]", name)[-1] or name, find_unit(column.unit) or unit)


def _of_columns(table: RawTable, reading: Reading, findings: list[Problem]) -> Clock:
    """Time of a table: the column that the user states, else the first column with the name of a time."""
    columns, stated = table.columns, reading.time.columns
    mapped = {find_raw(one.column, columns) for one in reading.maps}
    named = [i for i, column in enumerate(columns) if is_named_time(column) and i not in mapped]
    if reading.time.rate is not None:
        seconds = np.arange(len(columns[0].values)) / reading.time.rate
        return Clock(name="time", seconds=seconds, used=frozenset(named))
    names = [column.name for column in columns]
    places = []
    for name in stated:
        if (place := find_raw(name, columns)) is None:
            raise RecordingError("the file has no such time column", key=name, choices=tuple(names[:12]), code="no-time")
        places.append(place)
    if not places and not named:
        raise RecordingError(
            f"none of the columns is a time: {listed(names, 20)}", code="no-time",
            hint="Name the time with --map COLUMN=time [unit], or give the sampling rate with --rate",
        )  # fmt: skip
    places = places or _seconds_and_rest(columns, named)
    others = [i for i in named if i > max(places)]
    if others and not stated:
        # In a table such as `time, q1, time, q2`, each time belongs to the signals that follow it.
        apart = next((i for i in others if any(j not in named for j in range(places[0], i))), len(columns))
        left = [i for i in range(apart, len(columns)) if i not in named]
        message = f"is a second time column; '{names[places[0]]}' is used"
        message += f"; the columns after it are not read: {listed([names[i] for i in left], 8)}" if left else ""
        hint = f"If it is the time of all columns: --map '{names[others[0]]}=time'"
        findings.append(Problem(message, key=names[others[0]], hint=hint, code="second-time"))
        named += left
    return replace(_clock(table, places, reading, findings), used=frozenset((*places, *named)))


def _last_word(column: RawColumn) -> str:
    return "".join(tokens_of(split_header(column.name)[0])[-1:])


def _seconds_and_rest(columns: Sequence[RawColumn], named: list[int]) -> list[int]:
    """Indices of the first time column and the column added to it: nanoseconds, or the time of day of a date."""
    whole = [i for i in named if _last_word(columns[i]) in ("sec", "secs", "seconds")]
    parts = [i for i in named if _last_word(columns[i]) in _FRACTIONS]
    if whole and parts:
        return [whole[0], parts[0]]
    stamps = [columns[i].zero for i in named[:2]]
    return named[:2] if len(stamps) == 2 and stamps[0] and stamps[1] and stamps[1] < 86_400_000_000_000 else named[:1]


def _clock(table: RawTable, places: Sequence[int], reading: Reading, findings: list[Problem]) -> Clock:
    """Time in s made of the columns with the indices `places`."""
    columns = [table.columns[place] for place in places]
    first, name = columns[0], columns[0].name
    label = json.dumps(name if len(columns) == 1 else [column.name for column in columns], ensure_ascii=False)
    if len(columns) > 1:
        seconds, zero = np.zeros(len(first.values)), 0
        for column in columns:
            size = _FRACTIONS.get(_last_word(column), 1.0)
            if column is not first and column.zero is None and size == 1.0:
                message = "is added to the time, so its name must end with a unit such as nanosec"
                raise RecordingError(message, code="unknown-unit", key=column.name)
            # The start is subtracted first: a Unix time in s leaves too few digits of a float for the fraction.
            whole = column.zero is None and size == 1.0 and np.isfinite(column.values[0])
            start = round(column.values[0]) if whole else 0
            zero += start * 10**9 + (column.zero or 0)
            seconds += (column.values - start) * size
        return Clock(name=name, seconds=seconds, zero=zero, described=f"{{column: {label}}}")
    if first.zero is not None:
        return Clock(name=name, seconds=first.values, zero=first.zero, described=f"{{column: {label}}}")
    plain, unit = split_header(name)
    unit = find_unit(first.unit) or unit or (find_unit(plain) if len(plain) > 1 else None)
    factor = reading.time.factor or (unit.factor if unit is not None and unit.si == "s" else None)
    if factor is None and first.unit:
        hint = f"State it: --map '{name}=time [ms]'"
        raise RecordingError(f"the unit of this time is unknown: {first.unit}", key=name, code="unknown-unit", hint=hint)
    if not np.isfinite(first.values).any():
        raise RecordingError("the time column has no number", key=name, code="no-time")
    factor = _factor(first.values, factor, name=name, findings=findings, trusted=reading.time.unit is not None)
    seconds, date = _since_first_date(first.values, factor)
    word = reading.time.unit or next((word for word, size in _SECONDS.items() if size == factor), unit.symbol if unit else "s")
    return Clock(name=name, seconds=seconds, zero=date, described=f"{{column: {label}, unit: {word}}}")


def _factor(values: Array, factor: float | None, *, name: str, findings: list[Problem], trusted: bool) -> float:
    """Size of the time unit, s: as stated, else the largest of s, ms, us, ns with time steps up to 0.2 s, which is reported.

    trusted: The user states the unit, which is not checked. Raises RecordingError where no unit gives plausible steps.
    """
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    step = float(np.median(steps[steps > 0])) if steps.any() else 0.0
    usual = next((unit for unit, size in _SECONDS.items() if (step >= FASTEST or not step) and step * size <= 0.2), None)
    if factor is None:
        if usual is None:
            raise RecordingError(
                f"the time unit is unclear: the samples are {step:g} apart", key=name, code="time-unit",
                hint=f"State it: --map '{name}=time [ms]'; s, ms, us, ns, min, h and days are known",
            )  # fmt: skip
        if usual != "s":
            message = f"the time states no unit; {usual} is assumed, since the samples are {step:g} apart"
            hint = f"State another unit with --map '{name}=time [s]', or give --rate if the column counts rows"
            findings.append(Problem(message, key=name, hint=hint, code="time-unit-assumed"))
        return _SECONDS[usual]
    if step and not trusted and not FASTEST <= step * factor <= SLOWEST:
        other = usual or "s"
        message = f"its samples are {step * factor:g} s apart in its stated unit"
        message += f"; in {other} they would be {step * _SECONDS[other]:g} s"
        findings.append(Problem(message, key=name, hint=f"If so: --map '{name}=time [{other}]'", code="suspected-time"))
    return factor


def _since_first_date(values: Array, factor: float) -> tuple[Array, int]:
    """Times in s, and the Unix time in ns of time 0; for Unix times the first is time 0, other times stay as they are."""
    size = float(np.nanpercentile(values, 50, method="nearest"))
    if size * factor <= EPOCH:
        return values * factor, 0
    zero = float(values[np.abs(values - size) * factor < EPOCH][0])
    # A float of 1.7e9 s resolves 2.4e-7 s. Rounding restores the written digits: 0.2 s instead of 0.20000005 s.
    digits = int(np.floor(-np.log10(np.spacing(size) * factor)))
    return np.round((values - zero) * factor, digits), round(zero * factor * 1e9)


def clean_time(
    time: Array, lines: NDArray[np.int64] | None, *, name: str, findings: list[Problem]
) -> NDArray[np.bool_]:  # fmt: skip
    """Mask of the samples to keep: the longest series of strictly increasing times. Removed samples are reported.

    Of samples with equal stamps the first is kept. Raises RecordingError where many samples are removed or the time jumps far,
    as with two time bases or two recordings in one file.
    """
    where = np.arange(1, len(time) + 1) if lines is None else lines
    noun = "sample" if lines is None else "line"
    keep = np.ones(len(time), dtype=bool)

    def leave_out(bad: NDArray[np.int64], what: str, code: str, most: float, why: str) -> None:
        """Remove samples. Raises RecordingError where they exceed the fraction `most` of all samples."""
        if not len(bad):
            return
        keep[bad] = False
        message, line = f"{len(bad)} {what}", None if lines is None else int(where[bad[0]])
        if len(bad) > max(2, most * len(time)):
            message += f", the first is {noun} {where[bad[0]]} with {time[bad[0]]:g} s: {why}"
            raise RecordingError(message, key=name, line=line, hint="Split the file, or give --rate", code=code)
        findings.append(Problem(f"{message}, left out: {noun} {listed(where[bad], 8)}", key=name, code=code, line=line))

    leave_out(np.flatnonzero(~(np.abs(time) < 1e30)), "times are not numbers", "bad-time", 1.0, "")
    stamps = np.round(time, _DIGITS)
    valid = np.flatnonzero(keep)
    repeated = valid[1:][np.diff(stamps[valid]) == 0]
    leave_out(repeated, "repeated time stamps", "repeated-time", 0.5, "too few digits, or a row for each of several joints")
    valid = np.flatnonzero(keep)
    if np.any(np.diff(stamps[valid]) < 0):
        falling = np.delete(valid, rising(stamps[valid]))
        leave_out(falling, "time stamps that do not rise", "two-time-bases", 0.1, "two time bases, or two recordings")
    if keep.sum() < 2:
        message = f"{int(keep.sum())} samples have increasing times; at least 2 are needed"
        raise RecordingError(message, key=name, code="too-short")
    t, steps = time[keep], np.diff(time[keep])
    worst = int(np.argmax(steps))
    if len(steps) > 2 and steps[worst] > max(3600.0, 1e3 * (np.sum(steps) - steps[worst])):
        message = f"time jumps from {t[worst]:g} s to {t[worst + 1]:g} s: two time bases, or two recordings"
        raise RecordingError(message, key=name, hint="Split the file", code="two-time-bases")
    typical = float(np.median(steps))
    if (missing := int(np.sum(np.round(steps[steps > _GAP * typical] / typical) - 1))) > 0:
        message = f"{missing} samples are missing; the longest gap is {steps[worst]:.4g} s at t = {t[worst]:.6g} s"
        line = None if lines is None else int(where[keep][worst])
        findings.append(Problem(message, key=name, line=line, code="dropped-samples"))
    if (jitter := float(np.std(steps[steps <= _GAP * typical]))) > 0.01 * typical:
        message = f"samples are {typical * 1e3:.4g} ms apart with a jitter of {jitter * 1e3:.2g} ms (standard deviation)"
        findings.append(Problem(message, key=name, code="jitter"))
    return keep


def rising(values: Array) -> list[int]:
    """Indices of the longest strictly increasing subsequence of the values (n,)."""
    ends: list[float] = []
    places: list[int] = []
    before = np.full(len(values), -1)
    for i, value in enumerate(values.tolist()):
        length = bisect_left(ends, value)
        if length == len(ends):
            ends.append(value)
            places.append(i)
        elif value < ends[length]:
            ends[length], places[length] = value, i
        else:
            continue
        before[i] = places[length - 1] if length else -1
    chain, place = [], places[-1]
    while place >= 0:
        chain.append(place)
        place = int(before[place])
    return chain[::-1]
