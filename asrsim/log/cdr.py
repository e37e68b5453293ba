"""Templates of ROS 2 messages in CDR encoding: constant bytes, and the offsets of the numbers in them.

All messages of a topic have equal length, because names and counts do not change in a run. A message is laid out once, and
NumPy fills in the numbers of thousands of messages at a time.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

ENCAPSULATION = b"\x00\x01\x00\x00"
"""First bytes of a message: little-endian CDR."""
_NAN = struct.pack("<d", math.nan)


class MessageColumn(NamedTuple):
    """Source of a number in a message: a scalar signal of `asrsim.samples.Samples`."""

    kind: str
    """Kind of the signal: `time`, `value`, `body` or `contact`."""
    name: str = ""
    """Name of the quantity, body or contact; empty for the time."""
    part: str | int = ""
    """Joint of a value, component of a body's pose (0..6), or component of a contact force (0..2)."""


@dataclass(frozen=True, kw_only=True)
class CdrTemplate:
    """Bytes of a message in which the variable numbers are not filled in yet."""

    data: bytes
    """Encapsulation header (little endian) and payload, with NaN in place of the numbers."""
    floats: tuple[tuple[int, MessageColumn], ...]
    """Offset in `data` and source of each variable float64."""
    stamps: tuple[int, ...]
    """Offsets in `data` of the time stamps (int32 s, uint32 ns)."""


class CdrBuilder:
    """Lays out a message field by field, in the order of its definition."""

    def __init__(self) -> None:
        self._data = bytearray(ENCAPSULATION)
        self._floats: list[tuple[int, MessageColumn]] = []
        self._stamps: list[int] = []

    def header(self, frame: str = "") -> CdrBuilder:
        """Add a std_msgs/Header."""
        return self.stamp().string(frame)

    def stamp(self) -> CdrBuilder:
        """Add a builtin_interfaces/Time."""
        self._align(4)
        self._stamps.append(len(self._data))
        self._data += bytes(8)
        return self

    def uint32(self, value: int) -> CdrBuilder:
        """Add a constant number, such as the length of a sequence."""
        self._align(4)
        self._data += struct.pack("<I", value)
        return self

    def string(self, text: str) -> CdrBuilder:
        """Add a string with its length and a final zero."""
        encoded = text.encode()
        self.uint32(len(encoded) + 1)
        self._data += encoded + b"\x00"
        return self

    def strings(self, texts: Sequence[str]) -> CdrBuilder:
        """Add a sequence of strings."""
        self.uint32(len(texts))
        for text in texts:
            self.string(text)
        return self

    def float64(self, column: MessageColumn | None) -> CdrBuilder:
        """Add a variable number; without a source it remains NaN."""
        return self.numbers([column])

    def numbers(self, columns: Iterable[MessageColumn | None]) -> CdrBuilder:
        """Add variable numbers one after another."""
        for number, column in enumerate(columns):
            if not number:
                self._align(8)
            if column is not None:
                self._floats.append((len(self._data), column))
            self._data += _NAN
        return self

    def float64s(self, columns: Sequence[MessageColumn | None]) -> CdrBuilder:
        """Add a sequence of variable numbers with its length."""
        return self.uint32(len(columns)).numbers(columns)

    def build(self) -> CdrTemplate:
        """Template of the finished message."""
        return CdrTemplate(data=bytes(self._data), floats=tuple(self._floats), stamps=tuple(self._stamps))

    def _align(self, size: int) -> None:
        """Add zeros up to a multiple of `size` bytes, counted from the end of the encapsulation header."""
        self._data += bytes(-(len(self._data) - 4) % size)
