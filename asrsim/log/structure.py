"""Finds the records of an MCAP file one after another, and reads its chunks. A killed run leaves a file without a summary."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata

from asrsim.document.file import mistaken
from asrsim.errors import LogError, Problem
from asrsim.log.container import MAGIC

_WANTED = "Name a log (log.mcap), or the folder of a run: out/SCENARIO/VARIANT"
_FOOTER_SIZE = 29
"""Size of the footer record, bytes (MCAP specification, record 0x02)."""
CHUNK_TIMES = struct.Struct("<QQ")
"""First fields of a chunk record: first and last log time, ns."""
_CHUNK_INDEX = struct.Struct("<QQQQI")
"""First fields of a chunk index: first and last log time, offset and length of the chunk's record, size of the next field."""
_LARGEST_CHUNK = 1 << 30
"""Largest accepted size of a chunk, bytes; in a damaged file, the stated size may have any value."""


@dataclass(frozen=True, kw_only=True)
class ChunkPlace:
    """Position and times of a chunk record in the file."""

    offset: int
    """Offset of the record's content in the file, bytes."""
    length: int
    start: int
    """First log time, ns."""
    end: int


@dataclass(kw_only=True)
class Structure:
    """Content of a log except its messages."""

    path: Path
    chunks: list[ChunkPlace] = field(default_factory=list)
    summary: bytes = b""
    """Records of the summary; empty if the file is truncated."""
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    truncated: bool = False
    """Whether the file has no summary, since its writer was killed or is still running, or since the file was cut."""

    @cached_property
    def channels(self) -> list[Channel]:
        """Channels listed in the summary."""
        return [Channel.read(stream(content)) for content in _summarised(self.summary, Opcode.CHANNEL)]


def corrupt(path: Path, what: str) -> LogError:
    """Error for a damaged log."""
    return LogError(f"the log is damaged: {what}", file=path, code="corrupt-log")


def read_structure(path: Path) -> Structure:
    """Structure of an MCAP file. Raises LogError if the file cannot be read, is damaged, or is not MCAP."""
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            if size == 0:
                raise LogError("the file is empty", file=path, code="empty-log")
            if file.read(len(MAGIC)) != MAGIC:
                other = mistaken(path, "log")
                raise LogError([other or Problem("this is not an MCAP file", file=path, code="not-mcap", hint=_WANTED)])
            structure = Structure(path=path)
            try:
                _scan(file, structure, *_summary(file, size))
            except (ValueError, OverflowError, struct.error, McapError, EOFError) as error:
                raise corrupt(path, str(error) or type(error).__name__) from error
    except OSError as error:
        raise LogError(f"cannot read the log: {error.strerror or error}", file=path, code="unreadable-log") from error
    return structure


