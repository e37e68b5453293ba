"""The time of each table: which column it is, its unit, and the samples that are left out so that it rises. All is reported."""

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
"""Words that name a time. A name with another word names none: `sample_time`, `time_constant`."""
_DURATIONS = ("dt", "delay", "period", "latency", "duration", "jitter")
_FRACTIONS = {"nanosec": 1e-9, "nsec": 1e-9, "nsecs": 1e-9, "nanoseconds": 1e-9, "usec": 1e-6, "usecs": 1e-6}
"""Last word of a column beside whole seconds -> s of its unit."""
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
EPOCH = 1e8
"""s above which a time is a date (1973 and later)."""
FASTEST, SLOWEST = 3e-5, 0.5
"""s between two samples: outside of this range a stated unit is suspected, and no unit is assumed."""
_DIGITS = 9
"""Decimals of a second: stamps that differ by less are equal; slopes between them would leave the range of numbers."""
_SAME_CLOCK = 1.0
"""s by which the stamps in headers may differ from the time of recording and still be of the same clock."""
_GAP = 1.7
"""Steps in units of the usual step above which samples are missing."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """The time of a table."""

    name: str
    seconds: Array
    """(n,) s; NaN where there is none."""
    zero: int = 0
    """Of dates and stamps: ns of the clock at which `seconds` is 0."""
    used: frozenset[int] = frozenset()
    """Indices of columns that are no signals."""
    described: str = ""
    """Its column and unit, as a document states them."""


def series_of(content: Content, reading: Reading, findings: list[Problem]) -> tuple[list[RawSeries], float | None]:
    """All columns on clean times, and the Unix time in s of time 0 where the file has dates.

    Dates count from the earliest of the file. Raises RecordingError where no table has a time.
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
        message = "has no column beside its time; expected a time and at least one signal"
        hint = "For a signal without a time give the sampling rate with --rate"
        raise RecordingError(faults or Problem(message, code="one-column", hint=hint))
    findings += [replace(one, message=f"is not read: {one.message}", code="unread") for one in faults]
    return series, first * 1e-9 if starts else None


def _of_messages(table: RawTable, reading: Reading, findings: list[Problem]) -> Clock:
    """The time of messages: of their headers where it agrees with the time of recording, or where that is stated."""
    received, stamped = np.asarray(table.received), table.stamped
    lag = np.inf if stamped is None else float(np.median(stamped - received)) * 1e-9
    by_header = reading.time.columns == ("header",) or (reading.time.columns != ("received",) and abs(lag) < _SAME_CLOCK)
    ns = stamped if by_header and stamped is not None else received
    if stamped is not None and not by_header and not reading.time.columns:
        message = f"two time bases: header stamps are {abs(lag):.6g} s off the time of recording, which is used"
        findings.append(
            Problem(message, key=table.name, code="two-time-bases", hint="Use the stamps with `time: header` in its document")
        )
    if table.stamped is None:
        findings += [
            Problem("is named as a time; the time of recording is used", key=column.name, code="two-time-bases",
                    hint=f"Use it with --map '{column.name}=time [unit]'")
            for column in table.columns if is_named_time(column)
        ]  # fmt: skip
    zero = int(np.median(ns))
    return Clock(name=table.name, seconds=np.asarray((ns - zero) * 1e-9, dtype=np.float64), zero=zero)


def is_time(name: str, unit: Unit | None = None) -> bool:
    """Whether a column is named as a time: by each of its words, or by one word with a unit of time."""
    words = [word for word in tokens_of(name) if not word.isdecimal()]
    if unit is not None:
        return unit.si == "s" and ({*words} <= TIME_WORDS or (len(words) == 1 and words[0] not in _DURATIONS))
    # LabVIEW calls it X_Value.
    return words == ["x", "value"] or (bool(words) and {*words} <= TIME_WORDS | {*_FRACTIONS} and words != ["field"])


