"""Rows of messages. A row contains the messages of all topics for one sample; NumPy fills the rows' byte matrix by columns."""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from asrsim.log.cdr import ENCAPSULATION, MessageColumn
from asrsim.log.topics import Topic
from asrsim.samples import Array, Samples

MESSAGE_HEADER = struct.Struct("<BQHIQQ")
"""Header before a message's data in a chunk: opcode, length, channel, sequence, log time, publish time."""

_HEAD = np.dtype([("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8"), ("cdr", f"V{len(ENCAPSULATION)}"), ("stamp", "<u8")])
"""Fields of a message's header that change from row to row, and the time stamp with which most messages begin. One copy of all
these fields is faster than a copy of each field."""
_HEAD_BYTES, _SHORT_HEAD_BYTES = f"V{_HEAD.itemsize}", f"V{_HEAD.itemsize - 8}"
_HEAD_PLACE = 11
"""Offset of the fields of `_HEAD` in a message's header, bytes."""
_STAMP_PLACE = len(ENCAPSULATION)
"""Offset of a time stamp at the beginning of a message's data, bytes."""
_CHUNK_BYTES = 4 << 20
"""Size of the rows in memory, bytes."""
_ROOM = 1 << 20
"""Memory reserved for other messages before the rows of a chunk, bytes. It is large, since unused memory costs nothing."""
_ROWS = (256, 2048)
"""Smallest and largest number of rows in a chunk. With fewer rows, calls take longer than copying; with more rows, a killed run
loses more samples.
"""


