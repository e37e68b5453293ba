"""Reads logs: `read_log` into arrays, `open_log` for logs that are larger than memory."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypedDict, TypeVar, Unpack

import numpy as np
from mcap.exceptions import McapError

from asrsim.errors import LogError, Problem
from asrsim.log.cdr import MessageColumn
from asrsim.log.columns import ColumnReader
from asrsim.log.description import RESULT_METADATA, RUN_METADATA, info_from, origin_from
from asrsim.log.structure import ChunkPlace, Structure, corrupt, read_chunk, read_structure
from asrsim.quantities import QUANTITIES
from asrsim.samples import Array, Command, RunInfo, Samples, WrenchCommand, concatenate

T = TypeVar("T")


class Selection(TypedDict, total=False):
    """Selection of samples, as described at `LogReader.iter_samples`."""

    quantities: Sequence[str] | None
    joints: Sequence[str] | None
    start: float | None
    end: float | None
    stride: int | None


@dataclass(frozen=True, kw_only=True)
class Log:
    """Log, or a selected part of a log, in memory."""

    path: Path
    info: RunInfo
    samples: Samples
    metadata: Mapping[str, str]
    """Metadata of the run (versions, seed, engine, ...) and of its result, as text."""
    truncated: bool
    """True: the run did not close its log. All samples up to the last complete chunk can be read."""
    status: str
    """Status that the run wrote (`complete`, `interrupted`, `failed`, ...); `truncated` if the run wrote no status."""


class LogReader:
    """Reader of a log, which keeps neither samples nor an open file.

    Raises LogError if the file is damaged or not a log of asrsim. A truncated log raises no error.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._structure: Structure = read_structure(self.path)
        try:
            self.info: RunInfo = info_from(self._structure.attachments)
        except LogError as error:
            raise LogError(replace(problem, file=self.path) for problem in error.problems) from error

    @property
    def truncated(self) -> bool:
        """Whether the run did not close its log."""
        return self._structure.truncated

    @property
    def metadata(self) -> dict[str, str]:
        """Metadata of the run and of its result."""
        records = self._structure.metadata
        return {**records.get(RUN_METADATA, {}), **records.get(RESULT_METADATA, {})}

    @property
    def status(self) -> str:
        """Status that the run wrote (`complete`, `interrupted`, `failed`, ...); `truncated` if the run wrote no status."""
        return self._structure.metadata.get(RESULT_METADATA, {}).get("status", "truncated")

    @property
    def duration(self) -> float:
        """Simulated time from the first to the last sample, s, rounded to ns."""
        chunks = self._structure.chunks
        return (chunks[-1].end - chunks[0].start) * 1e-9 if chunks else 0.0

    def read(self, **selection: Unpack[Selection]) -> Log:
        """Log with all samples or a selection. Arguments as in `iter_samples`. Raises LogError also if no sample lies between
        `start` and `end`."""
        parts = list(self.iter_samples(**selection))
        window = (selection.get("start"), selection.get("end")) != (None, None)
        if not parts and window and (chunks := self._structure.chunks):
            hint = f"It lasts from {chunks[0].start * 1e-9:g} to {chunks[-1].end * 1e-9:g} s"
            raise LogError("the log contains no samples in that time", file=self.path, hint=hint, code="empty-log")
        names, members = self._selection(selection.get("quantities"), selection.get("joints"))
        return Log(
            path=self.path,
            info=self.info,
            samples=concatenate(parts, joints=members, quantities=names),
            metadata=self.metadata,
            truncated=self.truncated,
            status=self.status,
        )

    def iter_samples(
        self,
        *,
        quantities: Sequence[str] | None = None,
        joints: Sequence[str] | None = None,
        start: float | None = None,
        end: float | None = None,
        stride: int | None = None,
    ) -> Iterator[Samples]:
        """Samples of the log chunk by chunk, in constant memory.

        Args:
            quantities: Names of the quantities, in this order; None: all.
            joints: Names of the joints, in this order; None: all.
            start: First time, s, included.
            end: Last time, s, included.
            stride: Number n, if only every n-th of these samples is read.

        Raises:
            LogError: Unknown name, `end` before `start`, or damaged chunk.
        """
        names, members = self._selection(quantities, joints)
        step = 1 if stride is None else stride
        if step < 1:
            raise LogError("the stride must be 1 or more", key="stride", value=stride, code="bad-stride")
        if start is not None and end is not None and end < start:
            raise LogError(f"must not be before the start, {start:g} s", key="end", value=end, code="bad-window")
        columns = ColumnReader(self._structure.channels)
        skip, last = 0, np.empty(0)
        for place, found in self._chunks(columns, set(names), set(members), start, end):
            if MessageColumn("time") not in found:
                continue
            time = found[MessageColumn("time")]
            # Allow for rounding, since the log times of a chunk are rounded to ns, and large times to multiples of several ns.
            margin = 2.0 + 1e-12 * place.end
            inside = place.start - margin <= time[0] * 1e9 and time[-1] * 1e9 <= place.end + margin
            if not (inside and np.all(np.diff(time, prepend=last) > 0.0)):
                raise corrupt(
                    self.path,
                    f"times decrease, or lie outside the range that their chunk states, near {place.start * 1e-9:g} s",
                )
            last = time[-1:]
            low, high = -np.inf if start is None else start, np.inf if end is None else end
            chosen = np.flatnonzero((time >= low) & (time <= high))
            taken = chosen[skip::step]
            skip = (skip - len(chosen)) % step
            if len(taken):
                yield _samples(found, names, members, slice(int(taken[0]), int(taken[-1]) + 1, step))

    def _chunks(
        self, columns: ColumnReader, names: set[str], joints: set[str], start: float | None, end: float | None
    ) -> Iterator[tuple[ChunkPlace, dict[MessageColumn, Array]]]:
        def outside(place: ChunkPlace) -> bool:
            # Skip a chunk only if it is more than 1 ns outside the selected time, since its log times are rounded to ns.
            before = start is not None and place.end * 1e-9 < start - 1e-9
            return before or (end is not None and place.start * 1e-9 > end + 1e-9)

        # In a log without an index, the channels are in the chunks, so that no chunk may be skipped.
        places = self._structure.chunks
        if not self._structure.truncated:
            places = [place for place in places if not outside(place)]
        for place, found in self._decoded(places, lambda data: columns.read(data, names, joints)):
            if not outside(place):
                yield place, found

    def commands(self) -> Iterator[Command | WrenchCommand]:
        """Commands from outside in a live run, in the order in which they took effect. Raises LogError."""
        reader = ColumnReader(self._structure.channels)
        for _, commands in self._decoded(self._structure.chunks, lambda data: list(reader.commands(data))):
            yield from commands

    def _decoded(self, places: Sequence[ChunkPlace], decode: Callable[[bytes], T]) -> Iterator[tuple[ChunkPlace, T]]:
        """Result of `decode` for each chunk. A truncated log may end with a damaged chunk, which is skipped."""
        try:
            with self.path.open("rb") as file:
                for place in places:
                    try:
                        found = decode(read_chunk(file, place))
                    except (ValueError, OverflowError, struct.error, McapError, EOFError) as error:
                        if self.truncated and place is self._structure.chunks[-1]:
                            return
                        raise corrupt(self.path, f"{error} (at {place.start * 1e-9:g} s)") from error
                    yield place, found
        except OSError as error:
            raise LogError(f"cannot read the log: {error.strerror or error}", file=self.path, code="unreadable-log") from error

    def _selection(
        self, quantities: Sequence[str] | None, joints: Sequence[str] | None
    ) -> tuple[tuple[str, ...], tuple[str, ...]]:
        known = dict.fromkeys(quantity for joint in self.info.joints for quantity in joint.quantities)
        ordered = tuple(sorted(known, key=lambda name: list(QUANTITIES).index(name) if name in QUANTITIES else len(QUANTITIES)))
        members = tuple(joint.name for joint in self.info.joints)
        wanted = [("quantity", "quantities", name, ordered) for name in quantities or ()]
        wanted += [("joint", "joints", name, members) for name in joints or ()]
        problems = [
            Problem(
                f"the log has no {noun} '{name}'", file=self.path, key=key, choices=choices, meant=name, code=f"unknown-{noun}"
            )
            for noun, key, name, choices in wanted
            if name not in choices
        ]
        if problems:
            raise LogError(problems)
        return (ordered if quantities is None else tuple(quantities)), (members if joints is None else tuple(joints))


