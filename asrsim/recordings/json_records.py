"""Reads JSON: a record a line, a list of records, or lists by name."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from asrsim.errors import RecordingError
from asrsim.recordings.data import Content
from asrsim.recordings.reading import Reading
from asrsim.recordings.text import read_cells

_LONGEST = 64
"""Entries of a list in a record; longer ones are pictures or scans."""
_START = re.compile(rb"\s*(?:\xef\xbb\xbf)?\s*(?:\{|\[\s*(?:\{|\[\s*[\[{\"\-\d]))")


def is_json(path: Path) -> bool:
    """Whether a file begins as JSON does: with an object, or a list of objects or lists."""
    with path.open("rb") as stream:
        return _START.match(stream.read(4096)) is not None


def read_json(path: Path, reading: Reading) -> Content:
    """The table of a JSON file. Raises RecordingError where it is no JSON, or holds no records."""
    text = path.read_text(encoding=reading.encoding or "utf-8-sig", errors="replace")
    units: Mapping[str, Any] = {}
    try:
        data = json.loads(text)
        records = _records(data)
        if isinstance(data, Mapping) and isinstance(told := data.get("units"), Mapping):
            units = told
    except (ValueError, RecursionError) as error:
        records = _of_lines(text, error)
    if len(records) < 2:
        raise RecordingError(
            f"is JSON with {len(records)} records; at least 2 are needed", code="no-numbers",
            hint="Expected records with a time and signals: one a line, a list of them, or lists by name",
        )  # fmt: skip
    labels = list(dict.fromkeys(label for record in records for label in record))
    header = [f"{label} [{units[label]}]" if label in units else label for label in labels]
    return read_cells("json", [header, *([record.get(label, "") for label in labels] for record in records)], reading)


def _of_lines(text: str, whole: Exception) -> list[dict[str, str]]:
    """Records of lines; the last one of a log that was cut off may be none."""
    records: list[dict[str, str]] = []
    lines = [line.strip().rstrip(",") for line in text.splitlines() if line.strip()]
    for count, line in enumerate(lines, start=1):
        try:
            records.append(dict(_flat(json.loads(line), "")))
        except (ValueError, RecursionError):
            if count < len(lines) or len(lines) < 3:
                line_number = getattr(whole, "lineno", None)
                raise RecordingError(f"cannot be read as JSON: {whole}", line=line_number, code="bad-json") from None
    return records


def _records(data: Any) -> list[dict[str, str]]:
    """Records of a whole document: a list of them, its longest list of objects, or its lists by name."""
    if isinstance(data, Mapping) and isinstance(names := data.get("columns"), list) and isinstance(data.get("data"), list):
        data = [dict(zip(map(str, names), row, strict=False)) for row in data["data"]]
    lists = dict(_lists(data, "")) if isinstance(data, Mapping) else {"": data} if isinstance(data, list) else {}
    tables = [one for name, one in lists.items() if one and (isinstance(one[0], Mapping) or not name)]
    if tables:
        return [dict(_flat(one, "")) for one in max(tables, key=len)]
    length = max((len(one) for one in lists.values()), default=0)
    columns = {name: one for name, one in lists.items() if len(one) == length > 1}
    return [dict(_flat({name: one[i] for name, one in columns.items()}, "")) for i in range(length if columns else 0)]


def _lists(data: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, list[Any]]]:
    """Lists by their path."""
    for key, value in data.items():
        if isinstance(value, Mapping):
            yield from _lists(value, f"{prefix}{key}.")
        elif isinstance(value, list):
            yield f"{prefix}{key}", value


def _flat(data: Any, prefix: str) -> Iterator[tuple[str, str]]:
    """A record's numbers and words by their path: `header.stamp.sec`, `position[0]`."""
    if isinstance(data, Mapping):
        for key, value in data.items():
            yield from _flat(value, f"{prefix}.{key}" if prefix else str(key))
    elif isinstance(data, list):
        for i, value in enumerate(data if len(data) <= _LONGEST else ()):
            yield from _flat(value, f"{prefix}[{i}]" if prefix else f"column_{i + 1}")
    else:
        yield prefix, "" if data is None else str(int(data)) if isinstance(data, bool) else str(data)
