"""What `rostopic echo` and `ros2 topic echo` print: a message in YAML, a line `---`, the next message."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from asrsim.errors import RecordingError
from asrsim.recordings.delimited import Table
from asrsim.recordings.read_json import Record, flat, table_of
from asrsim.recordings.sniff import encoding_of

_START = 4096
"""Bytes in which a first message ends, or says what it is."""
_MARK = re.compile(r"^---\s*$", re.MULTILINE)
_ENTRY = re.compile(r"(?:\s*#.*\n|\s*\n)*[A-Za-z_]\w*:(?:\s|$)")
_SHARED = re.compile(r"(?:^|[\s\[{,])[&*]\w")
"""Anchors of YAML, by which a short text becomes a long one; no message has any."""


def is_echo(path: Path) -> bool:
    """Whether the file begins with a message in YAML, and a line `---` behind it."""
    with path.open("rb") as stream:
        start = stream.read(_START).decode("utf-8", errors="replace").lstrip("\ufeff-\r\n ")
    return _ENTRY.match(start) is not None and _MARK.search(start) is not None


def read_echo(path: Path) -> Table:
    """The table of the messages. Raises RecordingError where they are none."""
    records: list[Record] = []
    bad: list[int] = []
    for line, text, whole in _messages(path.read_text(encoding=encoding_of(path), errors="replace")):
        record = _record(text) if whole else None
        if record is None:
            bad.append(line)
        else:
            records.append(record)
    if len(records) < 2 or len(bad) > max(1, 0.1 * len(records)):
        raise RecordingError(
            f"looks like what `rostopic echo` prints, and has {len(records)} messages with numbers; at least 2 are needed",
            file=path, line=bad[0] if bad else None, code="no-numbers", hint="Record a bag, or print with `-p` (ROS 2: --csv)",
        )  # fmt: skip
    return table_of(path, records, bad)


def _messages(text: str) -> Iterator[tuple[int, str, bool]]:
    """Lines in which messages begin, messages, and whether they have their end: that of a terminal that was closed is cut off,
    and so may its last number be."""
    line = 1
    *whole, rest = _MARK.split(text)
    for part in (*whole, rest):
        if part.strip():
            yield line + len(part) - len(part.lstrip("\n")), part, part is not rest
        line += part.count("\n")


def _record(text: str) -> Record | None:
    import yaml

    if _SHARED.search(text):
        return None
    try:
        return flat(yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))) or None
    except (yaml.YAMLError, ValueError, RecursionError):
        return None
