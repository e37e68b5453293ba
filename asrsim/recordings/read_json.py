"""From JSON to a table: a record a line, a list of records, or lists by name; what robots and web tools log."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import RecordingError
from asrsim.recordings.cells import kind_of
from asrsim.recordings.delimited import Faults, Table, report, value_of
from asrsim.recordings.header import unique
from asrsim.recordings.messages import NAME_FIELDS, own_names
from asrsim.recordings.names import tokens_of
from asrsim.recordings.sniff import Layout, encoding_of
from asrsim.recordings.time_columns import TIME_WORDS

_LONGEST = 64
"""Entries of a list in a record; longer ones are pictures or scans."""

_LIST = re.compile(rb"\[\s*(?:\{|\[\s*[\[{\"\-\d]|\"|-?\d[\d.eE+-]*\s*,)")
"""How a list of objects, lists, texts or numbers begins; `[0.25] q1=0.5` is none."""

Record = dict[str, str]
"""Label -> cell, as a text file would hold it."""


def is_json(path: Path) -> bool:
    """Whether the file begins as JSON does: with an object, or a list of objects, lists or numbers."""
    with path.open("rb") as stream:
        text = stream.read(4096).removeprefix(b"\xef\xbb\xbf").lstrip()
    return text.startswith(b"{") or _LIST.match(text) is not None


def read_json(path: Path) -> Table:
    """The table of a JSON file. Raises RecordingError where it is no JSON, or holds no records."""
    text = path.read_text(encoding=encoding_of(path), errors="replace")
    whole = _whole(text)
    records, bad = _records(text, whole, path) if isinstance(whole, ValueError | RecursionError) else (_of(whole), [])
    units = dict(_units_of(whole, "")) if isinstance(whole, Mapping) else {}
    if len(records) < 2 or not any(records):
        raise RecordingError(
            f"is JSON with {len(records)} records; at least 2 are needed", file=path, code="no-numbers",
            hint="Expected records with a time and signals: one a line, a list of them, or lists by name",
        )  # fmt: skip
    return table_of(path, records, bad, units=units, remarks="\n".join(_remarks(whole)) if isinstance(whole, Mapping) else "")


def table_of(
    path: Path, records: list[Record], bad: list[int], *, units: Mapping[str, str] | None = None, remarks: str = ""
) -> Table:
    """Records as rows, under all labels that they have. bad: lines that were no records; units: of labels."""
    labels = list(dict.fromkeys(label for record in records for label in record))
    columns = [[record.get(label, "") for record in records] for label in labels]
    kinds = [kind_of(cells, ".") for cells in columns]
    layout = Layout(
        encoding="utf-8", separator=None, decimal=".", quoted=False, header_line=1, first_line=1, skipped=(),
        names=unique([_with_unit(label, units or {}) for label in labels]), units=("",) * len(labels),
        stamps=tuple(i for i, kind in enumerate(kinds) if kind == "stamp"),
        text=tuple(i for i, kind in enumerate(kinds) if kind == "text"), remarks=remarks,
    )  # fmt: skip
    faults, zeros = Faults(ragged=bad, lengths={0} if bad else set()), dict[int, int]()
    stamps, words = set(layout.stamps), set(layout.text)
    values = np.array(
        [[value_of(cell, i, line, ".", stamps, words, faults, zeros) for i, cell in enumerate(row)]
         for line, row in enumerate(zip(*columns, strict=True), start=1)]
    )  # fmt: skip
    return Table(
        layout=layout, values=values, lines=np.arange(1, len(values) + 1, dtype=np.int64), zeros=zeros,
        findings=tuple(report(path, layout, faults, len(values))),
        words=faults.few(),
    )  # fmt: skip


def _whole(text: str) -> Any:
    """The document, or the error of a file that is none as a whole."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        return error


def _records(text: str, whole: Exception, path: Path) -> tuple[list[Record], list[int]]:
    """Records of lines, and the lines that are none (the last one of a log that was cut off)."""
    records: list[Record] = []
    bad: list[int] = []
    for count, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            records.append(flat(json.loads(line.strip().rstrip(","))))
        except (ValueError, RecursionError):
            bad.append(count)
    if len(records) < 2 or len(bad) > max(1, 0.1 * len(records)):
        said, place = type(whole).__name__, None
        if isinstance(whole, json.JSONDecodeError):
            said, place = whole.msg, whole.lineno
        raise RecordingError(f"cannot be read as JSON: {said}", file=path, line=place, code="bad-json")
    return records, bad