def is_named_time(column: RawColumn) -> bool:
    """Whether a column is a time by its name, its unit or its cells, which are dates."""
    name, unit = split_header(column.name)
    return column.zero is not None or is_time(re.split(r"[./]", name)[-1] or name, find_unit(column.unit) or unit)


def _of_columns(table: RawTable, reading: Reading, findings: list[Problem]) -> Clock:
    """The time of a table: that which is stated, else the first column that is named so."""
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
            raise RecordingError("there is no such column for the time", key=name, choices=tuple(names[:12]), code="no-time")
        places.append(place)
    if not places and not named:
        raise RecordingError(
            f"no time column found among {listed(names, 20)}", code="no-time",
            hint="Name the time with --map COLUMN=time [unit], or give the sampling rate with --rate",
        )  # fmt: skip
    places = places or _seconds_and_rest(columns, named)
    others = [i for i in named if i > max(places)]
    if others and not stated:
        # Where signals stand between two times, as in `time, q1, time, q2`, each time belongs to those behind it.
        apart = next((i for i in others if any(j not in named for j in range(places[0], i))), len(columns))
        left = [i for i in range(apart, len(columns)) if i not in named]
        message = f"is a further time beside '{names[places[0]]}', which is used"
        message += f"; the columns behind it are not read: {listed([names[i] for i in left], 8)}" if left else ""
        hint = f"If it is the time of all columns: --map '{names[others[0]]}=time'"
        findings.append(Problem(message, key=names[others[0]], hint=hint, code="second-time"))
        named += left
    return replace(_clock(table, places, reading, findings), used=frozenset((*places, *named)))


def _last_word(column: RawColumn) -> str:
    return "".join(tokens_of(split_header(column.name)[0])[-1:])


def _seconds_and_rest(columns: Sequence[RawColumn], named: list[int]) -> list[int]:
    """The first column that is named as a time, with those that complete it: nanoseconds, or the time of day of a date."""
    whole = [i for i in named if _last_word(columns[i]) in ("sec", "secs", "seconds")]
    parts = [i for i in named if _last_word(columns[i]) in _FRACTIONS]
    if whole and parts:
        return [whole[0], parts[0]]
    stamps = [columns[i].zero for i in named[:2]]
    return named[:2] if len(stamps) == 2 and stamps[0] and stamps[1] and stamps[1] < 86_400_000_000_000 else named[:1]


def _clock(table: RawTable, places: Sequence[int], reading: Reading, findings: list[Problem]) -> Clock:
    """The time of these columns in s."""
    columns = [table.columns[place] for place in places]
    first, name = columns[0], columns[0].name
    label = json.dumps(name if len(columns) == 1 else [column.name for column in columns], ensure_ascii=False)
    if len(columns) > 1:
        seconds, zero = np.zeros(len(first.values)), 0
        for column in columns:
            size = _FRACTIONS.get(_last_word(column), 1.0)
            if column is not first and column.zero is None and size == 1.0:
                message = "is added to the time, and its name has no unit such as nanosec"
                raise RecordingError(message, code="unknown-unit", key=column.name)
            # Whole seconds since 1970 leave few digits of a float for the fraction.
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
        raise RecordingError(f"the unit of this time is not known: {first.unit}", key=name, code="unknown-unit", hint=hint)
    if not np.isfinite(first.values).any():
        raise RecordingError("the time column has no number", key=name, code="no-time")
    factor = _factor(first.values, factor, name=name, findings=findings, trusted=reading.time.unit is not None)
    seconds, date = _since_first_date(first.values, factor)
    word = reading.time.unit or next((word for word, size in _SECONDS.items() if size == factor), unit.symbol if unit else "s")
    return Clock(name=name, seconds=seconds, zero=date, described=f"{{column: {label}, unit: {word}}}")


