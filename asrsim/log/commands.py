"""Commands from outside in a live run, written to the log and read back. Their messages are not part of the rows."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from functools import lru_cache

from mcap.opcode import Opcode
from mcap.records import Channel

from asrsim.log.cdr import CdrBuilder, CdrTemplate, MessageColumn
from asrsim.log.rows import MESSAGE_HEADER
from asrsim.log.structure import split_records, stream
from asrsim.log.topics import TIME_TOPIC, Topic
from asrsim.samples import Command

COMMAND_TOPIC = "/asrsim/commands"


@lru_cache(maxsize=1024)
def _template(joint: str, reference: str) -> CdrTemplate:
    builder = CdrBuilder().header().string(joint).string(reference)
    # A substep (uint64) has as many bytes as a float64.
    return builder.float64(MessageColumn("command", "substep")).float64(MessageColumn("command", "value")).build()


def command_topic() -> Topic:
    """Topic of the commands in a log."""
    return Topic(name=COMMAND_TOPIC, message="asrsim_msgs/Command", template=_template("", ""), canonical=False)


def encoded(command: Command, time: float) -> bytes:
    """Message of a command that took effect at `time` in s; NaN means that the scenario's value applies again."""
    template = _template(command.joint, command.reference)
    data = bytearray(template.data)
    nanoseconds = round(time * 1e9)
    struct.pack_into("<iI", data, template.stamps[0], *divmod(nanoseconds, 1_000_000_000))
    (substep, _), (value, _) = template.floats
    struct.pack_into("<Q", data, substep, command.substep)
    struct.pack_into("<d", data, value, math.nan if command.value is None else command.value)
    return bytes(data)


def decoded(data: bytes) -> Command:
    """Command in a message. Raises ValueError or struct.error if the message is no command."""
    place = 4 + 8
    texts = []
    for _ in range(3):  # frame, joint, reference
        place += -(place - 4) % 4
        (length,) = struct.unpack_from("<I", data, place)
        end = place + 4 + length
        if length < 1 or end > len(data):
            raise ValueError("the text of a command is longer than its message")
        texts.append(data[place + 4 : end - 1].decode())
        place = end
    place += -(place - 4) % 8
    substep, value = struct.unpack_from("<Qd", data, place)
    return Command(substep, texts[1], texts[2], None if math.isnan(value) else value)


class CommandReader:
    """Reader of the commands in chunks, which must be read in order."""

    def __init__(self) -> None:
        self._commands: set[int] = set()
        self._rows: set[int] = set()

    def read(self, chunk: bytes) -> Iterator[Command]:
        """Commands in an uncompressed chunk; they precede its rows."""
        for opcode, place, length in split_records(chunk):
            if opcode == Opcode.CHANNEL:
                channel = Channel.read(stream(chunk[place : place + length]))
                known = {COMMAND_TOPIC: self._commands, TIME_TOPIC: self._rows}.get(channel.topic)
                if known is not None:
                    known.add(channel.id)
            elif opcode == Opcode.MESSAGE:
                (number,) = struct.unpack_from("<H", chunk, place)
                if number in self._rows:
                    return
                if number in self._commands:
                    yield decoded(chunk[place - 9 + MESSAGE_HEADER.size : place + length])
