"""Writes MCAP files: schemas, channels, chunks with their indexes, attachments, metadata, and the final summary."""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from asrsim import __version__
from asrsim.errors import OutputError
from asrsim.log.rows import MESSAGE_HEADER, RowBuffer
from asrsim.log.topics import Topic, message_definition, schema_name
from asrsim.outfile import check_output, is_special

MAGIC = b"\x89MCAP0\r\n"


_FLAGS = sum(getattr(os, name, 0) for name in ("O_CLOEXEC", "O_BINARY"))


def encode(record: McapRecord) -> bytes:
    """Bytes of a record."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


DATA_END = encode(DataEnd(data_section_crc=0))
_OPEN_END = encode(Footer(summary_start=0, summary_offset_start=0, summary_crc=0)) + MAGIC
"""Last bytes of a file without an index; readers read such a file from its start."""
_TRAILER = DATA_END + _OPEN_END


class McapStorage:
    """MCAP file to which complete records are appended. Raises OutputError if the file cannot be written."""

    def __init__(self, path: Path, header: Header, body: bytes) -> None:
        self.path = path
        head = MAGIC + encode(header) + body
        self._file = -1
        new = not path.exists()
        check_output(path, "log")
        try:
            flags = _FLAGS | (0 if is_special(path) else getattr(os, "O_NOFOLLOW", 0))
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | flags, 0o666)
            self._write(head + _TRAILER, 0)
        except OSError as error:
            self.close()
            if new:
                with suppress(OSError):
                    path.unlink()
            raise self._error(error) from error
        self.size = len(head)
        """Offset of the trailer, where the next record is written, bytes."""

    def append(self, head: bytes, *rest: bytes | memoryview) -> None:
        """Append complete records, given in parts, to the data section. An OutputError leaves the file unchanged."""
        self._commit(_TRAILER, head, *rest)

    def finish(self, body: bytes, footer: Footer) -> None:
        """Append the last records, from DataEnd to the end of the summary, and close the file."""
        self._commit(_OPEN_END, body)
        try:
            self._write(encode(footer), self.size)
        except OSError as error:
            raise self._error(error) from error
        finally:
            self.close()

    def close(self) -> None:
        """Close the file without a summary."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _commit(self, trailer: bytes, head: bytes, *rest: bytes | memoryview) -> None:
        """Write records (`head` and `rest`), and after them a trailer, so that a kill at any instant leaves a readable file.
        The trailer is written first and `head` last. Until `head` is written, the old trailer stands in its place.
        """
        end = self.size + sum(map(len, (head, *rest)))
        try:
            if len(head) < len(_TRAILER):
                self._write(b"".join((head, *rest, trailer)), self.size)
            else:
                self._write(trailer, end)
                position = self.size + len(head)
                for part in rest:
                    self._write(part, position)
                    position += len(part)
                self._write(head, self.size)
        except OSError as error:
            with suppress(OSError):
                self._write(_TRAILER, self.size)
                os.ftruncate(self._file, self.size + len(_TRAILER))
            raise self._error(error) from error
        self.size = end

    def _write(self, data: bytes | memoryview, position: int) -> None:
        rest = memoryview(data)
        while rest:
            # Do not use os.pwrite, which does not exist on Windows.
            os.lseek(self._file, position, os.SEEK_SET)
            written = os.write(self._file, rest)
            rest = rest[written:]
            position += written

    def _error(self, error: OSError) -> OutputError:
        return OutputError(f"{self.path}: cannot write the log: {error.strerror or error}")


COLUMNS_KEY = "asrsim_columns"
"""Key in a channel's metadata: JSON list of [offset in the message's data, kind, name, part] for each number to read back."""

_SUMMARY = (
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.STATISTICS,
    Opcode.CHUNK_INDEX,
    Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX,
)
"""Kinds of records in the summary, in order."""

Aside = tuple[int, int, bytes]
"""Message outside of the rows: channel, time in ns, data."""

_COMPRESSION = b"zstd"
_CHUNK_HEAD = struct.Struct(f"<BQQQQII{len(_COMPRESSION)}sQ")
"""First fields of a chunk record: opcode and length; first and last log time, ns; size and checksum of the messages; name of
the compression, with its length; length of the compressed messages. `Chunk` of the mcap package copies the messages twice."""
_ZSTD_LEVEL = -1
"""Compression level. Level 1 takes 1.2 times as long for logs that are 1 to 3 % smaller; level 3 takes twice as long, and the
logs are not smaller."""