class RowBuffer:
    """Buffer of the rows of the next chunk."""

    def __init__(self, topics: Sequence[tuple[int, Topic]]) -> None:
        """topics: (channel id, topic) for each message of a row, in order."""
        self.channels = [channel for channel, _ in topics]
        self._starts: list[int] = []
        row = bytearray()
        for channel, topic in topics:
            self._starts.append(len(row))
            data = topic.template.data
            row += MESSAGE_HEADER.pack(Opcode.MESSAGE, MESSAGE_HEADER.size - 9 + len(data), channel, 0, 0, 0) + data
        self.row_size = len(row)
        self.capacity = int(np.clip(_CHUNK_BYTES // self.row_size, *_ROWS))
        self.count = 0
        self._memory = np.empty(_ROOM + self.capacity * self.row_size, np.uint8)
        self._memory[_ROOM:].reshape(self.capacity, self.row_size)[:] = np.frombuffer(row, np.uint8)
        self._times = np.zeros(self.capacity, "<u8")
        # Write only to views of the variable numbers, since the constant bytes of the rows are the same in all chunks.
        self._heads: list[NDArray[Any]] = []
        self._short_heads: list[NDArray[Any]] = []
        """Headers of messages that begin with something other than a time stamp."""
        self._stamps: list[NDArray[Any]] = []
        """Time stamps that are not at the beginning of a message."""
        self._floats: list[tuple[NDArray[Any], MessageColumn]] = []
        for start, (_, topic) in zip(self._starts, topics, strict=True):
            template, begin = topic.template, start + MESSAGE_HEADER.size
            # If a message begins with a float64 instead of a time stamp, the message header writes a time stamp to its place,
            # and the float64 then replaces the stamp.
            if _STAMP_PLACE in template.stamps or _STAMP_PLACE in dict(template.floats):
                self._heads.append(self._view(start + _HEAD_PLACE, _HEAD_BYTES))
            else:
                self._short_heads.append(self._view(start + _HEAD_PLACE, _SHORT_HEAD_BYTES))
            self._stamps += [self._view(begin + place, "<u8") for place in template.stamps if place != _STAMP_PLACE]
            self._floats += [(self._view(begin + place, "<f8"), column) for place, column in template.floats]
        self._sources = tuple(dict.fromkeys((column.kind, column.name) for _, column in self._floats))

    def append(self, samples: Samples, start: int, sequence: int) -> int:
        """Copy the samples that begin with row `start` into the buffer until it is full. Returns the number of copied samples.

        sequence: Number of the first copied sample, counted from the start of the log.
        """
        taken = min(len(samples.time) - start, self.capacity - self.count)
        here = slice(self.count, self.count + taken)
        there = slice(start, start + taken)
        times = np.rint(samples.time[there] * 1e9).astype("<u8")
        self._times[here] = times
        heads = np.empty(taken, _HEAD)
        heads["sequence"] = np.arange(sequence, sequence + taken, dtype="<u8")
        heads["log"] = heads["publish"] = times
        heads["cdr"] = np.void(ENCAPSULATION)
        # A stamp is an int32 with seconds, followed by a uint32 with nanoseconds.
        seconds, nanoseconds = np.divmod(times, np.uint64(1_000_000_000))
        heads["stamp"] = stamps = seconds | (nanoseconds << np.uint64(32))
        whole, short = (np.ndarray(taken, kind, heads.data, 0, heads.strides) for kind in (_HEAD_BYTES, _SHORT_HEAD_BYTES))
        for view in self._heads:
            view[here] = whole
        for view in self._short_heads:
            view[here] = short
        for view in self._stamps:
            view[here] = stamps
        parts = {(kind, name): _parts(samples, kind, name, there) for kind, name in self._sources}
        for view, (kind, name, part) in self._floats:
            view[here] = parts[kind, name][part]
        self.count += taken
        return taken

    def messages(self, before: bytes = b"") -> memoryview:
        """Bytes of other records, and then of all messages in the buffer."""
        rows = self._memory[: _ROOM + self.count * self.row_size]
        if len(before) > _ROOM:
            return memoryview(b"".join((before, rows[_ROOM:].data)))
        place = _ROOM - len(before)
        rows[place:_ROOM] = np.frombuffer(before, np.uint8)
        return rows[place:].data

    def span(self) -> tuple[int, int]:
        """Earliest and latest log time in ns; (0, 0) without rows."""
        times = self._times[: self.count]
        return (int(times.min()), int(times.max())) if self.count else (0, 0)

    def message_indexes(self, offset: int) -> tuple[memoryview, int]:
        """Message index records of all channels, and the length of one record. offset: bytes before the first row."""
        count = self.count
        size = 15 + 16 * count
        records = np.empty((len(self.channels), size), np.uint8)
        for record, channel in zip(records, self.channels, strict=True):
            head = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, size - 9, channel, 16 * count)
            record[:15] = np.frombuffer(head, np.uint8)
        entries = np.ndarray((len(self.channels), count, 2), "<u8", records.data, 15, (size, 16, 8))
        entries[:, :, 0] = self._times[:count]
        rows = np.arange(count, dtype="<u8") * np.uint64(self.row_size)
        entries[:, :, 1] = np.asarray(self._starts, "<u8")[:, None] + (rows + np.uint64(offset))
        return records.reshape(-1).data, size

    def clear(self) -> None:
        """Empty the buffer for the next chunk."""
        self.count = 0

    def _view(self, offset: int, kind: str) -> NDArray[Any]:
        return np.ndarray((self.capacity,), kind, self._memory.data, _ROOM + offset, (self.row_size,))


def _parts(samples: Samples, kind: str, name: str, rows: slice) -> Mapping[str | int, Array | float]:
    """Values (n,) of each part of a quantity, a body or a contact (see `MessageColumn.part`); NaN if the samples lack it.

    The numbers of a part are contiguous, since copies from strided to strided arrays take twice as long.
    """
    if kind == "time":
        return {"": samples.time[rows]}
    values = {"value": samples.values, "body": samples.bodies, "contact": samples.contacts}[kind].get(name)
    if values is None:
        return defaultdict(lambda: np.nan)
    names = samples.joints if kind == "value" else range(values.shape[1])
    return dict(zip(names, np.ascontiguousarray(values[rows].T), strict=True))
