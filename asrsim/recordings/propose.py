"""Proposes the document that says how a file is read: each line with its reason, and questions where it is not sure."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from asrsim.errors import OutputError
from asrsim.recordings.data import Column, Recording
from asrsim.recordings.names import KNOWN
from asrsim.recordings.read import read_series
from asrsim.recordings.reading import ENDING, resolve_reading


def propose(
    path: Path, out: Path | None = None, *, mapping: Sequence[str] = (), rate: float | None = None,
    joints: Sequence[str] | None = None, force: bool = False, called: str = "",
) -> tuple[Path, Recording]:  # fmt: skip
    """Writes `lab.csv.yaml` beside a recording, or `out`; gives its path and the recording as it was read for it.

    joints: of the simulation; called: how the document names the recording, its name where it stands beside it.
    Raises RecordingError where the file cannot be read, OutputError where the document is there and not to be replaced.
    """
    place = path.with_name(path.name + ENDING) if out is None else out
    if place.exists() and not force:
        raise OutputError(f"{place} is there already; --overwrite replaces it")
    reading = resolve_reading(list(mapping) or None, path, rate, beside=False)
    content, series, recording = read_series(path, reading, joints)
    lines = [
        f"# How {path.name} is read, proposed by `asrsim init --experiment`. Beside the recording every command obeys it;",
        "# elsewhere it is given in the place of the recording. With `map` nothing is taken from names: check each line,",
        "# answer the questions, and strike what is not to be used.",
        f"file: {_text(called or path.name)}",
        *(f"{key}: {_text(value)}".ljust(40) + "# as found in the file" for key, value in content.layout.items()),
    ]
    if rate is not None:
        lines.append(f"time: {{rate: {rate:g}}}".ljust(40) + "# Hz, as stated")
    elif clock := series[0].clock:
        doubt = next((one.message for one in recording.findings if one.hint and json.dumps(one.key) in clock), "")
        lines.append(f"time: {clock}".ljust(40) + (f"# ? {doubt}" if doubt else "# its name and unit"))
    used = [column for column in recording.channels.values() if column.quantity]
    marks = [one for one in recording.findings if isinstance(one.value, float)]
    lines += [f"# missing: {one.value:g}".ljust(40) + f"# ? {one.key}: {one.message}" for one in marks]
    lines += ["map:" if used else "map: {}", *(_line(column, reading.maps) for column in used)]
    lines += _questions(recording)
    place.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return place, recording


def _line(column: Column, maps: Sequence[object]) -> str:
    given = next((str(getattr(one, "text", "")) for one in maps if getattr(one, "column", "") == column.source), None)
    unit = column.conversion.partition(" -> ")[0] if " -> " in column.conversion else column.unit
    target = given or f"{column.joint}.{column.quantity}" + (f" [{unit}]" if unit else "")
    reason = column.origin + ("; ? it states no unit" if not column.stated and KNOWN[str(column.quantity)].unit else "")
    return f"  {_text(column.source)}: {_text(target)}".ljust(60) + f"  # {reason}"


def _questions(recording: Recording) -> list[str]:
    """What is not used, as comments that need only be completed; and what is odd."""
    lines = []
    for column in recording.channels.values():
        if column.quantity is None and column.origin.startswith("asked"):
            unit = f" [{column.unit}]" if column.unit else " [unit]"
            lines.append(
                f"  # {_text(column.source)}: {column.joint or 'JOINT'}.QUANTITY{unit}".ljust(60) + f"  # ? {column.origin[7:]}"
            )
    others = [
        column.source for column in recording.channels.values() if not column.quantity and not column.origin.startswith("asked")
    ]
    lines += [f"# not used: {', '.join(others)}"] if others else []
    odd = [f"#   {problem.key}: {problem.message}" for problem in recording.findings if problem.key in recording.channels]
    return [*lines, *(["# odd about the file:", *odd] if odd else [])]


def _text(value: object) -> str:
    """A value as YAML writes it: quoted where it must be."""
    text = str(value)
    plain = text.replace("_", "").replace(".", "").replace("/", "").replace(" ", "").isalnum() and not text[:1].isdigit()
    return text if isinstance(value, int) or (plain and text == text.strip()) else json.dumps(text, ensure_ascii=False)