class McapContainer:
    """Writer of an MCAP file with profile ros2. Memory grows only by one packed index (some hundred bytes) for each chunk."""

    def __init__(
        self,
        path: Path,
        *,
        attachments: Mapping[str, tuple[str, bytes]],
        metadata: Mapping[str, Mapping[str, str]],
    ) -> None:
        """Open the file. attachments: name -> (media type, data); metadata: name -> record."""
        import zstandard

        self._compress = zstandard.ZstdCompressor(level=_ZSTD_LEVEL).compress
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}
        self._pending = b""
        self._counts: dict[int, int] = {}
        self._span: tuple[int, int] | None = None
        # Use a few growing buffers, since many small objects would fragment the memory that the run's arrays reuse.
        self._summary = {opcode: bytearray() for opcode in _SUMMARY}
        self._records: Counter[Opcode] = Counter()
        header = Header(profile="ros2", library=f"asrsim {__version__}")
        start, body = len(MAGIC) + len(encode(header)), b""
        for name, (media_type, data) in attachments.items():
            record = encode(Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data))
            index = AttachmentIndex(
                offset=start + len(body),
                length=len(record),
                log_time=0,
                create_time=0,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
            self._summarise(Opcode.ATTACHMENT_INDEX, encode(index))
            body += record
        for name, items in metadata.items():
            body += self._metadata(name, items, start + len(body))
        self._storage = McapStorage(path, header, body)

    def channel(self, topic: Topic) -> int:
        """Id of a topic's channel. The first call registers the channel, which is written with the next chunk."""
        columns = [[offset, *column] for offset, column in topic.template.floats] if topic.canonical else []
        metadata = {"offered_qos_profiles": ""}
        if columns:
            metadata[COLUMNS_KEY] = json.dumps(columns, separators=(",", ":"))
        key = (topic.name, metadata.get(COLUMNS_KEY, ""))
        if key not in self._channels:
            self._channels[key] = number = len(self._channels) + 1
            self._counts[number] = 0
            schema = self._schema(topic.message)
            channel = Channel(id=number, topic=topic.name, message_encoding="cdr", metadata=metadata, schema_id=schema)
            self._pending += self._summarise(Opcode.CHANNEL, encode(channel))
        return self._channels[key]

    def chunk(self, rows: RowBuffer, asides: Sequence[Aside] = ()) -> None:
        """Write a chunk: new channels, then messages outside of the rows, then the rows."""
        start, end = rows.span()
        if asides:
            times = [time for _, time, _ in asides]
            start, end = (min(start, *times), max(end, *times)) if rows.count else (min(times), max(times))
        index = b""
        index_offsets: list[tuple[int, int]] = []
        places: dict[int, list[tuple[int, int]]] = {}
        prefix = self._pending
        for channel, time, data in asides:
            places.setdefault(channel, []).append((time, len(prefix)))
            length = MESSAGE_HEADER.size - 9 + len(data)
            prefix += MESSAGE_HEADER.pack(Opcode.MESSAGE, length, channel, self._counts[channel], time, time) + data
            self._counts[channel] += 1
        for channel, entries in places.items():
            index_offsets.append((channel, len(index)))
            index += encode(MessageIndex(channel_id=channel, records=entries))
        indexes: tuple[memoryview, ...] = ()
        if rows.count:
            records, size = rows.message_indexes(len(prefix))
            index_offsets += [(channel, len(index) + size * i) for i, channel in enumerate(rows.channels)]
            indexes = (records,)
        content = rows.messages(prefix)
        packed = self._compress(content)
        head = _CHUNK_HEAD.pack(
            Opcode.CHUNK,
            _CHUNK_HEAD.size - 9 + len(packed),
            start,
            end,
            len(content),
            zlib.crc32(content),
            len(_COMPRESSION),
            _COMPRESSION,
            len(packed),
        )
        offset, length = self._storage.size, len(head) + len(packed)
        self._storage.append(head, packed, index, *indexes)
        after = offset + length
        index_record = ChunkIndex(
            chunk_length=length,
            chunk_start_offset=offset,
            compression=_COMPRESSION.decode(),
            compressed_size=len(packed),
            message_start_time=start,
            message_end_time=end,
            message_index_length=len(index) + sum(map(len, indexes)),
            message_index_offsets={channel: after + place for channel, place in index_offsets},
            uncompressed_size=len(content),
        )
        self._summarise(Opcode.CHUNK_INDEX, encode(index_record))
        self._pending = b""
        for channel in rows.channels:
            self._counts[channel] += rows.count
        first, last = self._span or (start, end)
        self._span = (min(first, start), max(last, end))

    def finish(self, name: str, metadata: Mapping[str, str]) -> None:
        """Write a last metadata record and the summary, and close the file."""
        body = self._metadata(name, metadata, self._storage.size) + DATA_END
        start = self._storage.size + len(body)
        first, last = self._span or (0, 0)
        statistics = Statistics(
            attachment_count=self._records[Opcode.ATTACHMENT_INDEX],
            channel_count=self._records[Opcode.CHANNEL],
            channel_message_counts=self._counts,
            chunk_count=self._records[Opcode.CHUNK_INDEX],
            message_count=sum(self._counts.values()),
            message_end_time=last,
            message_start_time=first,
            metadata_count=self._records[Opcode.METADATA_INDEX],
            schema_count=self._records[Opcode.SCHEMA],
        )
        self._summarise(Opcode.STATISTICS, encode(statistics))
        summary = b"".join(self._summary.values())
        checked = summary + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0)
        footer = Footer(summary_start=start, summary_offset_start=0, summary_crc=zlib.crc32(checked))
        self._storage.finish(body + summary, footer)

    def close(self) -> None:
        """Close the file without a summary. The file remains readable from the start."""
        self._storage.close()

    def _summarise(self, opcode: Opcode, record: bytes) -> bytes:
        """Add a record to the final summary. Returns the record."""
        self._summary[opcode] += record
        self._records[opcode] += 1
        return record

    def _schema(self, message: str) -> int:
        if message not in self._schemas:
            self._schemas[message] = number = len(self._schemas) + 1
            schema = Schema(id=number, data=message_definition(message).encode(), encoding="ros2msg", name=schema_name(message))
            self._pending += self._summarise(Opcode.SCHEMA, encode(schema))
        return self._schemas[message]

    def _metadata(self, name: str, items: Mapping[str, str], offset: int) -> bytes:
        record = encode(Metadata(name=name, metadata=dict(items)))
        self._summarise(Opcode.METADATA_INDEX, encode(MetadataIndex(offset=offset, length=len(record), name=name)))
        return record
