"""Proposes a reading document for a recording. Each line has a reason, and ambiguous names are questions for the user."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from asrsim.recordings.data import Column, Recording
from asrsim.recordings.read import ASKED, read_tables
from asrsim.recordings.reading import Reading, resolve_reading


def propose(
    path: Path, *, mapping: Sequence[str] = (), rate: float | None = None, joints: Sequence[str] | None = None, called: str = ""
) -> tuple[str, Recording]:
    """Text of a reading document such as `lab.csv.yaml`, and the recording.

    Args:
        path: The recording.
        mapping: Items of `--map`.
        rate: Sampling rate that replaces the file's time, Hz.
        joints: Joints of the simulation.
        called: Path of the recording that the document states; "": the file name of the recording.

    The questions about columns are in the document, so they are removed from the findings of the recording.

    Raises RecordingError if the file cannot be read.
    """
    reading = resolve_reading(list(mapping) or None, path, rate, beside=False)
    content, recording = read_tables(path, reading, joints)
    stated = {key: value for key in ("sheet", "joint", "missing", "window") if (value := getattr(reading, key)) is not None}
    lines = [
        f"# How to read {path.name}, proposed by `asrsim init --experiment`. Commands use this file beside the recording;",
        "# in another folder, give this file instead of the recording. Only the columns under `map` are used: check each",
        "# line, answer the questions, and delete the columns that are not to be used.",
        _yaml({"file": called or path.name}),
        *(_line(_yaml({key: value}), "as found in the file") for key, value in content.layout.items()),
        *(_line(_yaml({key: value}, flow=True).strip("{}"), "as stated") for key, value in stated.items()),
    ]
    if rate is not None:
        lines.append(_line(f"time: {{rate: {rate:g}}}", "Hz, as stated"))
    elif clock := content.tables[0].clock:
        doubt = next((one.message for one in recording.findings if one.hint and one.key == clock["column"]), "")
        lines.append(_line(f"time: {_yaml(clock, flow=True)}", f"? {doubt}" if doubt else "its name and unit"))
    lines += _map(recording, reading)
    findings = tuple(one for one in recording.findings if one.code not in ASKED)
    return "\n".join(lines) + "\n", replace(recording, findings=findings)


def _map(recording: Recording, reading: Reading) -> Iterator[str]:
    """Lines of `map`: used columns, and ambiguous columns as comments that the user completes."""
    columns = list(recording.channels.values())
    given = {one.column: one.text for one in reading.maps}
    yield "map:"
    for column in columns:
        if column.quantity:
            unit = _unit(column)
            target = given.get(column.source) or column.meaning + (f" [{unit}]" if unit else "")
            doubt = "" if " assumed" not in column.conversion else "; ? the file states no unit"
            yield _line(f"  {_yaml({column.source: target})}", column.origin + doubt)
    for column in recording.asked:
        target = f"{column.joint or 'JOINT'}.{column.target}".replace("[unit]", f"[{_unit(column) or 'unit'}]")
        yield _line(f"  # {_yaml({column.source: target})}", f"? {column.question}")
    others = [column for column in columns if not (column.quantity or column.question)]
    if len(others) == len(columns):
        # No name of a column has a known meaning, so ask for the meaning of each column.
        for one in others:
            target = f"JOINT.QUANTITY [{_unit(one) or 'unit'}]"
            yield _line(f"  # {_yaml({one.source: target})}", "?")
    elif others:
        yield f"# not used: {', '.join(one.source for one in others)}"


def _unit(column: Column) -> str:
    """Unit of a column's numbers in the file; empty if it is unknown."""
    return column.conversion.partition(" -> ")[0] if " -> " in column.conversion else column.unit


def _line(text: str, reason: str) -> str:
    return f"{text.ljust(58)}  # {reason}"


def _yaml(data: Mapping[str, Any], *, flow: bool = False) -> str:
    """Data as one line of YAML. flow: whether the data are in braces."""
    import yaml

    return yaml.safe_dump(dict(data), default_flow_style=flow, allow_unicode=True, width=math.inf, sort_keys=False).strip()
