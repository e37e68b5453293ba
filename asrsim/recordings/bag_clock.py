"""Messages of several topics as series on one clock: their headers' stamps, or the times at which they were recorded."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError
from asrsim.recordings.cells import printable
from asrsim.recordings.condense import condense
from asrsim.recordings.data import RawSeries
from asrsim.recordings.messages import understand
from asrsim.recordings.time_columns import is_time
from asrsim.recordings.timebase import EPOCH, clean_time
from asrsim.recordings.units import split_header
from asrsim.samples import Array

_AWAY = 60_000_000_000
"""ns that a stamp may be away from the others of its topic, or ten times what most of these span."""
_OVERTAKEN = 500_000_000
"""ns by which messages may overtake each other on their way to the recorder."""
_STALLED = 100_000_000
"""ns of recording without a newer stamp, from which on a clock began anew and nothing was overtaken."""
_SCALES = (1.0, 1e-3, 1e-6, 1e-9)
"""s in one of a number that tells a time."""
_ONE_DAY = 86_400.0
"""s by which a time since 1970 may differ from that of the recording."""
_SAME_CLOCK = 1.0
"""s by which a header's stamp may differ from the time of recording and still be of the same clock."""


@dataclass
class Group:
    """Messages of one topic with the same labels."""

    topic: str
    kind: str
    labels: list[tuple[str, str | None]]
    logged: list[int] = field(default_factory=list)
    stamped: list[int | None] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)
    gaps: bool = False
    """Whether some messages leave out what others have."""

    def has(self, labels: list[tuple[str, str | None]]) -> bool:
        """Whether a message is of these: it has the same labels in another order, or more or less of those with names."""
        own, other = set(self.labels), set(labels)
        return own == other or ((own < other or own > other) and all(_named(label, joint) for label, joint in own | other))

    def row(self, labels: list[tuple[str, str | None]], values: list[float]) -> list[float]:
        """Values in the order of the labels, of which there may be new ones."""
        told = dict(zip(labels, values, strict=True))
        self.gaps |= len(told) != len(self.labels)
        self.labels += [label for label in labels if label not in self.labels]
        return [told.get(label, np.nan) for label in self.labels]

    def table(self) -> Array:
        """(messages, labels), NaN where a message has none."""
        if not self.gaps:
            return np.array(self.rows)
        return np.array([row + [np.nan] * (len(self.labels) - len(row)) for row in self.rows])


def _named(label: str, joint: str | None) -> bool:
    """Whether a number has more than a place in an array."""
    return joint is not None or re.search(r"\[\d+\]", label) is None


def series_of_groups(groups: list[Group], path: Path, findings: list[Problem]) -> tuple[tuple[RawSeries, ...], float | None]:
    """Series on one clock: header stamps where they agree with the time of recording, else the time of recording."""
    for group in groups:
        _own_time(group, path, findings)
    clocks = [_offset(group) for group in groups]
    known = [offset for offset in clocks if offset is not None]
    # All topics stamped by one other clock (simulated time, the robot's uptime) is one base as well.
    one_other = len(known) == len(clocks) and np.ptp(known) < _SAME_CLOCK
    nanoseconds: list[NDArray[np.int64]] = []
    for group, offset in zip(groups, clocks, strict=True):
        stamps = offset is not None and (abs(offset) < _SAME_CLOCK or one_other)
        if offset is not None and not stamps:
            findings.append(
                Problem(f"two time bases: header stamps are {abs(offset):.6g} s off the time of recording, and not all "
                        "topics have them; the time of recording is used", file=path, key=group.topic, code="two-time-bases")
            )  # fmt: skip
        nanoseconds.append(np.array(group.stamped if stamps else group.logged, dtype=np.int64))
        if stamps:
            nanoseconds[-1] = _in_order(nanoseconds[-1], group, path, findings)
    sound = [_sound(ns, group, path, findings) for ns, group in zip(nanoseconds, groups, strict=True)]
    first = min(int(ns[keep].min()) for ns, keep in zip(nanoseconds, sound, strict=True))
    zero = first if first * 1e-9 > EPOCH else 0
    series: list[RawSeries] = []
    names: Counter[str] = Counter()
    broken: list[Problem] = []
    for group, ns, good in zip(groups, nanoseconds, sound, strict=True):
        seconds: Array = np.asarray((ns[good] - zero) * 1e-9, dtype=np.float64)
        try:
            keep, found = clean_time(seconds, None, path=path, name=group.topic)
        except RecordingError as error:
            # One topic whose time is broken does not take the others with it.
            broken += error.problems
            continue
        findings += found
        time, rows = seconds[keep], group.table()[good][keep]
        for i, (label, named) in enumerate(group.labels):
            joint, quantity, unit = understand(group.topic, group.kind, label, named)
            joint = None if joint is None else printable(joint)
            name = printable(group.topic if label == "data" else f"{group.topic}/{label}")
            names[name] += 1
            name = name if names[name] == 1 else f"{name}#{names[name]}"
            told = np.isfinite(rows[:, i]) if group.gaps else np.ones(len(time), dtype=bool)
            own, values = (time, rows[:, i]) if told.all() else (time[told], rows[told, i])
            if len(own) > 1:
                series.append(RawSeries(name=name, time=own, values=values, unit=unit, joint=joint, quantity=quantity))
    if not series:
        raise RecordingError(condense(broken))
    findings += [replace(problem, message=f"topic is not read: {problem.message}", code="unread-topic") for problem in broken]
    return tuple(series), (zero * 1e-9 if zero else None)


