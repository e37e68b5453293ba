"""A file that is a valid MCAP at every instant, whenever its process is killed.

Behind the last whole chunk there always stands a closing trailer. An append writes the new trailer at its final
place first, then the body up to where the old trailer ends, and last, with one small write, the body's first bytes
over the old trailer: until then a reader stops at the old one, from then on at the new one.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer, Header, McapRecord

from asrsim.errors import OutputError
from asrsim.outfile import check_output, is_special

MAGIC = b"\x89MCAP0\r\n"


_FLAGS = sum(getattr(os, name, 0) for name in ("O_CLOEXEC", "O_BINARY"))


def encode(record: McapRecord) -> bytes:
    """The bytes of a record."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


DATA_END = encode(DataEnd(data_section_crc=0))
_OPEN_END = encode(Footer(summary_start=0, summary_offset_start=0, summary_crc=0)) + MAGIC
"""Ends a file without index: readers then go through it from the start."""
_TRAILER = DATA_END + _OPEN_END


class McapStorage:
    """The bytes of an MCAP file, appended to in whole records. Raises OutputError if the file cannot be written."""

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
        """Bytes up to the trailer: where the next record goes."""

    def append(self, body: bytes) -> None:
        """Adds whole records to the data section. After an OutputError the file is what it was before."""
        self._commit(body, _TRAILER)

    def finish(self, body: bytes, footer: Footer) -> None:
        """Adds the last records, from before DataEnd to the end of the summary, and closes the file."""
        self._commit(body, _OPEN_END)
        try:
            self._write(encode(footer), self.size)
        except OSError as error:
            raise self._error(error) from error
        finally:
            self.close()

    def close(self) -> None:
        """Closes the file as it is."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _commit(self, body: bytes, trailer: bytes) -> None:
        switch = len(_TRAILER)
        try:
            if len(body) <= switch:
                self._write(body + trailer, self.size)
            else:
                view = memoryview(body)
                self._write(trailer, self.size + len(body))
                self._write(view[switch:], self.size + switch)
                self._write(view[:switch], self.size)
        except OSError as error:
            with suppress(OSError):
                self._write(_TRAILER, self.size)
                os.ftruncate(self._file, self.size + switch)
            raise self._error(error) from error
        self.size += len(body)

    def _write(self, data: bytes | memoryview, position: int) -> None:
        rest = memoryview(data)
        while rest:
            # Not os.pwrite, which Windows does not have.
            os.lseek(self._file, position, os.SEEK_SET)
            written = os.write(self._file, rest)
            rest = rest[written:]
            position += written

    def _error(self, error: OSError) -> OutputError:
        return OutputError(f"{self.path}: cannot write the log: {error.strerror or error}")
