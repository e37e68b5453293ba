"""Compares the samples of a repeated run bit for bit with the samples in its log."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from asrsim.log import LogReader
from asrsim.samples import Array, Samples


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A series that differs between log and repeated run, with its first difference."""

    kind: str
    """Kind of the series: time, value (a quantity of a joint), body or contact."""
    name: str
    """Name of the quantity, body or pair of bodies."""
    joint: str | None
    time: float
    """Time of the first differing sample, s."""
    sample: int
    """Index of the first differing sample, from 0."""
    logged: float
    repeated: float
    count: int
    """Number of samples of the series that differ."""

    def __str__(self) -> str:
        what = f"{self.name} of {self.joint}" if self.joint else self.name
        return (
            f"{what}: {self.count} samples differ, the first at t = {self.time:.6g} s (sample {self.sample}): "
            f"{self.logged!r} in the log, {self.repeated!r} now"
        )

    def as_dict(self) -> dict[str, Any]:
        """Fields as plain values for JSON; NaN and infinite numbers become text."""
        return {
            key: str(value) if isinstance(value, float) and not np.isfinite(value) else value
            for key, value in vars(self).items()
        }


class Comparer:
    """Receiver of a repeated run's samples that compares them with the samples of a log, in constant memory."""

    def __init__(self, reader: LogReader) -> None:
        self._chunks: Iterator[Samples] = reader.iter_samples()
        self._chunk: Samples | None = None
        self._row = 0
        self._found: dict[tuple[str, str, str | None], Difference] = {}
        self.samples = 0
        """Number of samples compared so far."""
        self.exhausted = False
        """Whether the end of the log was reached, so that no sample of the log is left."""

    @property
    def differences(self) -> tuple[Difference, ...]:
        """Series that differ, in the order of their first differences."""
        return tuple(sorted(self._found.values(), key=lambda one: one.sample))

    def write(self, samples: Samples) -> None:
        """Compare the next samples of the repeated run with the samples of the log."""
        position = 0
        while position < len(samples.time):
            logged = self._ahead()
            if logged is None:
                return
            count = min(len(samples.time) - position, len(logged.time) - self._row)
            here, there = slice(position, position + count), slice(self._row, self._row + count)
            self._compare(samples, here, logged, there)
            position += count
            self._row += count
            self.samples += count

    def rest(self) -> int:
        """Number of samples at the end of the log that were not compared."""
        count = 0
        while (logged := self._ahead()) is not None:
            count += len(logged.time) - self._row
            self._row = len(logged.time)
        return count

    def _ahead(self) -> Samples | None:
        while self._chunk is None or self._row >= len(self._chunk.time):
            self._chunk, self._row = next(self._chunks, None), 0
            if self._chunk is None:
                self.exhausted = True
                return None
        return self._chunk

    def _compare(self, new: Samples, here: slice, old: Samples, there: slice) -> None:
        time, after, before = old.time[there], _series_of(new, here), _series_of(old, there)
        missing = np.full(len(time), np.nan)
        for key in dict.fromkeys((*before, *after)):
            self._series(key[:3], time, before.get(key, missing), after.get(key, missing))

    def _series(self, key: tuple[str, str, str | None], time: Array, before: Array, after: Array) -> None:
        before, after = (np.ascontiguousarray(part, np.float64) for part in (before, after))
        differs = (before.view(np.uint64) != after.view(np.uint64)) & ~(np.isnan(before) & np.isnan(after))
        count = int(np.count_nonzero(differs))
        if not count:
            return
        first = self._found.get(key)
        if first is not None:
            self._found[key] = replace(first, count=first.count + count)
            return
        row = int(np.argmax(differs))
        kind, name, joint = key
        self._found[key] = Difference(
            kind=kind,
            name=name,
            joint=joint,
            time=float(time[row]),
            sample=self.samples + row,
            logged=float(before[row]),
            repeated=float(after[row]),
            count=count,
        )


def _series_of(samples: Samples, rows: slice) -> dict[tuple[str, str, str | None, int], Array]:
    """Series (n,) in these rows of the samples, by (kind, name, joint, column)."""
    found: dict[tuple[str, str, str | None, int], Array] = {("time", "time", None, 0): samples.time[rows]}
    for name, table in samples.values.items():
        found |= {("value", name, joint, 0): table[rows, j] for j, joint in enumerate(samples.joints)}
    for kind, tables in (("body", samples.bodies), ("contact", samples.contacts)):
        found |= {(kind, name, None, k): table[rows, k] for name, table in tables.items() for k in range(table.shape[1])}
    return found
