"""From raw series to a recording: mapping, guesses, units, and what is odd about the numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from asrsim.errors import Problem, RecordingError, did_you_mean
from asrsim.recordings.adjust import measured, windowed
from asrsim.recordings.agreement import disagreements
from asrsim.recordings.columns import KNOWN, columns_of
from asrsim.recordings.condense import condense, set_aside
from asrsim.recordings.data import Column, Raw, Recording
from asrsim.recordings.mapping import ColumnMap
from asrsim.recordings.matching import matching_name
from asrsim.recordings.names import VOCABULARY, find_column, stated_unit, tokens_of
from asrsim.recordings.oddities import oddities
from asrsim.recordings.units import fits, split_header, unknown_unit
from asrsim.recordings.unstated import unstated

_NAMED = 12
"""Columns that an error names."""


def build(path: Path, raw: Raw, maps: Sequence[ColumnMap], joints: Sequence[str] | None) -> Recording:
    """The recording; raises RecordingError with all problems of the mapping."""
    findings = list(raw.findings)
    raw = windowed(path, raw, maps)
    by_index = _explicit(path, raw, maps, joints)
    with np.errstate(over="ignore", invalid="ignore"):
        columns = columns_of(path, raw, by_index, joints, findings)
    columns = [measured(path, column, findings) for column in _without_repeats(path, columns, findings)]
    base = max(columns, key=lambda column: len(column.time)).time
    findings += oddities(path, columns)
    findings += unstated(path, columns, raw.remarks)
    findings += disagreements(path, columns)
    # Only what was mapped by hand gets so far.
    findings += [
        Problem(f"its unit [{unit}] is not known; read as {column.unit or 'SI'}", file=path, key=column.source,
                hint=f"State it: --map '{column.source}={column.joint}.{column.quantity} [unit]'", code="unknown-unit")
        for column in columns
        if column.quantity and column.conversion.endswith("assumed") and (unit := unknown_unit(column.source))
    ]  # fmt: skip
    mapped = [column for column in columns if column.quantity]
    if len({id(column.time) for column in mapped}) > 1:
        sizes = sorted({len(column.time) for column in mapped}, reverse=True)
        findings.append(
            Problem(f"its columns have times of their own, with {', '.join(map(str, sizes[:6]))} samples; each is kept",
                    file=path, code="several-times")
        )  # fmt: skip
    if not any(column.quantity for column in columns):
        names = ", ".join(column.source for column in columns[:20])
        findings.append(
            Problem(f"no column could be matched to a joint's quantity; found {names}", file=path,
                    code="nothing-mapped", hint="Say what a column is with --map COLUMN=JOINT.QUANTITY, or in a file beside it "
                    f"({path.name}.yaml)")
        )  # fmt: skip
    used = {column.source for column in columns if column.quantity}
    findings = condense(set_aside(findings, used, {column.source for column in columns} - used))
    return Recording(
        path=path, format=raw.format, time=base, channels={column.source: column for column in columns},
        findings=tuple(findings), epoch=raw.epoch,
        guesses=tuple(column for column in columns if column.origin.startswith("guessed")),
    )  # fmt: skip


def _explicit(path: Path, raw: Raw, maps: Sequence[ColumnMap], joints: Sequence[str] | None) -> dict[int, ColumnMap]:
    """Index of series -> its map. Raises RecordingError for columns, units and joints that there are not.

    joints: of the simulation. A mapping file may serve a larger robot, and so name others.
    """
    names = [series.name for series in raw.series]
    found: dict[int, ColumnMap] = {}
    problems: list[Problem] = []
    for one in maps:
        if one.role in ("time", "window"):
            continue
        if one.role == "ignore":
            parts = [i for i, name in enumerate(names) if name.startswith((f"{one.column}/", f"{one.column}."))]
            if parts or (one.column in raw.names and one.column not in names):
                found |= dict.fromkeys(parts, one)
                continue
        index = find_column(one.column, names)
        if index is None or (one.column.lstrip("#").isdecimal() and raw.format in ("csv", "sheet")):
            # Numbers count the file's columns, of which the time is one; headerless names carry that number.
            label = f"column_{one.column.lstrip('#')}"
            index = names.index(label) if label in names else index
        if index is None:  # of a file that was joined, or names its only column: what that is called there
            labels = [series.label for series in raw.series]
            index = labels.index(one.column) if labels.count(one.column) == 1 else None
        if index is None:
            problems.append(
                Problem("there is no such column", file=path, key=one.column, choices=_shown(names),
                        hint=did_you_mean(one.column, names), code="no-such-column")
            )  # fmt: skip
            continue
        unit = one.unit or stated_unit(raw.series[index].name, raw.series[index].unit)
        if one.quantity is not None and unit is not None and not fits(unit.si, KNOWN[one.quantity].unit):
            problems.append(
                Problem(
                    f"is in {unit.symbol}, which cannot be a {one.quantity} ({KNOWN[one.quantity].unit})", file=path,
                    key=one.column, hint="Give the unit of its numbers: --map COLUMN=JOINT.QUANTITY [unit]", code="wrong-unit",
                )
            )  # fmt: skip
            continue
        if joints and one.joint is not None and one.origin == "command line" and matching_name(one.joint, joints) is None:
            problems.append(
                Problem(f"the simulation has no joint '{one.joint}'", file=path, key=one.column, choices=_shown(joints),
                        hint=did_you_mean(one.joint, tuple(joints)), code="no-such-joint")
            )  # fmt: skip
            continue
        found[index] = one
    if problems:
        raise RecordingError(problems)
    return found


def _shown(names: Sequence[str]) -> tuple[str, ...]:
    """Names for a message: of very many the first."""
    return (*names[:_NAMED], f"and {len(names) - _NAMED} more") if len(names) > _NAMED + 1 else tuple(names)


def _spare(name: str) -> list[str]:
    """Words of a column's name beside those of quantities."""
    return [word for word in tokens_of(split_header(name)[0]) if not word.isdecimal() and word not in VOCABULARY]