def _factor(values: Array, factor: float | None, *, name: str, findings: list[Problem], trusted: bool) -> float:
    """s per unit of a time: as it is stated, else the one by which a sample takes at most 0.2 s, which is reported.

    trusted: the user states the unit, which is not suspected. Raises RecordingError where no unit gives usual samples.
    """
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    step = float(np.median(steps[steps > 0])) if steps.any() else 0.0
    usual = next((unit for unit, size in _SECONDS.items() if (step >= FASTEST or not step) and step * size <= 0.2), None)
    if factor is None:
        if usual is None:
            raise RecordingError(
                f"its unit is not clear: its samples are {step:g} apart", key=name, code="time-unit",
                hint=f"State it: --map '{name}=time [ms]'; s, ms, us, ns, min, h and days are known",
            )  # fmt: skip
        if usual != "s":
            message = f"time states no unit; read as {usual}, since its samples are {step:g} apart"
            hint = f"Say otherwise with --map '{name}=time [s]', or --rate where it counts the rows"
            findings.append(Problem(message, key=name, hint=hint, code="time-unit-assumed"))
        return _SECONDS[usual]
    if step and not trusted and not FASTEST <= step * factor <= SLOWEST:
        other = usual or "s"
        message = f"its samples are {step * factor:g} s apart by the unit that it states"
        message += f"; in {other} they would be {step * _SECONDS[other]:g} s"
        findings.append(Problem(message, key=name, hint=f"If so: --map '{name}=time [{other}]'", code="suspected-time"))
    return factor


def _since_first_date(values: Array, factor: float) -> tuple[Array, int]:
    """Time in s, and the Unix time in ns of its zero: of dates the first, else 0."""
    size = float(np.nanpercentile(values, 50, method="nearest"))
    if size * factor <= EPOCH:
        return values * factor, 0
    zero = float(values[np.abs(values - size) * factor < EPOCH][0])
    # A float of 1.7e9 s resolves 2.4e-7 s: rounded to what was written, a sample at 0.2 s is at 0.2 s again.
    digits = int(np.floor(-np.log10(np.spacing(size) * factor)))
    return np.round((values - zero) * factor, digits), round(zero * factor * 1e9)


def clean_time(
    time: Array, lines: NDArray[np.int64] | None, *, name: str, findings: list[Problem]
) -> NDArray[np.bool_]:  # fmt: skip
    """Which samples to keep: as many as rise strictly in time, the first of those with one stamp; the others are reported.

    Raises RecordingError where many are left out, or the time jumps far: two time bases, or two recordings in one file.
    """
    where = np.arange(1, len(time) + 1) if lines is None else lines
    noun = "sample" if lines is None else "line"
    keep = np.ones(len(time), dtype=bool)

    def leave_out(bad: NDArray[np.int64], what: str, code: str, most: float, why: str) -> None:
        """Leaves samples out; raises RecordingError where they are more than a fraction of all."""
        if not len(bad):
            return
        keep[bad] = False
        message, line = f"{len(bad)} {what}", None if lines is None else int(where[bad[0]])
        if len(bad) > max(2, most * len(time)):
            message += f", the first is {noun} {where[bad[0]]} with {time[bad[0]]:g} s: {why}"
            raise RecordingError(message, key=name, line=line, hint="Split the file, or give --rate", code=code)
        findings.append(Problem(f"{message}, left out: {noun} {listed(where[bad], 8)}", key=name, code=code, line=line))

    leave_out(np.flatnonzero(~(np.abs(time) < 1e30)), "times are no numbers", "bad-time", 1.0, "")
    stamps = np.round(time, _DIGITS)
    valid = np.flatnonzero(keep)
    repeated = valid[1:][np.diff(stamps[valid]) == 0]
    leave_out(repeated, "repeated time stamps", "repeated-time", 0.5, "too few digits, or a row for each of several joints")
    valid = np.flatnonzero(keep)
    if np.any(np.diff(stamps[valid]) < 0):
        falling = np.delete(valid, rising(stamps[valid]))
        leave_out(falling, "time stamps that do not rise", "two-time-bases", 0.1, "two time bases, or two recordings")
    if keep.sum() < 2:
        message = f"{int(keep.sum())} samples with a valid time that rises; at least 2 are needed"
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
    """Indices of the longest part of the values (n,) that rises strictly; of equal values the first."""
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
