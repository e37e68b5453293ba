"""From raw series to a recording: mapping, guesses, units, and what is odd about the numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from asrsim.errors import Problem, RecordingError, did_you_mean
from asrsim.quantities import DERIVED, QUANTITIES
from asrsim.recordings.adjust import measured, scaled, windowed
from asrsim.recordings.condense import condense, set_aside
from asrsim.recordings.data import Column, Raw, RawSeries, Recording
from asrsim.recordings.mapping import ColumnMap
from asrsim.recordings.names import find_column, guess, joint_numbers, stated_unit, theta_is_motor, tokens_of
from asrsim.recordings.numbering import one_behind, zero_based
from asrsim.recordings.oddities import oddities
from asrsim.recordings.units import Unit, fits, split_header, unknown_unit
from asrsim.recordings.unstated import unstated

_KNOWN = {**QUANTITIES, **DERIVED}
_NAMED = 12
"""Columns that an error names."""
_TURNS = 20.0
"""Whole numbers beyond it are no angles in rad: counts of an encoder, or degrees."""


def build(path: Path, raw: Raw, maps: Sequence[ColumnMap], joints: Sequence[str] | None) -> Recording:
    """The recording; raises RecordingError with all problems of the mapping."""
    findings = list(raw.findings)
    raw = windowed(path, raw, maps)
    by_index = _explicit(path, raw, maps)
    with np.errstate(over="ignore", invalid="ignore"):
        columns = _columns(path, raw, by_index, joints, findings)
    columns = [measured(path, column, findings) for column in _without_repeats(path, columns, findings)]
    base = max(columns, key=lambda column: len(column.time)).time
    findings += oddities(path, columns)
    findings += unstated(path, columns, raw.remarks)
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


def _explicit(path: Path, raw: Raw, maps: Sequence[ColumnMap]) -> dict[int, ColumnMap]:
    """Index of series -> its map."""
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
        if index is None or (one.column.lstrip("#").isdigit() and raw.format in ("csv", "sheet")):
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
        if one.quantity is not None and unit is not None and not fits(unit.si, _KNOWN[one.quantity].unit):
            problems.append(
                Problem(
                    f"is in {unit.symbol}, which cannot be a {one.quantity} ({_KNOWN[one.quantity].unit})", file=path,
                    key=one.column, hint="Give the unit of its numbers: --map COLUMN=JOINT.QUANTITY [unit]", code="wrong-unit",
                )
            )  # fmt: skip
            continue
        found[index] = one
    if problems:
        raise RecordingError(problems)
    return found


def _columns(
    path: Path, raw: Raw, explicit: dict[int, ColumnMap], joints: Sequence[str] | None, findings: list[Problem]
) -> list[Column]:
    # The second "angle" of a file is angle#2, and no joint 2.
    plain = [split_header(re.sub(r"#\d+$", "", series.name))[0] for series in raw.series]
    counted = joint_numbers(plain)
    motors = theta_is_motor(tokens_of(name) for name in plain)
    # elbow.link_position and the like say whose they are.
    spelled = [(series.joint or name.rpartition(".")[0]) for series, name in zip(raw.series, plain, strict=True)
               if series.joint is not None or ("." in name and name.rpartition(".")[2] in _KNOWN)]  # fmt: skip
    named = tuple(dict.fromkeys(spelled))
    known = tuple(joints) if joints is not None else named
    behind = one_behind(plain, known)
    if behind:
        findings.append(
            Problem(f"its joints count from 0: {known[0].removesuffix('1')}0 is {known[0]}", file=path, code="joints-from-zero",
                    hint="Say otherwise with --map COLUMN=JOINT.QUANTITY")
        )  # fmt: skip
    meanings = {
        index: guess(_plain_name(plain[index]), stated_unit(series.name, series.unit),
                     joints=() if behind else known, counted=counted, theta_is_motor=motors)
        for index, series in enumerate(raw.series)
        if index not in explicit and series.quantity is None
    }  # fmt: skip
    places = [int(m[1]) for series in raw.series if series.quantity and (m := re.search(r"(\d+)\]?$", series.name))]
    numbered = {i: (plain[i], m.number) for i, m in meanings.items() if m.quantity and m.number is not None}
    shifted = zero_based(numbered, len(known), zero=0 in counted or 0 in places)
    # Words beside the quantity name joints if they tell columns apart: hip_pos and knee_pos, but not filtered_pos alone.
    words = {m.words for m in meanings.values() if m.quantity and m.number is None and m.joint is None and m.words}
    named_by_words = len(words) > 1 or (bool(words) and bool(known))
    columns: list[Column] = []
    homeless: list[str] = []
    doubts: dict[str, list[str]] = {}
    for index, series in enumerate(raw.series):
        unit = stated_unit(series.name, series.unit)
        one = explicit.get(index)
        if one is not None:
            if one.role == "ignore":
                columns.append(_column(series, unit, None, None, f"not used: {one.origin}"))
            else:
                columns.append(scaled(_column(series, one.unit or unit, one.joint, one.quantity, one.origin), one))
            continue
        if series.quantity is not None:
            joint = series.joint
            if joint is None:
                number = next((int(word) for word in reversed(tokens_of(series.name)) if word.isdigit()), None)
                joint = known[number] if number is not None and number < len(known) else None
            quantity = series.quantity if joint is not None else None
            columns.append(
                _column(series, unit, joint, quantity, "named in the file" if quantity else "not used: no joint named")
            )
            continue
        meaning = meanings[index]
        if meaning.quantity is not None and (doubt := _doubt(series, unit, meaning.quantity)):
            doubts.setdefault(doubt, []).append(series.name)
            columns.append(_column(series, unit, None, None, f"not used: looks like {meaning.quantity}, but {doubt}"))
            continue
        if meaning.quantity is None:
            columns.append(_column(series, unit, series.joint, None, f"not used: {meaning.reason}"))
            continue
        joint = (
            series.joint
            or meaning.joint
            or _joint(meaning.number, known, meaning.words if named_by_words else (), zero=index in shifted)
        )
        if joint is None:
            homeless.append(series.name)
            columns.append(_column(series, unit, None, None, "not used: which joint it is of is unclear"))
        else:
            columns.append(_column(series, unit, joint, meaning.quantity, f"guessed: {meaning.reason}"))
    findings += [
        Problem(f"not used, since {doubt}", file=path, key=", ".join(names[:6]), code="unclear-unit",
                hint=f"State the unit: --map '{names[0]}=JOINT.QUANTITY [unit]'")
        for doubt, names in doubts.items()
    ]  # fmt: skip
    if homeless:
        findings.append(
            Problem(f"which joint these columns are of is unclear: {', '.join(homeless)}", file=path, choices=known,
                    hint="Say it with --map COLUMN=JOINT.QUANTITY", code="unclear-joint")
        )  # fmt: skip
    return columns


def _doubt(series: RawSeries, unit: Unit | None, quantity: str) -> str:
    """Why the numbers under a guessed name are hardly in SI; "" without doubt."""
    if unit is not None:
        return ""
    if (stated := unknown_unit(series.name)) is not None:
        return f"its unit [{stated}] is not known"
    values = series.values[np.isfinite(series.values)]
    angle = _KNOWN[quantity].unit == "rad" or quantity == "reference_1"
    if angle and len(values) > 1 and np.max(np.abs(values)) > _TURNS and np.all(values == np.round(values)):
        return f"its whole numbers up to {np.max(np.abs(values)):g} look like counts or degrees, not rad"
    return ""


def _shown(names: Sequence[str]) -> tuple[str, ...]:
    """Names for a message: of very many the first."""
    return (*names[:_NAMED], f"and {len(names) - _NAMED} more") if len(names) > _NAMED + 1 else tuple(names)


def _plain_name(name: str) -> str:
    """Without the field of a message that holds nothing else."""
    return name.removesuffix("/data")


def _joint(number: int | None, known: Sequence[str], words: Sequence[str], *, zero: bool) -> str | None:
    """The joint of a number, which may count from 0: of that ending, else by its place; of words in its name; without either
    the only joint."""
    if number is None and words:
        if not known:
            return "_".join(words)
        fitting = [joint for joint in known if set(words) <= set(tokens_of(joint))]
        if len(fitting) == 1:
            return fitting[0]
    if not known:
        return f"joint_{1 if number is None else number}"
    if number is None:
        return known[0] if len(known) == 1 else None
    ending = [joint for joint in known if tokens_of(joint)[-1:] == [str(number)]]
    # Counted from 0, [1] is the second of joint_1, joint_2, unless there is a joint_0.
    if len(ending) == 1 and not (zero and not any(tokens_of(joint)[-1:] == ["0"] for joint in known)):
        return ending[0]
    place = number if zero else number - 1
    return known[place] if 0 <= place < len(known) else None


def _column(series: RawSeries, unit: Unit | None, joint: str | None, quantity: str | None, origin: str) -> Column:
    """The column in SI units, its conversion in words."""
    expected = _KNOWN[quantity].unit if quantity is not None else ""
    if unit is None:
        said = f"{expected} assumed" if expected and not origin.startswith("named") else ""
        return Column(time=series.time, values=series.values, unit=expected, joint=joint, quantity=quantity,
                      source=series.name, conversion=said, origin=origin, part=series.part, label=series.label,
                      shift=series.shift)  # fmt: skip
    values = series.values if unit.factor == 1.0 else series.values * unit.factor
    said = "" if unit.factor == 1.0 else f"{unit.symbol} -> {unit.si}, x {unit.factor:.6g}"
    si = "" if unit.si == "1" else unit.si
    return Column(time=series.time, values=values, unit=si, joint=joint, quantity=quantity, source=series.name,
                  conversion=said, stated=True, origin=origin, part=series.part, label=series.label,
                  shift=series.shift)  # fmt: skip


def _without_repeats(path: Path, columns: list[Column], findings: list[Problem]) -> list[Column]:
    """One column a quantity: what was said wins over what the file names, and that over a guess; then the first."""
    rank = {"command line": 0, "map file": 0, "named in the file": 1}
    # A position that was told stands before the torque that a controller made of it.
    torques = [column.quantity == "reference_1" and column.unit in ("N m", "N") for column in columns]
    order = sorted(range(len(columns)), key=lambda i: (rank.get(columns[i].origin, 2), torques[i], i))
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