def _of(data: Any) -> list[Record]:
    """Records of a whole document."""
    data = _with_names(data)
    if isinstance(data, list):
        return [flat(one) for one in data if isinstance(one, Mapping | list)]
    if not isinstance(data, Mapping):
        return []
    if len(data) > 1 and all(str(name).isdecimal() and isinstance(one, Mapping) for name, one in data.items()):
        return [flat(one) for one in data.values()]  # pandas writes records by their index
    lists = [value for value in _values(data) if isinstance(value, list) and value and isinstance(value[0], Mapping)]
    tables = [value for value in lists if not _are_series(value)]
    if tables:
        shared = {key: data[key] for key in NAME_FIELDS if isinstance(data.get(key), list)}
        return [flat({**shared, **one}) for one in max(tables, key=len) if isinstance(one, Mapping)]
    columns = _of_pairs(dict(_columns(data, "")))
    length = max((len(column) for column in columns.values()), default=0)
    return [{name: _cell(column[i]) for name, column in columns.items() if i < len(column)} for i in range(length)]


def _with_names(data: Any) -> Any:
    """Rows whose names stand apart from them as records, series beside their names by these; any other as it is."""
    if isinstance(data, Mapping):
        columns = data.get("columns")
        names = [str(name) for name in columns] if isinstance(columns, list) else None
        names = names or next((data[key] for key in ("fields", "names", "header") if _are_names(data.get(key))), None)
        rows = next((data[key] for key in ("data", "rows", "values") if isinstance(data.get(key), list)), None)
        if names is not None and rows is not None:
            index = data.get("index")
            timed = isinstance(index, list) and len(index) == len(rows) and index != [*range(len(rows))] and "time" not in names
            first = [*index] if timed and isinstance(index, list) else []
            names, rows = (
                (["time", *names], [[t, *row] for t, row in zip(first, rows, strict=True)]) if timed else (names, rows)
            )
            return [dict(zip(names, row, strict=False)) for row in rows if isinstance(row, list)]
    elif isinstance(data, list) and len(data) > 2 and _are_names(data[0]) and isinstance(data[1], list):
        return [dict(zip(data[0], row, strict=False)) for row in data[1:] if isinstance(row, list)]
    elif isinstance(data, list) and len(data) > 1 and all(isinstance(one, Mapping) for one in data):
        series = [(_first(one, str, ("name", "label")), _first(one, list, ("values", "data", "y")), one) for one in data]
        if all(name and values for name, values, _ in series):
            units = [_first(one, str, ("unit", "units")) for _, _, one in series]
            named = {
                f"{name} [{unit}]" if unit else str(name): values for (name, values, _), unit in zip(series, units, strict=True)
            }
            return named if len(named) == len(series) else data
    return data


def _are_names(value: Any) -> bool:
    return isinstance(value, list) and len(value) > 1 and all(isinstance(one, str) for one in value)


def _first(data: Mapping[str, Any], kind: type, keys: Iterable[str]) -> Any:
    """The first of these entries that is of the kind; None without one."""
    return next((data[key] for key in keys if isinstance(data.get(key), kind)), None)


