"""Reads, checks and decompresses the chunks of an MCAP file."""

from __future__ import annotations

import struct
import zlib
from typing import BinaryIO

from asrsim.log.structure import CHUNK_HEAD, ChunkPlace

_LARGEST_CHUNK = 1 << 30
"""Largest accepted size of a chunk, bytes; in a damaged file, the stated size may have any value."""


def read_chunk(file: BinaryIO, place: ChunkPlace) -> bytes:
    """Decompressed and checked messages of a chunk. Raises ValueError if the chunk is damaged."""
    file.seek(place.offset)
    content = file.read(place.length)
    if len(content) < place.length:
        raise ValueError("a chunk ends early")
    _, _, size, crc = CHUNK_HEAD.unpack_from(content)
    (name_length,) = struct.unpack_from("<I", content, CHUNK_HEAD.size)
    data_start = CHUNK_HEAD.size + 4 + name_length
    name = content[data_start - name_length : data_start].decode()
    (packed_size,) = struct.unpack_from("<Q", content, data_start)
    packed = content[data_start + 8 :]
    if packed_size != len(packed):
        raise ValueError("a chunk differs from its stated length")
    data = _decompress(packed, size) if name == "zstd" else b""
    if len(data) != size or (crc and zlib.crc32(data) != crc):
        raise ValueError("a chunk does not match its checksum")
    return data


def _decompress(packed: bytes, size: int) -> bytes:
    """Decompressed content of a chunk, `size` bytes. Raises ValueError if the chunk is damaged or larger."""
    import zstandard

    # A damaged or hostile file may state any size.
    try:
        if size > _LARGEST_CHUNK or zstandard.frame_content_size(packed) not in (-1, size):
            raise ValueError("a chunk differs from its stated length")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    except zstandard.ZstdError as error:
        raise ValueError(f"a chunk cannot be decompressed: {error}") from error
