"""Which columns of a table hold time: by what was said, by name, by unit, else one that rises evenly and is no counter."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from asrsim.errors import Problem, RecordingError
from asrsim.recordings.cells import printable
from asrsim.recordings.delimited import Table
from asrsim.recordings.mapping import ColumnMap
from asrsim.recordings.names import VOCABULARY, find_column, tokens_of
from asrsim.recordings.stamps import MERGED
from asrsim.recordings.timebase import EPOCH
from asrsim.recordings.units import Unit, find_unit, split_header
from asrsim.samples import Array

TIME_WORDS = {
    "time",
    "t",
    "timestamp",
    "stamp",
    "ts",
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
    "micros",
    "nanos",
    "datum",
    "zeitstempel",
    "seconds",
    "epoch",
    "unix",
    "utc",
    "gmt",
    "local",
}
"""Words that name a time, or say which."""
_RATE = re.compile(
    r"\b(?:(?P<rate>rate|freq(?:uency)?|f_?s)|(?:sampl\w*|step)[ _]?(?:time|period|interval)|ts|dt|delta_x)"
    r"\s*(?:[\[(](?P<before>\w+)[\])])?[\s:;,=]*(?P<number>\d+(?:\.\d+)?(?:e[-+]?\d+)?)\s*(?P<after>[kmuµn]?(?:hz|s)\b)?",
    re.IGNORECASE,
)
"""`fs = 500 Hz`, `Sample time [ms]: 2` among the remarks above the numbers."""
_WHOLE = 0.9
"""Share of rows that must have a stamp for all rows to be of one kind of message."""
_COUNTERS = {"tick", "ticks", "count", "counts", "counter", "cycle", "cycles", "sample", "samples", "frame", "frames", "index"}
"""Words of what rises evenly and is no time, for want of what one of it takes."""
_MEASURED = {"at", "rise", "delay", "sample", "step", "constant", "dt", "delta", "period", "interval", "latency", "jitter"}
"""Words of what takes time and tells none."""


def time_columns(
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
    if (told := next((one for one in maps if one.role == "time"), None)) is not None:
        index = find_column(told.column, labels)
        if index is None:
            raise RecordingError(
                "there is no such column for the time", file=path, key=told.column, choices=tuple(labels), code="no-time"
            )
        return [index], factors if told.unit is None else factors | {index: told.unit.factor}
    mapped = {find_column(one.column, labels) for one in maps}
    free = [i for i in range(len(labels)) if i not in mapped and i not in table.layout.text]
    named = _named(path, table, [i for i in free if is_time(names[i], stated[i])], findings)
    if (sent := _sent(path, table, named, findings)) is not None:
        return [sent], factors
    if named or table.layout.stamps:
        return sorted({*named, *(i for i in table.layout.stamps if not named)}), factors
    return [_rising(path, table, [i for i in free if stated[i] is None], names, findings)], factors


def _named(path: Path, table: Table, named: list[int], findings: list[Problem]) -> list[int]:
    """Of the columns that are named as times those with numbers; of these those that go on, if any does."""
    blank = [i for i in named if i not in table.layout.stamps and not np.isfinite(table.values[:, i]).any()]
    findings += [
        Problem("is named as a time but has no numbers; not used", file=path, key=table.layout.names[i], code="empty-time")
        for i in blank
    ]
    named = [i for i in named if i not in blank]
    return [i for i in named if _goes_on(table.values[:, i])] or named


def _sent(path: Path, table: Table, named: Sequence[int], findings: list[Problem]) -> int | None:
    """The stamp of messages, where nothing but the time of their recording stands beside it: messages know when they were
    sent, which is when they were measured; a recorder knows when it got them."""
    labels = table.layout.names
    sent = [i for i in named if is_stamp(labels[i]) and np.isfinite(table.values[:, i]).mean() > _WHOLE]
    got = [
        i for i in named if set(tokens_of(labels[i])) & {"rosbag", "rosbagtimestamp"} or labels[i].lower() in ("time", "__time")
    ]
    if not sent or not got or len(named) != len({*sent, *got}):
        return None
    findings.append(
        Problem(f"is when messages were sent, and is used; '{labels[got[0]]}' is when they were recorded",
                file=path, key=labels[sent[0]], code="second-time", hint=f"Use that with --map '{labels[got[0]]}=time'")
    )  # fmt: skip
    return sent[0]


def _rising(path: Path, table: Table, free: Sequence[int], names: Sequence[str], findings: list[Problem]) -> int:
    """A column without unit that rises evenly, is not named as a signal, and counts nothing. Raises RecordingError."""
    labels = table.layout.names
    # What is named as a signal is no time, however evenly it rises.
    even = [
        i for i in free
        if _rises(table.values[:, i]) and (_nameless(table, i) or not set(tokens_of(names[i])) & VOCABULARY)
    ]  # fmt: skip
    # What counts 0, 1, 2 and is not called a time is an index, no time in ms: pandas writes one, under a blank name.
    counters = [
        i for i in even
        if _steps_by_one(table.values[:, i]) or _is_index(table, i) or set(tokens_of(names[i])) & _COUNTERS
    ]  # fmt: skip
    if rising := [i for i in even if i not in counters]:
        findings.append(
            Problem("no column is named as the time; this one rises evenly and is taken", file=path,
                    key=labels[rising[0]], hint="Say otherwise with --map COLUMN=time", code="time-guessed")
        )  # fmt: skip
        return rising[0]
    if (said := next((i for i in table.layout.text if is_time(split_header(labels[i])[0], None)), None)) is not None:
        raise RecordingError(
            "is named as a time, but its cells are neither numbers nor dates that are known", file=path, key=labels[said],
            code="no-time", hint="Expected s or ms, or dates like 2024-05-06 10:00:00.002; or give the rate: --rate",
        )  # fmt: skip
    if counters:
        nameless = counters[0] in table.layout.unnamed
        which = f"column {counters[0] + 1}, which has no name," if nameless else f"'{labels[counters[0]]}'"
        what = "the rows" if _steps_by_one(table.values[:, counters[0]]) else "something"
        raise RecordingError(
            f"no time column found; {which} counts {what}", file=path, code="no-time",
            hint="Give the sampling rate with --rate, or name the time with --map COLUMN=time [unit]",
        )  # fmt: skip
    raise RecordingError(
        f"no time column found among {', '.join(labels[:20])}", file=path, code="no-time",
        hint=told_rate(table.layout.remarks)
        or "Expected a column that rises, named time or t; name it with --map COLUMN=time or give --rate",
    )  # fmt: skip


def told_rate(remarks: str) -> str | None:
    """The cure where the file says how fast it was sampled: `# fs = 500 Hz`, `Sample time [ms]; 2`."""
    match = _RATE.search(remarks)
    unit = None if match is None else find_unit(match["before"] or match["after"] or ("Hz" if match["rate"] else "s"))
    if match is None or unit is None or unit.si != ("Hz" if match["rate"] else "s") or not float(match["number"]):
        return None
    told = unit.factor * float(match["number"])
    return f"The file says '{printable(' '.join(match[0].split()))}': give --rate {told if match['rate'] else 1 / told:.9g}"


def is_time(name: str, unit: Unit | None) -> bool:
    """Whether a column is named as a time, or by its unit is one."""
    words = {word for word in tokens_of(name) if not word.isdecimal()}
    if unit is not None and unit.si != "s":
        return False
    if words == {"x", "value"}:  # LabVIEW
        return True
    if words & _MEASURED and not words & {"stamp", "timestamp"}:
        return False
    return bool(words & TIME_WORDS) or (unit is not None and unit.si == "s" and len(words) <= 1)


def named_clock(name: str, clocks: Sequence[str]) -> str | None:
    """The one of several clocks that is named after it, with most of its words: `q1_time` of q1 and dq1; else None."""
    words = set(_own_words(name))
    shares = {clock: len((set(_own_words(clock)) - TIME_WORDS) & words) for clock in clocks}
    best = [clock for clock, share in shares.items() if share == max(shares.values()) > 0]
    return best[0] if len(best) == 1 else None


def _own_words(name: str) -> list[str]:
    """Words of a name without those that make it the second one of that name."""
    return tokens_of(split_header(re.sub(r"#\d+$", "", name))[0])


def is_stamp(label: str) -> bool:
    """Whether a column is the stamp in the header of messages."""
    return label == MERGED or {"header", "stamp"} <= set(tokens_of(label))


def _nameless(table: Table, column: int) -> bool:
    return column in table.layout.unnamed or table.layout.header_line is None


def _goes_on(values: Array) -> bool:
    """Whether a column mostly rises: the duration of a loop, however it is called, does not."""
    steps = np.diff(values[np.isfinite(values)])
    return bool(np.any(steps > 0) and np.mean(steps < 0) < 0.25)


def _steps_by_one(values: Array) -> bool:
    finite = values[np.isfinite(values)]
    return bool(np.median(np.diff(finite)) == 1.0)


def _is_index(table: Table, column: int) -> bool:
    """Whole numbers under a blank name, of rows of which some were left out: an index still, unless they are Unix times."""
    values = table.values[:, column]
    finite = values[np.isfinite(values)]
    return column in table.layout.unnamed and bool(np.all(finite == np.round(finite)) and np.max(np.abs(finite)) < EPOCH)


def _rises(values: Array) -> bool:
    """Increases nearly always, by nearly the same step."""
    finite = values[np.isfinite(values)]
    if len(finite) < 3 or len(finite) < 0.9 * len(values):
        return False
    steps = np.diff(finite)
    typical = float(np.median(steps))
    return typical > 0 and float(np.mean(np.abs(steps - typical) < typical)) > 0.95