def _of_pairs(columns: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """`{"hip": [[t, q], ...], "knee": [[t, q], ...]}` as one time and a column each; any other as it is."""
    times = [column for name, column in columns.items() if name.endswith("[0]")]
    if len(times) < 2 or len(columns) != 2 * len(times) or any(time != times[0] for time in times):
        return columns
    return {"time": times[0], **{name.removesuffix("[1]"): column for name, column in columns.items() if name.endswith("[1]")}}


def _remarks(data: Mapping[str, Any]) -> Iterable[str]:
    """What the document says beside its lists: `rate: 500`, `units: deg`."""
    for key, value in data.items():
        if isinstance(value, Mapping):
            yield from _remarks(value)
        elif isinstance(value, str | int | float):
            yield f"{key}: {value}"


def _units_of(data: Mapping[str, Any], prefix: str) -> Iterable[tuple[str, str]]:
    """Units beside lists: `{"units": {"q1": "deg"}}`, `{"q1": {"unit": "deg", "values": [...]}}`, or one for each column."""
    for key, value in data.items():
        if key.lower() in ("unit", "units") and isinstance(value, list) and isinstance(names := data.get("columns"), list):
            yield from ((str(name), unit) for name, unit in zip(names, value, strict=False) if isinstance(unit, str))
        elif key.lower() in ("unit", "units") and isinstance(value, str):
            timeless = (name for name, other in data.items() if isinstance(other, list) and not TIME_WORDS & {*tokens_of(name)})
            yield from ((f"{prefix}{name}", value) for name in timeless)
        elif key.lower() in ("unit", "units") and isinstance(value, Mapping):
            yield from ((str(name), unit) for name, unit in value.items() if isinstance(unit, str))
        elif isinstance(value, Mapping):
            yield from _units_of(value, f"{prefix}{key}.")
        elif isinstance(value, list) and _are_series(value):
            for name, rest in _named(value):
                yield from _units_of(rest, f"{prefix}{key}{name}.")


def _with_unit(label: str, units: Mapping[str, str]) -> str:
    unit = units.get(label, units.get(label.rpartition(".")[2]))
    return label if unit is None else f"{label} [{unit}]"


def _values(data: Mapping[str, Any]) -> Iterable[Any]:
    for value in data.values():
        yield value
        if isinstance(value, Mapping):
            yield from _values(value)


def _columns(data: Mapping[str, Any], prefix: str) -> Iterable[tuple[str, list[Any]]]:
    """Lists by their path; of lists of lists, one for each entry."""
    for key, value in data.items():
        if isinstance(value, Mapping) and len(value) > 1 and all(str(name).isdecimal() for name in value):
            value = list(value.values())  # pandas writes a column by its index
        if isinstance(value, Mapping):
            yield from _columns(value, f"{prefix}{key}.")
        elif isinstance(value, list) and _are_series(value):
            for name, rest in _named(value):
                yield from _columns(rest, f"{prefix}{key}{name}.")
        elif isinstance(value, list) and len(value) > 1 and isinstance(value[0], list):
            rows = [row if isinstance(row, list) else [] for row in value]
            for i in range(min(_LONGEST, max(len(row) for row in rows))):
                yield f"{prefix}{key}[{i}]", [row[i] if i < len(row) else None for row in rows]
        elif isinstance(value, list) and len(value) > 1:
            yield f"{prefix}{key}", value


def flat(data: Any, prefix: str = "") -> Record:
    """A record's numbers and words by their path: `header.stamp.sec`, `position[0]`."""
    if isinstance(data, Mapping):
        found: Record = {}
        for key, value in data.items():
            found |= flat(value, f"{prefix}.{key}" if prefix else str(key))
        return found
    if isinstance(data, list):
        if len(data) > _LONGEST:
            return {}
        found = {}
        for name, rest in _named(data):
            found |= flat(rest, f"{prefix}{name}" if prefix else name.removeprefix("."))
        if found:
            return found
        for i, value in enumerate(data):
            found |= flat(value, f"{prefix}[{i}]" if prefix else f"column_{i + 1}")
        return found
    return {prefix: _cell(data)} if prefix else {}


def _are_series(entries: list[Any]) -> bool:
    """Whether these are objects with a name each that hold lists over time, which are longer than the list of objects; records
    are not."""
    return own_names(entries) is not None and all(
        any(isinstance(value, list) and len(value) > len(entries) for value in one.values()) for one in entries
    )


def _named(entries: list[Any]) -> Iterable[tuple[str, dict[str, Any]]]:
    """The end of each object's path, `.hip` or `[2]`, and what it holds beside its name; none where they have none."""
    key, told = own_names(entries) or ("", [])
    for name, one in zip(told, entries, strict=False):
        yield f"[{name}]" if isinstance(name, int) else f".{name}", {other: one[other] for other in one if other != key}


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return str(int(value))
    return "" if value is None or isinstance(value, list | Mapping) else str(value)
