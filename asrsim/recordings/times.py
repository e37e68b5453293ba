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
from asrsim.recordings.text import lines_text
from asrsim.recordings.units import UNITS, Unit, find_unit, split_header, unknown_unit
from asrsim.samples import Array

TIME_WORDS = {"time", "times", "t", "timestamp", "timestamps", "stamp", "ts", "tout", "elapsed", "clock", "datetime", "date",
              "seconds", "sec", "secs", "millis", "micros", "nanos", "epoch", "unix", "utc", "header", "field",
              "rosbag", "zeit"}  # fmt: skip
"""Words that name a time; a name of others, too, is none: `sample_time`, `time_constant`."""
_PARTS = {"nanosec": 1e-9, "nsec": 1e-9, "nsecs": 1e-9, "nanoseconds": 1e-9, "usec": 1e-6, "usecs": 1e-6}
"""Last word of a column beside whole seconds -> s of its unit."""
_RATE = re.compile(
    r"\b(?:(?P<rate>rate|freq(?:uency)?|f_?s)|(?:sampl\w*|step)[ _]?(?:time|period|interval)|ts|dt|delta_x)\s*(?:[\[(]"
    r"(?P<before>\w+)[\])])?[\s:;,=]*(?P<number>\d+(?:\.\d+)?(?:e[-+]?\d+)?)\s*(?P<after>[kmuµn]?(?:hz|s)\b)?", re.IGNORECASE,
)  # fmt: skip
"""`fs = 500 Hz`, `Sample time [ms]: 2` among the remarks above the numbers."""
EPOCH = 1e8
"""s above which a time is a date (1973 and later)."""
_DAY = 86_400_000_000_000
"""ns."""
FASTEST, SLOWEST = 3e-5, 0.5
"""s between samples that are not suspected."""
NEAREST = 1e-9
"""s: stamps nearer to each other are one; slopes between them would leave the range of numbers."""
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_AWAY = 60.0
"""s that a stamp may be away from the others, or ten times what most of these span."""
_SAME_CLOCK = 1.0
"""s by which a header's stamp may differ from the time of recording and still be of the same clock."""
_OVERTAKEN = 500_000_000
"""ns by which messages may overtake each other on their way to the recorder."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """A time, of the columns at these places of its table."""

    name: str
    places: tuple[int, ...]
    seconds: Array
    """(n,) s; NaN where there is none."""
    zero: int | None = None
    """Unix time in ns of its 0."""
    described: str = ""
    """Where it stands, as a document states it."""


def series_of(
    content: Content, reading: Reading, findings: list[Problem], *, partly: bool = False
) -> tuple[list[RawSeries], float | None]:
    """All columns on clean times with one zero, and its Unix time. Raises RecordingError where no table has a time.

    partly: of files that are joined, of which another may have the time that is stated.
    """
    faults: list[Problem] = []
    found: list[tuple[RawTable, list[tuple[Clock, list[int]]]]] = []
    messages = [table for table in content.tables if table.received is not None]
    stamps = _use_stamps(messages, reading, findings)
    for table in content.tables:
        try:
            stated = any(find_raw(name, table.columns) is not None for name in reading.time.columns)
            if table.received is not None and not stated:
                ns = table.stamped if stamps[table.name] and table.stamped is not None else table.received
                table, ns = _in_order(table, ns, findings)
                low, high = np.percentile(ns - ns.min(), (5, 95))
                near = np.abs(ns - np.int64(np.median(ns))) <= max(_AWAY * 1e9, 10 * (high - low))
                zero = int(ns[near].min())
                clock = Clock(name=table.name, places=(), seconds=np.asarray((ns - zero) * 1e-9, dtype=np.float64), zero=zero)
                findings += [
                    Problem("is named as a time; the time of recording is used", key=column.name, code="two-time-bases",
                            hint=f"Use it with --map '{column.name}=time [unit]'")
                    for column in table.columns if table.stamped is None and is_named_time(column)
                ]  # fmt: skip
                found.append((table, [(clock, [*range(len(table.columns))])]))
            else:
                single = len(content.tables) == 1 and not partly
                found.append((table, _clocks(table, content.remarks, reading, findings, single=single)))
        except RecordingError as error:
            faults += error.problems
    clocks = [clock for _, pairs in found for clock, _ in pairs]
    dates = [clock.zero for clock in clocks if clock.zero is not None and clock.zero > EPOCH * 1e9]
    first = min(dates) if dates else 0
    series: list[RawSeries] = []
    for table, pairs in found:
        for clock, places in pairs:
            begins = clock.zero or 0
            shift = begins - first if begins > EPOCH * 1e9 else begins if table.received is not None else 0
            try:
                time = clock.seconds + shift * 1e-9 if shift else clock.seconds
                keep, more = clean_time(time, table.lines, name=clock.name)
            except RecordingError as error:
                faults += error.problems
                continue
            findings += more
            kept = time[keep]
            for place in places:
                column = table.columns[place]
                series += [replace(one, clock=clock.described) for one in _series(table, column, column.values[keep], kept)]
    if not series:
        one = content.tables[0].columns[0].name if len(content.tables) == 1 and len(content.tables[0].columns) == 1 else None
        raise RecordingError(
            faults or Problem(f"has one column only ('{one}'); expected a time and at least one signal", code="one-column",
                              hint="For a signal without a time give the sampling rate with --rate")
        )  # fmt: skip
    findings += [
        Problem(f"is not read: {one.message}", key=one.key, line=one.line, hint=one.hint, code="unread") for one in faults
    ]
    return series, first * 1e-9 if dates else None


def _series(table: RawTable, column: RawColumn, values: Array, time: Array) -> list[RawSeries]:
    """The series of a column; of messages that some leave out, on the times of the others."""
    if table.received is None:
        return [RawSeries(column=column, time=time, values=np.where(np.isinf(values), np.nan, values))]
    told = ~np.isnan(values)
    time, values = (time, values) if told.all() else (time[told], values[told])
    return [RawSeries(column=column, time=time, values=values)] if len(time) > 1 else []


def _use_stamps(tables: Sequence[RawTable], reading: Reading, findings: list[Problem]) -> dict[str, bool]:
    """Topic -> whether its messages' own stamps are its time: where they agree with the time of recording, or all topics have
    stamps of one other clock (simulated time, the robot's uptime)."""
    if reading.time.columns in (("header",), ("received",)):
        return dict.fromkeys((table.name for table in tables), reading.time.columns == ("header",))
    lags = {
        table.name: None if table.stamped is None or table.received is None
        else float(np.median(table.stamped - table.received)) * 1e-9
        for table in tables
    }  # fmt: skip
    known = [lag for lag in lags.values() if lag is not None]
    other = len(known) == len(lags) and bool(known) and max(known) - min(known) < _SAME_CLOCK
    used = {name: lag is not None and (abs(lag) < _SAME_CLOCK or other) for name, lag in lags.items()}
    findings += [
        Problem(f"two time bases: header stamps are {abs(lag):.6g} s off the time of recording, and not all topics have them; "
                "the time of recording is used", key=name, code="two-time-bases")
        for name, lag in lags.items() if lag is not None and not used[name]
    ]  # fmt: skip
    return used


def _in_order(table: RawTable, ns: NDArray[np.int64], findings: list[Problem]) -> tuple[RawTable, NDArray[np.int64]]:
    """Messages in the order of their stamps, where they only overtook each other on their way to the recorder."""
    late = np.maximum.accumulate(ns) - ns
    received = table.received if table.received is not None else ns
    # Recording without a newer stamp: a clock began anew, and nothing was overtaken.
    stalled = np.diff(np.append(received[late == 0], received[-1])).max()
    if not late.any() or late.max() > _OVERTAKEN or stalled > max(_OVERTAKEN // 5, 0.5 * late.max()):
        return table, ns
    order = np.argsort(ns, kind="stable")
    message = f"{int((late > 0).sum())} messages were recorded after later ones; all are put in the order of their stamps"
    findings.append(Problem(message, key=table.name, code="overtaken"))
    return replace(table, columns=tuple(replace(one, values=one.values[order]) for one in table.columns)), ns[order]


def is_time(name: str, unit: Unit | None = None) -> bool:
    """Whether a column is named as a time: by each of its words, or by words for seconds."""
    words = [word for word in tokens_of(name) if not word.isdecimal()]
    if unit is not None and unit.si != "s":
        return False
    if words == ["x", "value"]:  # LabVIEW
        return True
    if unit is not None and len(words) == 1 and words[0] not in ("dt", "delay", "period", "latency", "duration", "jitter"):
        return True
    return bool(words) and {*words} <= TIME_WORDS | {*_PARTS, "s", "ms", "us", "ns"} and words != ["field"]


def told_rate(remarks: str) -> str | None:
    """The cure where the file says how fast it was sampled: `# fs = 500 Hz`, `Sample time [ms]; 2`."""
    match = _RATE.search(remarks)
    unit = None if match is None else find_unit(match["before"] or match["after"] or ("Hz" if match["rate"] else "s"))
    if match is None or unit is None or unit.si != ("Hz" if match["rate"] else "s") or not float(match["number"]):
        return None
    told = unit.factor * float(match["number"])
    return f"The file says '{' '.join(match[0].split())}': give --rate {told if match['rate'] else 1 / told:.9g}"


def _clocks(
    table: RawTable, remarks: str, reading: Reading, findings: list[Problem], *, single: bool
) -> list[tuple[Clock, list[int]]]:
    """The times of a table, and the places of the columns that belong to each: to the time before them, or the first one."""
    names = [column.name for column in table.columns]
    count = len(table.columns[0].values)
    if reading.time.rate is not None:
        clock = Clock(name="time", places=(), seconds=np.arange(count) / reading.time.rate)
        return [(clock, [i for i, column in enumerate(table.columns) if not is_named_time(column)])]
    groups = _time_places(table, names, remarks, reading, findings, single=single)
    clocks = [_clock(table, places, reading, findings) for places in groups]
    used = {place for places in groups for place in places}
    signals = [i for i in range(len(names)) if i not in used and table.columns[i].zero is None]
    first = clocks[0]
    owners: dict[int, list[int]] = {0: []}
    for place in signals:
        before = [i for i, clock in enumerate(clocks) if clock.places[0] < place]
        owners.setdefault(max(before, key=lambda i: clocks[i].places[0], default=0), []).append(place)
    result = [(first, owners[0])]
    for i, clock in enumerate(clocks[1:], start=1):
        own = listed([names[place] for place in owners.get(i, [])], 8)
        if _is_same(first, clock) or not own:
            said = f"is the same clock as '{first.name}', which is used" if own else "is a further time, not used"
            findings.append(Problem(said, key=clock.name, code="second-time"))
            owners[0] += owners.get(i, [])
        else:
            findings.append(Problem(f"is a second time base beside '{first.name}'; it is that of {own}", key=clock.name,
                                    code="second-time-base"))  # fmt: skip
            result.append((clock, owners[i]))
    return result


def is_named_time(column: RawColumn) -> bool:
    """Whether a column is a time by its name, its unit or its cells, which are dates."""
    name, unit = split_header(column.name)
    name = re.split(r"[./]", name)[-1] or name
    return column.zero is not None or is_time(name, find_unit(column.unit) or unit)


def _time_places(
    table: RawTable, names: Sequence[str], remarks: str, reading: Reading, findings: list[Problem], *, single: bool
) -> list[tuple[int, ...]]:
    """Places of the columns of each time: those that are stated, named so or dates, else the first one if it rises evenly."""
    if reading.time.columns:
        found = [find_raw(name, table.columns) for name in reading.time.columns]
        places = tuple(place for place in found if place is not None)
        if len(places) == len(found):
            return [places]
        if single:
            missing = reading.time.columns[found.index(None)]
            raise RecordingError("there is no such column for the time", key=missing, choices=tuple(names[:12]), code="no-time")
    mapped = {find_raw(one.column, table.columns) for one in reading.maps}
    named = [i for i, column in enumerate(table.columns) if i not in mapped and is_named_time(column)]
    going = [i for i in named if _goes_on(table.columns[i].values)]
    last = {i: tokens_of(split_header(names[i])[0])[-1:] for i in named}
    for parts in named:  # a ROS stamp in two columns
        whole = next((i for i in named if last[i] in (["sec"], ["secs"], ["seconds"]) and names[i] != names[parts]), None)
        if last[parts] and last[parts][0] in _PARTS and whole is not None:
            findings.append(Problem(f"'{names[whole]}' and '{names[parts]}' are read as one time", code="split-time"))
            return [(whole, parts)]
    dates = [i for i in named if table.columns[i].zero is not None and (table.columns[i].zero or 0) % _DAY == 0]
    clocks = [i for i in named if table.columns[i].zero is not None and (table.columns[i].zero or 0) < _DAY]
    if len(dates) == 1 and len(clocks) == 1 and dates != clocks:
        findings.append(Problem(f"'{names[dates[0]]}' and '{names[clocks[0]]}' are read as one time", code="split-time"))
        return [(dates[0], clocks[0])]
    sent = [i for i in going if {"header", "stamp"} <= {*tokens_of(names[i])}]
    if sent and len(going) > 1:
        findings.append(
            Problem("is when messages were sent, and is used", key=names[sent[0]], code="second-time",
                    hint="State another with --map COLUMN=time")
        )  # fmt: skip
        return [(sent[0],)]
    if going or named:
        return [(i,) for i in going or named[:1]]
    if unnamed := _rising(table.columns[0]):
        findings.append(
            Problem("no column is named as the time; the first one rises evenly and is taken", key=names[0],
                    hint="Say otherwise with --map COLUMN=time", code="time-guessed")
        )  # fmt: skip
        return [(0,)]
    hint = told_rate(remarks) or "Name the time with --map COLUMN=time [unit], or give the sampling rate with --rate"
    counts = f"; '{names[0]}' counts the rows" if unnamed is None else ""
    raise RecordingError(f"no time column found among {listed(names, 20)}{counts}", code="no-time", hint=hint)


def _rising(column: RawColumn) -> bool | None:
    """Whether a column without a name of a signal rises by nearly one step; None: it counts."""
    values, (name, unit) = column.values, split_header(column.name)
    meaning = meaning_of(name, None, None)
    if meaning.quantity is not None or meaning.asked:
        return False
    steps = np.diff(values)
    if (
        len(values) < 3
        or unit is not None
        or not np.isfinite(steps).all()
        or re.search("(?i)count|tick|index|frame|cycle", name)
    ):
        return False
    typical = float(np.median(steps))
    if typical <= 0 or float(np.mean(np.abs(steps - typical) < typical)) < 0.95:
        return False
    return True if typical != 1.0 else None


def _clock(table: RawTable, places: tuple[int, ...], reading: Reading, findings: list[Problem]) -> Clock:
    """The time of these columns in s."""
    column = table.columns[places[0]]
    name, (plain, unit) = column.name, split_header(column.name)
    unit = find_unit(column.unit) or unit or (find_unit(plain) if len(plain) > 1 else None)
    stated = reading.time.factor or (unit.factor if unit is not None and unit.si == "s" else None)
    if len(places) > 1:
        for place in places[1:]:
            if table.columns[place].zero is None and not {*tokens_of(table.columns[place].name)[-1:]} & _PARTS.keys():
                raise RecordingError("is added to the time, and its name has no unit such as nanosec", code="unknown-unit",
                                     key=table.columns[place].name)  # fmt: skip
        parts = [_part(table.columns[place]) for place in places]
        start = parts[0][0] if np.isfinite(parts[0][0]) and column.zero is None else 0.0
        zero = round(start) * 10**9 + sum(table.columns[place].zero or 0 for place in places)
        both = ", ".join(json.dumps(table.columns[place].name) for place in places)
        seconds = (parts[0] - round(start)) + sum(parts[1:])
        return Clock(name=name, places=places, seconds=seconds, zero=zero, described=f"{{column: [{both}]}}")
    if column.zero is not None:
        days = np.cumsum(np.r_[0.0, np.diff(column.values) < -0.9 * _DAY * 1e-9]) if column.zero < _DAY else np.zeros(1)
        if days[-1]:
            findings.append(Problem("the time passes midnight, and goes on", key=name, code="midnight"))
        return Clock(name=name, places=places, seconds=column.values + days * (_DAY * 1e-9), zero=column.zero,
                     described=f"{{column: {json.dumps(name)}}}")  # fmt: skip
    if stated is None and (strange := column.unit or unknown_unit(name) or "") and not {strange.lower()} <= TIME_WORDS:
        raise RecordingError(f"the unit of this time is not known: {strange}", key=name, code="unknown-unit",
                             hint=f"State it: --map '{name}=time [ms]'")  # fmt: skip
    seconds, epoch, factor = scale_time(
        column.values, stated, name=name, findings=findings, trusted=reading.time.unit is not None
    )
    word = next((word for word, one in UNITS.items() if one.si == "s" and one.factor == factor), "s")
    said = f"{{column: {json.dumps(name, ensure_ascii=False)}, unit: {word}}}"
    return Clock(name=name, places=places, seconds=seconds, zero=None if epoch is None else round(epoch * 1e9), described=said)


def _part(column: RawColumn) -> Array:
    """Seconds of one of several columns that are added."""
    word = tokens_of(split_header(column.name)[0])[-1:]
    return column.values * (_PARTS.get(word[0], 1.0) if word and column.zero is None else 1.0)


def _goes_on(values: Array) -> bool:
    """Whether a column mostly rises: the duration of a loop, however it is called, does not."""
    steps = np.diff(values[np.isfinite(values)])
    return bool(np.any(steps > 0) and np.mean(steps < 0) < 0.25)


def _is_same(first: Clock, other: Clock) -> bool:
    """Whether two times of one table tell the same but for rounding and their zero, where they are dates."""
    both = np.isfinite(first.seconds) & np.isfinite(other.seconds)
    if not both.any():
        return True
    later = other.seconds[both] - first.seconds[both]
    step = float(np.median(np.abs(np.diff(first.seconds[both])))) if both.sum() > 1 else 0.0
    dates = first.zero is not None and other.zero is not None
    later = later + ((other.zero or 0) - (first.zero or 0)) * 1e-9 if dates else later
    return bool(
        np.ptp(later) < 0.5 * step and (abs(float(np.median(later))) < 1e-3 * step or (first.zero is not None and not dates))
    )


def scale_time(
    values: Array, factor: float | None, *, name: str, findings: list[Problem], trusted: bool = False
) -> tuple[Array, float | None, float]:
    """Time in s, the Unix time of its zero for dates (else None), and s per unit.

    `factor` is s per unit where the unit is stated; else the unit is inferred, which is reported: of dates by their size, of
    others so that a sample takes at most 0.2 s. trusted: what the user states is not suspected.
    Raises RecordingError where no unit gives usual samples.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        raise RecordingError("the time column has no number", key=name, code="no-time")
    steps = np.abs(np.diff(finite))
    steps = steps[steps > 0]
    step, size = float(np.median(steps)) if len(steps) else 0.0, float(np.median(finite))
    usual = [unit for unit, seconds in _SECONDS.items() if FASTEST <= step * seconds <= 0.2]
    if factor is None:
        # Unix time: s ~ 1.7e9, ms ~ 1.7e12, us ~ 1.7e15, ns ~ 1.7e18.
        dated = next(f for f, top in ((1.0, 1e11), (1e-3, 1e14), (1e-6, 1e17), (1e-9, np.inf)) if size < top)
        early, late = np.quantile(finite, (0.05, 0.95))
        # A clock in us or ns that began with the robot has numbers as large, but they grow from 0.
        if size > EPOCH and late - early <= 0.5 * size and FASTEST * 0.1 <= step * dated <= _AWAY:
            factor = dated
        elif step > 0.2 or step == 0.0 or step >= FASTEST:
            factor = next((f for f, top in ((1.0, 0.2), (1e-3, 200.0), (1e-6, 2e5), (1e-9, 2e8)) if step <= top), None)
        if factor is None:
            raise RecordingError(
                f"its unit is not clear: its samples are {step:g} apart", key=name, code="time-unit",
                hint=f"State it: --map '{name}=time [ms]'; s, ms, us, ns, min, h and days are known",
            )  # fmt: skip
        unit = next(unit for unit, seconds in _SECONDS.items() if seconds == factor)
        slow = factor == 1.0 and step > 0.04 and np.ptp(finite) > 300.0
        if factor != 1.0 or slow:
            counts = " (or does it count the rows? Then give --rate)" if step == 1.0 and abs(finite[0]) <= 1.0 else ""
            findings.append(
                Problem(f"time states no unit; read as {unit}, since its samples are {step:g} apart{counts}", key=name,
                        hint=f"Say otherwise with --map '{name}=time [s]'", code="time-unit-assumed")
            )  # fmt: skip
    elif step and usual and not trusted and not FASTEST <= step * factor <= SLOWEST:
        findings.append(
            Problem(f"its samples are {step * factor:g} s apart by the unit that it states; in {usual[0]} they would be "
                    f"{step * _SECONDS[usual[0]]:g} s", key=name, hint=f"If so: --map '{name}=time [{usual[0]}]'",
                    code="suspected-time")
        )  # fmt: skip
    if size * factor <= EPOCH:
        return values * factor, None, factor
    zero = float(finite[np.abs(finite - size) * factor < EPOCH][0])
    # A float of 1.7e9 s resolves 2.4e-7 s: rounded to what was written, a sample at 0.2 s is at 0.2 s again.
    digits = int(np.floor(-np.log10(np.spacing(size) * factor)))
    return np.round((values - zero) * factor, digits), zero * factor, factor


def clean_time(time: Array, lines: NDArray[np.int64] | None, *, name: str) -> tuple[NDArray[np.bool_], list[Problem]]:
    """Which samples to keep so that time rises strictly, and what was found.

    Of samples with one stamp the first is kept. Stamps far away from all others, and those that go backward, are left out;
    raises RecordingError where that concerns too many: two time bases, or two recordings in one file.
    """
    where = np.arange(1, len(time) + 1) if lines is None else lines
    noun = "sample" if lines is None else "line"
    findings: list[Problem] = []

    def line_of(bad: NDArray[np.bool_]) -> int | None:
        return int(where[bad][0]) if lines is not None else None

    def report(bad: NDArray[np.bool_], what: str, code: str, hint: str | None = None) -> None:
        if bad.any():
            said = lines_text(where[bad]).replace("line", noun)
            findings.append(
                Problem(f"{int(bad.sum())} {what}, dropped: {said}", key=name, code=code, hint=hint, line=line_of(bad))
            )

    valid = np.isfinite(time)
    report(~valid, f"{noun}s without a valid time", "bad-time")
    if valid.sum() < 2:
        raise RecordingError(f"{int(valid.sum())} samples with a valid time; at least 2 are needed", key=name, code="too-short")
    low, high = np.percentile(time[valid], (5, 95))
    away = valid & (np.abs(np.nan_to_num(time) - np.median(time[valid])) > max(_AWAY, 10 * (high - low)))
    # One stamp that is ahead of both that follow it, which go on where the one before it was.
    inner = np.flatnonzero(valid & ~away)
    t = time[inner]
    after, later = np.r_[t[1:], np.inf], np.r_[t[2:], np.inf, np.inf]
    ahead = (t > after) & (t > later) & (after > np.r_[-np.inf, t[:-1]])
    stray = away.copy()
    stray[inner[ahead]] = True
    if away.sum() > max(2, 0.01 * valid.sum()):
        worst = int(np.flatnonzero(away)[0])
        raise RecordingError(f"time jumps to {time[worst]:g} s: two time bases", key=name, code="two-time-bases",
                             hint="Expected one clock over the whole file; split it there", line=line_of(away))  # fmt: skip
    report(stray, "stray time stamps", "stray-time")
    keep = valid & ~stray
    inner, t = np.flatnonzero(keep), time[keep]
    if len(t) > 1 and np.mean(np.diff(t) < 0) > 0.9:
        raise RecordingError(f"time falls from {t[0]:g} s to {t[-1]:g} s: the newest sample stands first", key=name,
                             hint="Sort the file by its time", code="backward-time")  # fmt: skip
    steps = np.abs(np.diff(t))
    worst = int(np.argmax(steps)) if len(steps) > 2 else 0
    if len(steps) > 2 and steps[worst] > max(3600.0, 1e3 * (float(np.sum(np.delete(steps, worst))) or 1e9)):
        raise RecordingError(f"time jumps from {t[worst]:g} s to {t[worst + 1]:g} s: two time bases", key=name,
                             code="two-time-bases", hint="Expected one clock over the whole file; split it there")  # fmt: skip
    top = np.maximum.accumulate(t)
    fresh = np.r_[True, t[1:] > top[:-1] + NEAREST]
    repeated, backward = np.zeros(len(time), dtype=bool), np.zeros(len(time), dtype=bool)
    repeated[inner[~fresh & (t == top)]] = True
    backward[inner[~fresh & (t < top)]] = True
    if backward.sum() > 0.1 * len(t):
        at = int(np.flatnonzero(backward)[0])
        raise RecordingError(
            f"time jumps back to {time[at]:g} s at {noun} {where[at]} and stays behind: two time bases, or two recordings",
            key=name, hint="Expected one time that rises; split the file there", code="two-time-bases", line=line_of(backward),
        )  # fmt: skip
    if repeated.sum() > 0.5 * len(t):
        raise RecordingError(
            f"{int(repeated.sum())} of {len(t)} rows have the time of the row before: too few digits, or there is a row for "
            "each of several joints", key=name, hint="Give the sampling rate with --rate", code="repeated-time",
        )  # fmt: skip
    report(repeated, "duplicate time stamps", "duplicate-time",
           "Give the sampling rate with --rate to keep all samples" if repeated.sum() > 0.2 * len(t) else None)  # fmt: skip
    report(backward, "time stamps that go backward", "backward-time")
    keep[inner[~fresh]] = False
    if keep.sum() < 2:
        raise RecordingError(
            f"{int(keep.sum())} samples with times that rise; at least 2 are needed", key=name, code="too-short"
        )
    return keep, findings + _spacing(time[keep], where[keep], name=name, numbered=lines is not None)


def _spacing(t: Array, where: NDArray[np.int64], *, name: str, numbered: bool) -> list[Problem]:
    """Dropped samples and jitter of rising times."""
    steps = np.diff(t)
    if len(t) < 4:
        return []
    typical = float(np.median(steps))
    gaps = np.flatnonzero(steps > 1.7 * typical)
    findings = []
    if len(gaps):
        missing = int(np.sum(np.round(steps[gaps] / typical) - 1))
        worst = gaps[np.argmax(steps[gaps])]
        after = f" after line {where[worst]}" if numbered else ""
        findings.append(
            Problem(f"{missing} samples are missing in {len(gaps)} gaps; the longest is {steps[worst]:.4g} s at t = "
                    f"{t[worst]:.6g} s{after}", key=name, line=int(where[gaps[0]]) if numbered else None,
                    code="dropped-samples")
        )  # fmt: skip
    regular = steps[steps <= 1.7 * typical]
    if (jitter := float(np.std(regular))) > 0.01 * typical:
        findings.append(
            Problem(f"samples are {typical * 1e3:.4g} ms apart with a jitter of {jitter * 1e3:.2g} ms (standard deviation), "
                    f"{np.min(steps) * 1e3:.4g} to {np.max(steps) * 1e3:.4g} ms", key=name, code="jitter")
        )  # fmt: skip
    return findings