def _without_repeats(path: Path, columns: list[Column], findings: list[Problem]) -> list[Column]:
    """One column a quantity: what was said wins over what the file names, and that over a guess; then the plainest name, q1
    before q1_simulated; then the first."""
    rank = {"command line": 0, "map file": 0, "named in the file": 1}
    # A position that was told stands before the torque that a controller made of it.
    torques = [column.quantity == "reference_1" and column.unit in ("N m", "N") for column in columns]
    # So does what a controller was told or measures before what it gives out.
    given = [re.split(r"[./]", column.source)[-1] in ("command", "output") for column in columns]
    spare = [0 if column.origin in ("command line", "map file") else len(_spare(column.source)) for column in columns]
    order = sorted(range(len(columns)), key=lambda i: (rank.get(columns[i].origin, 2), torques[i], given[i], spare[i], i))
    owner: dict[tuple[str | None, str], int] = {}
    problems: list[Problem] = []
    result = list(columns)
    for i in order:
        column = columns[i]
        if column.quantity is None:
            continue
        key = (column.joint, column.quantity)
        if key not in owner:
            owner[key] = i
            continue
        first = columns[owner[key]]
        message = f"is a second {column.joint}.{column.quantity} beside '{first.source}'"
        if rank.get(column.origin) == 0 and rank.get(first.origin) == 0:
            problems.append(Problem(message, file=path, key=column.source, code="mapped-twice"))
            continue
        if rank.get(first.origin, 2) == rank.get(column.origin, 2):
            findings.append(
                Problem(f"{message}, which is used", file=path, key=column.source, code="second-column",
                        hint=f"Choose with --map '{column.source}={column.joint}.{column.quantity}'")
            )  # fmt: skip
        result[i] = replace(
            column, joint=None, quantity=None, origin=f"not used: {column.joint}.{column.quantity} is '{first.source}'"
        )
    if problems:
        raise RecordingError(problems)
    return result