def open_log(path: str | os.PathLike[str]) -> LogReader:
    """Reader of a log, opened without reading its samples. Raises LogError if the file is damaged or not a log."""
    return LogReader(path)


def read_origin(path: Path) -> tuple[str, str]:
    """Scenario file and variant of a log, in less time than `open_log`. Raises LogError if the file is damaged or not a log."""
    return origin_from(read_structure(path).attachments)


def read_log(path: str | os.PathLike[str], **selection: Unpack[Selection]) -> Log:
    """Log read into arrays. Arguments as in `LogReader.iter_samples`. Raises LogError."""
    return LogReader(path).read(**selection)


def _samples(found: Mapping[MessageColumn, Array], names: Sequence[str], joints: Sequence[str], rows: slice) -> Samples:
    time = found[MessageColumn("time")][rows].astype(np.float64)

    def matrix(columns: Sequence[MessageColumn]) -> Array:
        # Make the samples of a joint contiguous in memory, since plots and metrics process them joint by joint.
        block = np.empty((len(columns), len(time)))
        for line, column in zip(block, columns, strict=True):
            line[:] = found[column][rows] if column in found else np.nan
        return block.T

    tables: dict[str, dict[str, Array]] = {"body": {}, "contact": {}}
    for kind, width in (("body", 7), ("contact", 3)):
        for name in dict.fromkeys(column.name for column in found if column.kind == kind):
            tables[kind][name] = matrix([MessageColumn(kind, name, index) for index in range(width)])
    return Samples(
        time=time,
        joints=tuple(joints),
        values={name: matrix([MessageColumn("value", name, joint) for joint in joints]) for name in names},
        bodies=tables["body"],
        contacts=tables["contact"],
    )
