"""Commands from outside in a live run, written to the log and read back. Their messages are not part of the rows."""

from __future__ import annotations

import math
import struct
from functools import lru_cache

from asrsim.log.cdr import CdrBuilder, CdrTemplate, MessageColumn
from asrsim.log.topics import Topic
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