def split_records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Each record in `data` as (opcode, offset of the content, length). Raises ValueError where a record exceeds the data."""
    position = 0
    while position < len(data):
        opcode, length = struct.unpack_from("<BQ", data, position)
        position += 9
        if length > len(data) - position:
            raise ValueError(f"a record of {length} bytes exceeds the data around it")
        yield opcode, position, length
        position += length


def stream(data: bytes) -> ReadDataStream:
    """Stream of the data, as the record classes of the mcap package need it."""
    return ReadDataStream(BytesIO(data))


def _summary(file: BinaryIO, size: int) -> tuple[int, bytes]:
    """Offset and bytes of the summary; the size of the file and no bytes where a killed run left no summary."""
    end = size - _FOOTER_SIZE - len(MAGIC)
    if end < len(MAGIC):
        return size, b""
    file.seek(end)
    tail = file.read(_FOOTER_SIZE + len(MAGIC))
    opcode, length, start, _, crc = struct.unpack_from("<BQQQI", tail)
    if tail[_FOOTER_SIZE:] != MAGIC or (opcode, length) != (Opcode.FOOTER, _FOOTER_SIZE - 9) or not start:
        return size, b""
    if not len(MAGIC) <= start <= end:
        raise ValueError("the summary lies outside the file")
    file.seek(start)
    summary = file.read(end - start)
    if crc and zlib.crc32(summary + tail[: _FOOTER_SIZE - 4]) != crc:
        raise ValueError("the summary does not match its checksum")
    return start, summary


def _scan(file: BinaryIO, structure: Structure, end: int, summary: bytes) -> None:
    """Find the records before `end`, or up to the last complete record where the file has no summary.

    Chunks that the summary lists are not read, since a file contains many chunks, each with a message index for each channel.
    """
    structure.truncated = not summary
    structure.summary = summary
    listed = _listed_chunks(summary)
    position = len(MAGIC)
    while position + 9 <= end:
        if position in listed:
            chunk, position = listed[position]
            structure.chunks.append(chunk)
            continue
        file.seek(position)
        opcode, length = struct.unpack("<BQ", file.read(9))
        if opcode in (0, Opcode.FOOTER) or length > end - position - 9:
            break
        position += 9
        if opcode == Opcode.CHUNK and length >= CHUNK_TIMES.size:
            first, last = CHUNK_TIMES.unpack(file.read(CHUNK_TIMES.size))
            structure.chunks.append(ChunkPlace(offset=position, length=length, start=first, end=last))
        elif opcode in (Opcode.ATTACHMENT, Opcode.METADATA):
            _keep(opcode, file.read(length), structure)
        position += length
    if summary and position != end:
        raise ValueError("a record has a wrong length")
    latest = 0
    for chunk in structure.chunks:
        if not latest <= chunk.start <= chunk.end:
            raise ValueError(f"its times decrease: a chunk lasts from {chunk.start * 1e-9:g} to {chunk.end * 1e-9:g} s")
        latest = chunk.start


def _listed_chunks(summary: bytes) -> dict[int, tuple[ChunkPlace, int]]:
    """The chunks in the summary, by the offset of the chunk record. Each chunk has a second number: the end of the message
    indexes that follow the chunk.
    """
    found = {}
    for content in _summarised(summary, Opcode.CHUNK_INDEX):
        first, last, offset, size, map_size = _CHUNK_INDEX.unpack_from(content)
        (indexes_size,) = struct.unpack_from("<Q", content, _CHUNK_INDEX.size + map_size)
        if size < 9 + CHUNK_TIMES.size:
            raise ValueError("the summary lists a chunk that is too short")
        chunk = ChunkPlace(offset=offset + 9, length=size - 9, start=first, end=last)
        found[offset] = chunk, offset + size + indexes_size
    return found


def _summarised(summary: bytes, wanted: int) -> Iterator[bytes]:
    """Contents of the summary's records of one kind."""
    for opcode, place, length in split_records(summary):
        if opcode == wanted:
            yield summary[place : place + length]


def _keep(opcode: int, content: bytes, structure: Structure) -> None:
    if opcode == Opcode.ATTACHMENT:
        crc = int.from_bytes(content[-4:], "little")
        if crc and zlib.crc32(content[:-4]) != crc:
            raise ValueError("an attachment does not match its checksum")
        attachment = Attachment.read(stream(content))
        structure.attachments[attachment.name] = attachment.data
    elif opcode == Opcode.METADATA:
        metadata = Metadata.read(stream(content))
        structure.metadata[metadata.name] = metadata.metadata


def read_chunk(file: BinaryIO, place: ChunkPlace) -> bytes:
    """Decompressed and checked messages of a chunk. Raises ValueError or an error of mcap if the chunk is damaged."""
    import zstandard

    file.seek(place.offset)
    chunk = Chunk.read(stream(file.read(place.length)))
    size, packed = chunk.uncompressed_size, chunk.data
    # Check the size, since a damaged or manipulated file may state any size.
    try:
        if size > _LARGEST_CHUNK or zstandard.frame_content_size(packed) not in (-1, size):
            raise ValueError("a chunk differs from its stated length")
        data = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    except zstandard.ZstdError as error:
        raise ValueError(f"a chunk cannot be decompressed: {error}") from error
    if len(data) != size or (chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc):
        raise ValueError("a chunk does not match its checksum")
    return data
