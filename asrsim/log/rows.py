"""Rows of messages. A row contains the messages of all topics for one sample; NumPy fills the rows' byte matrix by columns."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from asrsim.log.cdr import MessageColumn
from asrsim.log.topics import Topic
from asrsim.samples import Array, Samples

MESSAGE_HEADER = struct.Struct("<BQHIQQ")
"""Header before a message's data in a chunk: opcode, length, channel, sequence, log time, publish time."""

_CHUNK_BYTES = 4 << 20
"""Size of the rows in memory, bytes."""
_ROWS = (256, 2048)
"""Fewest and most rows in a chunk. With fewer rows, calls cost more time than copying; with more, a kill loses more samples."""


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
        self._bytes = np.tile(np.frombuffer(bytes(row), np.uint8), (self.capacity, 1))
        self._times = np.zeros(self.capacity, "<u8")
        # The constant bytes are kept for all chunks; only these views are written to.
        self._sequences = [self._view(start + 11, "<u4") for start in self._starts]
        self._log_times = [self._view(start + place, "<u8") for start in self._starts for place in (15, 23)]
        stamps = [
            start + MESSAGE_HEADER.size + offset
            for start, (_, topic) in zip(self._starts, topics, strict=True)
            for offset in topic.template.stamps
        ]
        self._stamps = [(self._view(stamp, "<i4"), self._view(stamp + 4, "<u4")) for stamp in stamps]
        self._floats = [
            (self._view(start + MESSAGE_HEADER.size + offset, "<f8"), column)
            for start, (_, topic) in zip(self._starts, topics, strict=True)
            for offset, column in topic.template.floats
        ]
        self._columns = tuple(dict.fromkeys(column for _, column in self._floats))

    def append(self, samples: Samples, start: int, sequence: int) -> int:
        """Copy samples from row `start` on into the buffer until it is full. Returns the number of copied samples.

        sequence: Number of the first copied sample, counted from the start of the log.
        """
        taken = min(len(samples.time) - start, self.capacity - self.count)
        here = slice(self.count, self.count + taken)
        there = slice(start, start + taken)
        times = np.rint(samples.time[there] * 1e9).astype("<u8")
        seconds, nanoseconds = np.divmod(times, np.uint64(1_000_000_000))
        sequences = np.arange(sequence, sequence + taken, dtype="<u8").astype("<u4")
        self._times[here] = times
        for view in self._sequences:
            view[here] = sequences
        for view in self._log_times:
            view[here] = times
        for whole, rest in self._stamps:
            whole[here] = seconds
            rest[here] = nanoseconds
        sources = {column: _source(samples, column, there) for column in self._columns}
        for view, column in self._floats:
            view[here] = sources[column]
        self.count += taken
        return taken

    def messages(self) -> memoryview:
        """Bytes of all messages in the buffer."""
        return self._bytes[: self.count].data.cast("B") if self.count else memoryview(b"")

    def span(self) -> tuple[int, int]:
        """Earliest and latest log time in ns; (0, 0) without rows."""
        times = self._times[: self.count]
        return (int(times.min()), int(times.max())) if self.count else (0, 0)

    def message_indexes(self, offset: int) -> tuple[bytes, int]:
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
        return records.tobytes(), size

    def clear(self) -> None:
        """Empty the buffer for the next chunk."""
        self.count = 0

    def _view(self, offset: int, kind: str) -> NDArray[Any]:
        return np.ndarray((self.capacity,), kind, self._bytes.data, offset, (self.row_size,))


def _source(samples: Samples, column: MessageColumn, rows: slice) -> Array | float:
    if column.kind == "time":
        return samples.time[rows]
    if column.kind == "value":
        values = samples.values.get(column.name)
        return np.nan if values is None else values[rows, samples.joints.index(str(column.part))]
    table = samples.bodies if column.kind == "body" else samples.contacts
    return table[column.name][rows, int(column.part)]
