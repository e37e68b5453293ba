"""A bound on what a compressed file may unpack to, checked before it is unpacked: a few kB may stand for all memory."""

from __future__ import annotations

import zipfile
from pathlib import Path

from asrsim.errors import RecordingError

LEAST = 256 * 2**20
"""Bytes that any file may unpack to."""
RATIO = 50
"""Times its own size that a file may unpack to; measured signals in text compress by 3 to 30."""


def check_unpacked(path: Path, size: int) -> None:
    """Raises RecordingError where `size` bytes, to which the file would unpack, are beyond the bound."""
    packed = path.stat().st_size
    if size > max(LEAST, RATIO * packed):
        bound = f"at most {LEAST / 2**20:.0f} MiB or {RATIO} times the file are unpacked"
        raise RecordingError(
            f"would unpack to {size / 2**20:.0f} MiB, from {packed / 2**20:.3g}; {bound}", file=path, code="too-large",
            hint="If you trust it, unpack it by its own tools first, or export it as CSV",
        )  # fmt: skip


def check_archive(path: Path) -> None:
    """The same for a zip archive, such as a workbook or numpy's .npz."""
    with zipfile.ZipFile(path) as archive:
        check_unpacked(path, sum(one.file_size for one in archive.infolist()))
