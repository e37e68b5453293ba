"""Text files written whole or not at all."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from asrsim.errors import OutputError


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 file beside its place, then put it there in one move; its folder must exist. Raises OutputError."""
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
