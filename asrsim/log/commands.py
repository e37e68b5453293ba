"""Commands that a live run received from outside, written to the log and read back. Their messages are not part of the rows."""

from __future__ import annotations

import math
import struct
from functools import lru_cache

from asrsim.log.cdr import CdrBuilder, CdrTemplate, MessageColumn
from asrsim.log.topics import Topic
from asrsim.samples import Command, HeldWrench, WrenchCommand

COMMAND_TOPIC, WRENCH_TOPIC = "/asrsim/commands", "/asrsim/wrenches"
"""Topics of references, and of forces and torques on bodies."""
COMMAND_TOPICS = COMMAND_TOPIC, WRENCH_TOPIC


@lru_cache(maxsize=1024)
def _template(texts: tuple[str, ...], count: int) -> CdrTemplate:
    """A message with a header, texts, a substep and `count` numbers."""
    builder = CdrBuilder().header()
    for text in texts:
        builder.string(text)
    # The number of the substep (uint64) takes a place of a float64, since it has as many bytes.
    return builder.numbers([MessageColumn("command")] * (count + 1)).build()


def topic_of(command: Command | WrenchCommand) -> Topic:
    """Topic of a command in a log."""
    if isinstance(command, Command):
        name, message, template = COMMAND_TOPIC, "asrsim_msgs/Command", _template(("", ""), 1)
    else:
        name, message, template = WRENCH_TOPIC, "asrsim_msgs/Wrench", _template(("",), 9)
    return Topic(name=name, message=message, template=template, canonical=False)


def encoded(command: Command | WrenchCommand, time: float) -> bytes:
    """Message of a command that took effect at `time` in s. The value NaN of a reference means that the scenario's value
    applies again."""
    texts: tuple[str, ...]
    if isinstance(command, Command):
        texts, values = (command.joint, command.reference), [math.nan if command.value is None else command.value]
    else:
        wrench = command.wrench
        texts, values = (wrench.body,), [*wrench.point, *wrench.force, *wrench.torque]
    template = _template(texts, len(values))
    data = bytearray(template.data)
    nanoseconds = round(time * 1e9)
    struct.pack_into("<iI", data, template.stamps[0], *divmod(nanoseconds, 1_000_000_000))
    struct.pack_into(f"<Q{len(values)}d", data, template.floats[0][0], command.substep, *values)
    return bytes(data)


def decoded(topic: str, data: bytes) -> Command | WrenchCommand:
    """Command in a message of a topic. Raises ValueError or struct.error if the message is not a command."""
    count = 2 if topic == COMMAND_TOPIC else 1
    place = 4 + 8
    texts = []
    for _ in range(1 + count):  # the frame, followed by joint and reference, or by the body
        place += -(place - 4) % 4
        (length,) = struct.unpack_from("<I", data, place)
        end = place + 4 + length
        if length < 1 or end > len(data):
            raise ValueError("the text of a command is longer than its message")
        texts.append(data[place + 4 : end - 1].decode())
        place = end
    place += -(place - 4) % 8
    if topic == COMMAND_TOPIC:
        substep, value = struct.unpack_from("<Qd", data, place)
        return Command(substep, texts[1], texts[2], None if math.isnan(value) else value)
    substep, *values = struct.unpack_from("<Q9d", data, place)
    point, force, torque = (tuple(values[k : k + 3]) for k in (0, 3, 6))
    return WrenchCommand(substep, HeldWrench(texts[1], force, torque, point))
