"""Reads columns of numbers, and commands, from the chunks of a log. All rows of a chunk have equal length, so a column is a
strided view of the chunk.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Collection, Iterable, Iterator
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel
from numpy.typing import NDArray

from asrsim.log.cdr import MessageColumn
from asrsim.log.commands import COMMAND_TOPICS, decoded
from asrsim.log.container import COLUMNS_KEY
from asrsim.log.rows import MESSAGE_HEADER
from asrsim.log.structure import split_records, stream
from asrsim.samples import Array, Command, WrenchCommand

_TIME = MessageColumn("time")


class ColumnReader:
    """Reader of columns, which collects the channels of the chunks it has read."""

    def __init__(self, channels: Iterable[Channel] = ()) -> None:
        self._columns: dict[int, list[tuple[int, MessageColumn]]] = {}
        self._commands: dict[int, str] = {}
        """Topics of commands, by number of the channel."""
        for channel in channels:
            self._register(channel)

    def read(self, data: bytes, wanted: Collection[str], joints: Collection[str]) -> dict[MessageColumn, Array]:
        """Columns in an uncompressed chunk, as views (rows,): time, bodies, contacts, and the wanted values.

        Args:
            data: The chunk.
            wanted: Quantities to read.
            joints: Joints to read.

        Returns:
            Views by column; empty if the chunk contains no samples.

        Raises:
            ValueError: The chunk does not have asrsim's layout.
        """
        row_start, row = self._first_row(data)
        if not row:
            return {}
        size = sum(length + 9 for _, length, _ in row)
        count, rest = divmod(len(data) - row_start, size)
        if rest:
            raise ValueError("a chunk contains an incomplete row; did another program rewrite the file?")

        def view(offset: int, kind: str) -> NDArray[Any]:
            return np.ndarray((count,), kind, data, row_start + offset, (size,))

        found: dict[MessageColumn, Array] = {}
        for offset, length, channel in row:
            columns = [
                (place, column)
                for place, column in self._columns.get(channel, ())
                if column.kind != "value" or (column.name in wanted and column.part in joints)
            ]
            if not columns:
                continue
            same = (view(offset, "u1") == Opcode.MESSAGE) & (view(offset + 1, "<u8") == length)
            if not np.all(same & (view(offset + 9, "<u2") == channel)):
                raise ValueError("the rows of a chunk have different layouts; did another program rewrite the file?")
            for place, column in columns:
                if not 0 <= place <= length - (MESSAGE_HEADER.size - 9) - 8:
                    raise ValueError("a message is shorter than its channel states")
                found[column] = view(offset + MESSAGE_HEADER.size + place, "<f8")
        return found

    def _first_row(self, data: bytes) -> tuple[int, list[tuple[int, int, int]]]:
        """Offset of the first row, and a tuple (offset in the row, length, channel) for each of its messages."""
        start = 0
        row: list[tuple[int, int, int]] = []
        for opcode, place, length in split_records(data):
            if opcode == Opcode.CHANNEL:
                self._register(Channel.read(stream(data[place : place + length])))
            if opcode != Opcode.MESSAGE:
                continue
            (channel,) = struct.unpack_from("<H", data, place)
            if not row:
                if _TIME not in (column for _, column in self._columns.get(channel, ())):
                    continue
                start = place - 9
            elif channel == row[0][2]:
                break
            row.append((place - 9 - start, length, channel))
        return start, row

    def commands(self, data: bytes) -> Iterator[Command | WrenchCommand]:
        """Commands from outside the simulation in an uncompressed chunk; they precede the chunk's rows."""
        for opcode, place, length in split_records(data):
            if opcode == Opcode.CHANNEL:
                self._register(Channel.read(stream(data[place : place + length])))
            elif opcode == Opcode.MESSAGE:
                (channel,) = struct.unpack_from("<H", data, place)
                if channel in self._columns:
                    return
                if channel in self._commands:
                    yield decoded(self._commands[channel], data[place - 9 + MESSAGE_HEADER.size : place + length])

    def _register(self, channel: Channel) -> None:
        if channel.topic in COMMAND_TOPICS:
            self._commands[channel.id] = channel.topic
        text = channel.metadata.get(COLUMNS_KEY)
        if text is None:
            return
        try:
            columns = [
                (int(offset), MessageColumn(str(kind), str(name), part)) for offset, kind, name, part in json.loads(text)
            ]
        except TypeError as error:
            raise ValueError(f"channel {channel.topic} has no valid list of columns") from error
        self._columns[channel.id] = columns