def _own_time(group: Group, path: Path, findings: list[Problem]) -> None:
    """Messages without a stamp get that of a number among theirs, where it is certain that it tells when they were sent."""
    if any(stamp is not None for stamp in group.stamped) or group.gaps:
        return
    logged, rows = np.array(group.logged, dtype=np.float64) * 1e-9, group.table()
    for i, (label, _) in enumerate(group.labels):
        name, unit = split_header(label)
        time = rows[:, i]
        if "[" in label or "." in label or not is_time(name, unit) or np.any(np.diff(time) < 0) or time[-1] == time[0]:
            continue
        near = [one for one in _SCALES if np.median(np.abs(time * one - logged)) < _ONE_DAY]
        stated = [unit.factor] if unit is not None and unit.si == "s" else near
        if stated:
            group.stamped = [int(stamp) for stamp in np.round(time * (stated[0] * 1e9))]
            return
        step = float(np.median(np.diff(logged)))
        if min(float(np.ptp(time * one - logged)) for one in _SCALES) > step:
            findings.append(
                Problem("is named as a time and goes otherwise than the time of recording, which is used", file=path,
                        key=f"{group.topic}/{label}", code="two-time-bases", hint="Export the topic as CSV to use it")
            )  # fmt: skip


def _in_order(ns: NDArray[np.int64], group: Group, path: Path, findings: list[Problem]) -> NDArray[np.int64]:
    """Stamps in their order, and the group's rows with them, where messages only overtook each other on their way."""
    late = np.maximum.accumulate(ns) - ns
    newest = np.array(group.logged, dtype=np.int64)[late == 0]
    stalled = np.diff(np.append(newest, group.logged[-1])).max()
    if not late.any() or late.max() > _OVERTAKEN or stalled > max(_STALLED, 0.5 * late.max()):
        return ns
    order = np.argsort(ns, kind="stable")
    group.rows = [group.rows[i] for i in order]
    message = f"{int((late > 0).sum())} messages were recorded after later ones; all are put in the order of their stamps"
    findings.append(Problem(message, file=path, key=group.topic, code="overtaken"))
    return ns[order]


def _sound(ns: NDArray[np.int64], group: Group, path: Path, findings: list[Problem]) -> NDArray[np.bool_]:
    """Messages whose stamp is no nonsense: far away from the others."""
    low, high = np.percentile(ns - ns.min(), (5, 95))
    keep = np.asarray(np.abs(ns - np.int64(np.median(ns))) < max(_AWAY, 10 * (high - low)), dtype=bool)
    bad = int(np.sum(~keep))
    if bad:
        findings.append(
            Problem(f"{bad} messages are left out, whose stamps are far away from the others'", file=path,
                    key=group.topic, code="bad-time")
        )  # fmt: skip
    return keep


def _offset(group: Group) -> float | None:
    """Median of header stamp minus time of recording in s; None where a message has no stamp."""
    stamps = [stamp for stamp in group.stamped if stamp is not None]
    if len(stamps) < len(group.stamped):
        return None
    return float(np.median(np.array(stamps, dtype=np.int64) - np.array(group.logged, dtype=np.int64))) * 1e-9
