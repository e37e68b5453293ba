"""Finds the records of an MCAP file by its index, or record by record where a killed run left no index."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex, Channel, Metadata, MetadataIndex

from asrsim.document.file import mistaken
from asrsim.errors import LogError, Problem
from asrsim.log.container import MAGIC

_WANTED = "Name a log (log.mcap), or the folder of a run: out/SCENARIO/VARIANT"
_FOOTER_SIZE = 29
"""Size of the footer record, bytes (MCAP specification, record 0x02)."""
CHUNK_HEAD = struct.Struct("<QQQI")
"""First fields of a chunk record: start time, end time, uncompressed size and CRC."""


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
    channels: list[Channel] = field(default_factory=list)
    """Channels listed in the index; empty if the file is truncated."""
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    truncated: bool = False
    """True: the file has no index; its writer was killed or is still running, or the file was cut."""


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
                if not _read_index(file, size, structure):
                    structure.truncated = True
                    _scan(file, size, structure)
            except (struct.error, ValueError, McapError, EOFError) as error:
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


def _read_index(file: BinaryIO, size: int, structure: Structure) -> bool:
    """Read the summary into `structure`. Returns False if the file has no summary."""
    end = size - _FOOTER_SIZE - len(MAGIC)
    if end < len(MAGIC):
        return False
    file.seek(end)
    tail = file.read(_FOOTER_SIZE + len(MAGIC))
    opcode, length, start, _, crc = struct.unpack_from("<BQQQI", tail)
    if tail[_FOOTER_SIZE:] != MAGIC or (opcode, length) != (Opcode.FOOTER, _FOOTER_SIZE - 9) or not start:
        return False
    if not len(MAGIC) <= start <= end:
        raise ValueError("the index lies outside the file")
    file.seek(start)
    summary = file.read(end - start)
    if crc and zlib.crc32(summary + tail[: _FOOTER_SIZE - 4]) != crc:
        raise ValueError("the index does not match its checksum")
    indexed: list[tuple[int, int]] = []
    for opcode, place, length in split_records(summary):
        content = summary[place : place + length]
        if opcode == Opcode.CHANNEL:
            structure.channels.append(Channel.read(stream(content)))
        elif opcode == Opcode.CHUNK_INDEX:
            first, last, offset, chunk_length = struct.unpack_from("<QQQQ", content)
            if not len(MAGIC) <= offset <= offset + chunk_length <= start:
                raise ValueError("a chunk lies outside the file")
            structure.chunks.append(ChunkPlace(offset=offset + 9, length=chunk_length - 9, start=first, end=last))
        elif opcode in (Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX):
            kind = AttachmentIndex if opcode == Opcode.ATTACHMENT_INDEX else MetadataIndex
            index = kind.read(stream(content))
            indexed.append((index.offset, index.length))
    for offset, length in indexed:
        if not len(MAGIC) <= offset <= offset + length <= start:
            raise ValueError("an attachment lies outside the file")
        file.seek(offset)
        record = file.read(length)
        for opcode, place, inner in split_records(record):
            _keep(opcode, record[place : place + inner], structure)
    structure.chunks.sort(key=lambda chunk: chunk.offset)
    return True


def _scan(file: BinaryIO, size: int, structure: Structure) -> None:
    """Read records one after another, up to the end of the data or the last complete record."""
    position = len(MAGIC)
    while position + 9 <= size:
        file.seek(position)
        opcode, length = struct.unpack("<BQ", file.read(9))
        position += 9
        if opcode in (0, Opcode.DATA_END, Opcode.FOOTER) or length > size - position:
            return
        if opcode == Opcode.CHUNK and length >= CHUNK_HEAD.size:
            start, end, _, _ = CHUNK_HEAD.unpack(file.read(CHUNK_HEAD.size))
            structure.chunks.append(ChunkPlace(offset=position, length=length, start=start, end=end))
        elif opcode in (Opcode.ATTACHMENT, Opcode.METADATA):
            _keep(opcode, file.read(length), structure)
        position += length


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
