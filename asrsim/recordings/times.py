"""Times of tables: which column it is, its unit, and samples that are left out so that it rises. Everything is reported."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError, listed
from asrsim.recordings.data import Content, RawColumn, RawSeries, RawTable
from asrsim.recordings.names import find_raw, meaning_of, tokens_of
from asrsim.recordings.reading import Reading
from asrsim.recordings.units import Unit, find_unit, split_header, unknown_unit
from asrsim.samples import Array

TIME_WORDS = {"time", "times", "t", "timestamp", "timestamps", "stamp", "ts", "tout", "elapsed", "clock", "datetime", "date",
              "seconds", "sec", "secs", "millis", "micros", "nanos", "epoch", "unix", "utc", "header", "field", "rosbag",
              "zeit", "s", "ms", "us", "ns"}  # fmt: skip
"""Words that name a time. A name with other words names none: `sample_time`, `time_constant`."""
_FRACTIONS = {"nanosec": 1e-9, "nsec": 1e-9, "nsecs": 1e-9, "nanoseconds": 1e-9, "usec": 1e-6, "usecs": 1e-6}
"""Last word of a column beside whole seconds -> s of its unit."""
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
EPOCH = 1e8
"""s above which a time is a date (1973 and later)."""
FASTEST, SLOWEST = 3e-5, 0.5
"""s between samples that are not suspected."""
NEAREST = 1e-9
"""s: stamps nearer to each other are one; slopes between them would leave the range of numbers."""
_AWAY = 60.0
"""s that a stamp may be away from the others, or ten times what most of these span."""
_SAME_CLOCK = 1.0
"""s by which a header's stamp may differ from the time of recording and still be of the same clock."""
_OVERTAKEN = 500_000_000
"""ns by which messages may overtake each other on their way to the recorder."""
_GAP = 1.7
"""Usual steps from which on samples are missing."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """The time of a table."""

    name: str
    seconds: Array
    """(n,) s; NaN where there is none."""
    zero: int | None = None
    """Unix time in ns at which `seconds` is 0; of times of day ns since midnight."""
    used: frozenset[int] = frozenset()
    """Places of columns that are no signals."""
    described: str = ""
    """Where it stands, as a document states it."""


def series_of(
    content: Content, reading: Reading, findings: list[Problem]
) -> tuple[list[RawSeries], float | None]:  # fmt: skip
    """All columns on clean times with one zero, and its Unix time. Raises RecordingError where no table has a time."""
    faults: list[Problem] = []
    found: list[tuple[RawTable, Clock, Array, NDArray[np.bool_]]] = []
    stamped = _stamped([table for table in content.tables if table.received is not None], reading, findings)
    for table in content.tables:
        try:
            if table.received is None or any(find_raw(name, table.columns) is not None for name in reading.time.columns):
                clock = _of_columns(table, reading, findings, must=len(content.tables) == 1)
            else:
                table, clock = _of_messages(table, stamped[table.name], findings)
            keep = clean_time(clock.seconds, table.lines, name=clock.name, findings=findings)
            found.append((table, clock, clock.seconds[keep], keep))
        except RecordingError as error:
            faults += error.problems
    dates = [clock.zero + round(time[0] * 1e9) for _, clock, time, _ in found if _is_date(clock)]
    first = min(dates, default=0)
    series: list[RawSeries] = []
    for table, clock, time, keep in found:
        zero = clock.zero or 0
        time = time + (zero - first if _is_date(clock) else zero if table.received is not None else 0) * 1e-9
        for column in (one for i, one in enumerate(table.columns) if i not in clock.used):
            values = np.where(np.isinf(column.values[keep]), np.nan, column.values[keep])
            # Messages may leave a number out: its times are those of the others.
            told = ~np.isnan(values) if table.received is not None else np.ones(len(time), dtype=bool)
            if told.sum() > 1:
                own = time if told.all() else time[told]
                series.append(RawSeries(column=column, time=own, values=values[told], clock=clock.described))
    if not series:
        message = "has no column beside its time; expected a time and at least one signal"
        hint = "For a signal without a time give the sampling rate with --rate"
        raise RecordingError(faults or Problem(message, code="one-column", hint=hint))
    findings += [replace(one, message=f"is not read: {one.message}", code="unread") for one in faults]
    return series, first * 1e-9 if dates else None


def _is_date(clock: Clock) -> bool:
    return clock.zero is not None and clock.zero > EPOCH * 1e9


def _stamped(tables: Sequence[RawTable], reading: Reading, findings: list[Problem]) -> dict[str, bool]:
    """Topic -> whether its messages' own stamps are its time: where they agree with the time of recording, or all topics have
    stamps of one other clock (simulated time, the robot's uptime)."""
    if reading.time.columns in (("header",), ("received",)):
        return dict.fromkeys((table.name for table in tables), reading.time.columns == ("header",))
    lags = {
        table.name: float(np.median(table.stamped - table.received)) * 1e-9
        for table in tables if table.stamped is not None and table.received is not None
    }  # fmt: skip
    other = bool(lags) and {*lags} == {table.name for table in tables} and max(lags.values()) - min(lags.values()) < _SAME_CLOCK
    used = {table.name: table.name in lags and (abs(lags[table.name]) < _SAME_CLOCK or other) for table in tables}
    findings += [
        Problem(f"two time bases: header stamps are {abs(lag):.6g} s off the time of recording, and not all topics have them; "
                "the time of recording is used", key=name, code="two-time-bases")
        for name, lag in lags.items() if not used[name]
    ]  # fmt: skip
    return used


def _of_messages(table: RawTable, stamped: bool, findings: list[Problem]) -> tuple[RawTable, Clock]:
    """The time of messages, in whose order they are put where they overtook each other on their way to the recorder."""
    ns = table.stamped if stamped and table.stamped is not None else np.asarray(table.received)
    late = np.maximum.accumulate(ns) - ns
    received = np.asarray(table.received)
    # Without a newer stamp for long a clock began anew, and nothing was overtaken.
    stalled = np.diff(np.append(received[late == 0], received[-1])).max()
    if late.any() and late.max() <= _OVERTAKEN and stalled <= max(_OVERTAKEN // 5, 0.5 * late.max()):
        order = np.argsort(ns, kind="stable")
        message = f"{int((late > 0).sum())} messages were recorded after later ones; all are put in the order of their stamps"
        findings.append(Problem(message, key=table.name, code="overtaken"))
        table, ns = replace(table, columns=tuple(replace(one, values=one.values[order]) for one in table.columns)), ns[order]
    findings += [
        Problem("is named as a time; the time of recording is used", key=column.name, code="two-time-bases",
                hint=f"Use it with --map '{column.name}=time [unit]'")
        for column in table.columns if table.stamped is None and is_named_time(column)
    ]  # fmt: skip
    zero = int(np.median(ns))
    return table, Clock(name=table.name, seconds=np.asarray((ns - zero) * 1e-9, dtype=np.float64), zero=zero)


def is_time(name: str, unit: Unit | None = None) -> bool:
    """Whether a column is named as a time: by each of its words, or by one word with a unit of time."""
    words = [word for word in tokens_of(name) if not word.isdecimal()]
    if unit is not None and unit.si != "s":
        return False
    if unit is not None and len(words) == 1 and words[0] not in ("dt", "delay", "period", "latency", "duration", "jitter"):
        return True
    # LabVIEW calls it X_Value.
    return words == ["x", "value"] or (bool(words) and {*words} <= TIME_WORDS | {*_FRACTIONS} and words != ["field"])


def is_named_time(column: RawColumn) -> bool:
    """Whether a column is a time by its name, its unit or its cells, which are dates."""
    name, unit = split_header(column.name)
    return column.zero is not None or is_time(re.split(r"[./]", name)[-1] or name, find_unit(column.unit) or unit)


def _of_columns(table: RawTable, reading: Reading, findings: list[Problem], *, must: bool) -> Clock:
    """The time of a table. must: a stated time must be there."""
    columns = table.columns
    mapped = {find_raw(one.column, columns) for one in reading.maps}
    named = [i for i, column in enumerate(columns) if is_named_time(column) and i not in mapped]
    if reading.time.rate is not None:
        seconds = np.arange(len(columns[0].values)) / reading.time.rate
        return Clock(name="time", seconds=seconds, used=frozenset(named))
    places = [place for name in reading.time.columns if (place := find_raw(name, columns)) is not None]
    if must and len(places) < len(reading.time.columns):
        names = tuple(column.name for column in columns[:12])
        missing = next(name for name in reading.time.columns if find_raw(name, columns) is None)
        raise RecordingError("there is no such column for the time", key=missing, choices=names, code="no-time")
    if not places or len(places) < len(reading.time.columns):
        places = _time_places(table, named, findings)
        named = [*named, *_behind(columns, max(places), named, findings)]
    return replace(_clock(table, tuple(places), reading, findings), used=frozenset((*places, *named)))


def _time_places(table: RawTable, named: list[int], findings: list[Problem]) -> list[int]:
    """Places of the columns that are the time: of those named so the finest, with its nanoseconds where these stand apart."""
    columns = table.columns
    last = {i: "".join(tokens_of(split_header(columns[i].name)[0])[-1:]) for i in named}
    whole = [i for i in named if last[i] in ("sec", "secs", "seconds")]
    parts = [i for i in named if last[i] in _FRACTIONS]
    if whole and parts:
        return [whole[0], parts[0]]
    rising = [i for i in named if _mostly_rises(columns[i].values)] or named[:1]
    if rising:
        rising = [i for i in rising if all(j in named for j in range(rising[0], i))]
        return [max(rising, key=lambda i: len(np.unique(columns[i].values)))]
    first = columns[0].name
    if rises := _rises_evenly(columns[0]):
        message, hint = "no column is named as the time; the first one rises evenly and is taken", "--map COLUMN=time"
        findings.append(Problem(message, key=first, hint=f"Say otherwise with {hint}", code="time-guessed"))
        return [0]
    counts = f"; '{first}' counts the rows" if rises is None else ""
    names = listed([column.name for column in columns], 20)
    hint = "Name the time with --map COLUMN=time [unit], or give the sampling rate with --rate"
    raise RecordingError(f"no time column found among {names}{counts}", code="no-time", hint=hint)


def _behind(columns: Sequence[RawColumn], time: int, named: list[int], findings: list[Problem]) -> list[int]:
    """Columns behind a further time, `time, q1, time, q2`, which are not of the first one."""
    others = [i for i in named if i > time and _mostly_rises(columns[i].values)]
    apart = next((i for i in others if any(j not in named for j in range(time, i))), len(columns))
    left = [i for i in range(apart, len(columns)) if i not in named]
    if others:
        said = f"; the columns behind it are not read: {listed([columns[i].name for i in left], 8)}" if left else ""
        other = columns[others[0]].name
        message, hint = (
            f"is a further time beside '{columns[time].name}'{said}",
            f"If it is the time of all: --map '{other}=time'",
        )
        findings.append(Problem(message, key=other, hint=hint, code="second-time"))
    return left


def _mostly_rises(values: Array) -> bool:
    """Whether a column mostly rises: the duration of a loop, however it is called, does not."""
    steps = np.diff(values[np.isfinite(values)])
    return bool(np.any(steps > 0) and np.mean(steps < 0) < 0.25)


def _rises_evenly(column: RawColumn) -> bool | None:
    """Whether a column without a name of a signal rises by nearly one step; None: it counts."""
    name, unit = split_header(column.name)
    meaning, steps = meaning_of(name, None, None), np.diff(column.values)
    if meaning.quantity or meaning.asked or unit is not None or len(steps) < 2 or not np.isfinite(steps).all():
        return False
    typical = float(np.median(steps))
    if typical <= 0 or np.mean(np.abs(steps - typical) < typical) < 0.95 or re.search("(?i)count|tick|index|frame|cycle", name):
        return False
    return True if typical != 1.0 else None


def _clock(table: RawTable, places: tuple[int, ...], reading: Reading, findings: list[Problem]) -> Clock:
    """The time of these columns in s."""
    first, name = table.columns[places[0]], table.columns[places[0]].name
    label = json.dumps(name, ensure_ascii=False)
    if len(places) > 1:
        seconds, zero, label = np.zeros(len(first.values)), 0, json.dumps([table.columns[place].name for place in places])
        for place in places:
            column = table.columns[place]
            size = _FRACTIONS.get("".join(tokens_of(split_header(column.name)[0])[-1:]), 1.0)
            if column.zero is None and place != places[0] and size == 1.0:
                raise RecordingError("is added to the time, and its name has no unit such as nanosec", code="unknown-unit",
                                     key=column.name)  # fmt: skip
            whole = column.zero is None and size == 1.0 and np.isfinite(column.values[0])
            start = round(column.values[0]) if whole else 0  # whole seconds since 1970 leave a float few digits
            zero += start * 10**9 + (column.zero or 0)
            seconds += (column.values - start) * size
        return Clock(name=name, seconds=seconds, zero=zero, described=f"{{column: {label}}}")
    if first.zero is not None:
        return Clock(name=name, seconds=first.values, zero=first.zero, described=f"{{column: {label}}}")
    plain, unit = split_header(name)
    unit = find_unit(first.unit) or unit or (find_unit(plain) if len(plain) > 1 else None)
    factor = reading.time.factor or (unit.factor if unit is not None and unit.si == "s" else None)
    if factor is None and (strange := first.unit or unknown_unit(name) or "") and strange.lower() not in TIME_WORDS:
        hint = f"State it: --map '{name}=time [ms]'"
        raise RecordingError(f"the unit of this time is not known: {strange}", key=name, code="unknown-unit", hint=hint)
    trusted = reading.time.unit is not None
    seconds, begins, factor = scale_time(first.values, factor, name=name, findings=findings, trusted=trusted)
    word = reading.time.unit or next((word for word, size in _SECONDS.items() if size == factor), unit.symbol if unit else "s")
    return Clock(name=name, seconds=seconds, zero=begins, described=f"{{column: {label}, unit: {word}}}")


def scale_time(
    values: Array, factor: float | None, *, name: str, findings: list[Problem], trusted: bool = False
) -> tuple[Array, int | None, float]:
    """Time in s, the Unix time in ns of its zero for dates (else None), and s per unit.

    `factor` is s per unit where the unit is stated; else the unit is inferred, which is reported: of dates by their size, of
    others so that a sample takes at most 0.2 s. trusted: what the user states is not suspected.
    Raises RecordingError where no unit gives usual samples.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        raise RecordingError("the time column has no number", key=name, code="no-time")
    steps = np.abs(np.diff(finite))
    step, size = float(np.median(steps[steps > 0])) if steps.any() else 0.0, float(np.median(finite))
    if factor is None:
        # Unix time: s ~ 1.7e9, ms ~ 1.7e12, us ~ 1.7e15, ns ~ 1.7e18.
        dated = next(f for f, top in ((1.0, 1e11), (1e-3, 1e14), (1e-6, 1e17), (1e-9, np.inf)) if size < top)
        # A clock in us or ns that began with the robot has numbers as large, but they grow from 0.
        grown = np.ptp(np.quantile(finite, (0.05, 0.95))) > 0.5 * size
        if size > EPOCH and not grown and FASTEST * 0.1 <= step * dated <= _AWAY:
            factor = dated
        elif step == 0.0 or step >= FASTEST:
            factor = next((size for size in _SECONDS.values() if step * size <= 0.2), None)
        if factor is None:
            raise RecordingError(
                f"its unit is not clear: its samples are {step:g} apart", key=name, code="time-unit",
                hint=f"State it: --map '{name}=time [ms]'; s, ms, us, ns, min, h and days are known",
            )  # fmt: skip
        if factor != 1.0 or (step > 0.04 and np.ptp(finite) > 300.0):
            unit = next(unit for unit, seconds in _SECONDS.items() if seconds == factor)
            counts = " (or does it count the rows? Then give --rate)" if step == 1.0 and abs(finite[0]) <= 1.0 else ""
            findings.append(
                Problem(f"time states no unit; read as {unit}, since its samples are {step:g} apart{counts}", key=name,
                        hint=f"Say otherwise with --map '{name}=time [s]'", code="time-unit-assumed")
            )  # fmt: skip
    elif step and not trusted and not FASTEST <= step * factor <= SLOWEST:
        usual = next((unit for unit, seconds in _SECONDS.items() if FASTEST <= step * seconds <= 0.2), "s")
        findings.append(
            Problem(f"its samples are {step * factor:g} s apart by the unit that it states; in {usual} they would be "
                    f"{step * _SECONDS[usual]:g} s", key=name, hint=f"If so: --map '{name}=time [{usual}]'",
                    code="suspected-time")
        )  # fmt: skip
    if size * factor <= EPOCH:
        return values * factor, None, factor
    zero = float(finite[np.abs(finite - size) * factor < EPOCH][0])
    # A float of 1.7e9 s resolves 2.4e-7 s: rounded to what was written, a sample at 0.2 s is at 0.2 s again.
    digits = int(np.floor(-np.log10(np.spacing(size) * factor)))
    return np.round((values - zero) * factor, digits), round(zero * factor * 1e9), factor


def clean_time(
    time: Array, lines: NDArray[np.int64] | None, *, name: str, findings: list[Problem]
) -> NDArray[np.bool_]:  # fmt: skip
    """Which samples to keep so that time rises strictly; what is left out is reported.

    Of samples with one stamp the first is kept. Stamps far away from all others, and those that go backward, are left out;
    raises RecordingError where that concerns too many: two time bases, or two recordings in one file.
    """
    where = np.arange(1, len(time) + 1) if lines is None else lines
    noun = "sample" if lines is None else "line"
    keep = np.ones(len(time), dtype=bool)

    def leave_out(bad: NDArray[np.bool_], what: str, code: str, most: float, refused: str, hint: str) -> None:
        """Leaves samples out; raises RecordingError where they are more than a share of all."""
        if not bad.any():
            return
        line = int(where[bad][0]) if lines is not None else None
        if bad.sum() > max(2, most * len(time)):
            first = f"the first is {noun} {where[bad][0]} with {time[bad][0]:g} s"
            message = f"{int(bad.sum())} {what}, {first}: {refused}"
            raise RecordingError(
                message, key=name, line=line, hint=hint, code="two-time-bases" if most < 0.5 else "repeated-time"
            )
        keep[bad] = False
        said = f"{int(bad.sum())} {what}, dropped: {noun}{'s' if bad.sum() > 1 else ''} {listed(where[bad], 8)}"
        findings.append(Problem(said, key=name, code=code, line=line, hint=hint if bad.sum() > 0.2 * len(time) else None))

    leave_out(~np.isfinite(time), f"{noun}s without a valid time", "bad-time", 1.0, "", "")
    if keep.sum() > 1:
        bases, hint = "two time bases, or two recordings", "Expected one clock over the whole file; split it there"
        low, middle, high = np.percentile(time[keep], (5, 50, 95))
        away = keep & (np.abs(np.nan_to_num(time) - middle) > max(_AWAY, 10 * (high - low)))
        leave_out(away, "stray time stamps", "stray-time", 0.01, bases, hint)
        t = time[keep]
        if len(t) > 1 and np.mean(np.diff(t) < 0) > 0.9:
            raise RecordingError(f"time falls from {t[0]:g} s to {t[-1]:g} s: the newest sample stands first", key=name,
                                 hint="Sort the file by its time", code="backward-time")  # fmt: skip
        # One stamp that is ahead of both that follow it, which go on where the one before it was.
        after, later = np.r_[t[1:], np.inf], np.r_[t[2:], np.inf, np.inf]
        ahead = np.zeros(len(time), dtype=bool)
        ahead[keep] = (t > after) & (t > later) & (after > np.r_[-np.inf, t[:-1]])
        leave_out(ahead, "stray time stamps", "stray-time", 0.1, bases, hint)
        rest, t = np.flatnonzero(keep), time[keep]
        steps = np.abs(np.diff(t))
        if len(steps) > 2 and np.max(steps) > max(3600.0, 1e3 * (np.sum(steps) - np.max(steps))):
            worst = int(np.argmax(steps))
            message = f"time jumps from {t[worst]:g} s to {t[worst + 1]:g} s: {bases}"
            raise RecordingError(message, key=name, hint=hint, code="two-time-bases")
        top = np.maximum.accumulate(t)
        stale = np.r_[False, t[1:] <= top[:-1] + NEAREST]
        backward, repeated = (np.zeros(len(time), dtype=bool) for _ in range(2))
        backward[rest[stale & (t < top)]] = True
        repeated[rest[stale & (t == top)]] = True
        leave_out(backward, "time stamps that go backward", "backward-time", 0.1, bases, hint)
        digits = "too few digits, or there is a row for each of several joints"
        leave_out(repeated, "duplicate time stamps", "duplicate-time", 0.5, digits, "Give the sampling rate with --rate")
    if keep.sum() < 2:
        message = f"{int(keep.sum())} samples with a valid time that rises; at least 2 are needed"
        raise RecordingError(message, key=name, code="too-short")
    findings += _spacing(time[keep], where[keep], name=name, numbered=lines is not None)
    return keep


def _spacing(t: Array, where: NDArray[np.int64], *, name: str, numbered: bool) -> list[Problem]:
    """Dropped samples and jitter of rising times."""
    steps = np.diff(t)
    if len(t) < 4:
        return []
    typical = float(np.median(steps))
    gaps = np.flatnonzero(steps > _GAP * typical)
    findings = []
    if len(gaps):
        missing = int(np.sum(np.round(steps[gaps] / typical) - 1))
        worst = gaps[np.argmax(steps[gaps])]
        said = f"{missing} samples are missing in {len(gaps)} gaps; the longest is {steps[worst]:.4g} s at t = {t[worst]:.6g} s"
        said += f" after line {where[worst]}" if numbered else ""
        line = int(where[gaps[0]]) if numbered else None
        findings.append(Problem(said, key=name, line=line, code="dropped-samples"))
    if (jitter := float(np.std(steps[steps <= _GAP * typical]))) > 0.01 * typical:
        said = f"samples are {typical * 1e3:.4g} ms apart with a jitter of {jitter * 1e3:.2g} ms (standard deviation)"
        findings.append(Problem(said, key=name, code="jitter"))
    return findings
