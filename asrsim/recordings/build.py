"""From series to a recording: what each column is, its unit, and what is odd about its numbers."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from asrsim.errors import Problem, RecordingError, did_you_mean, listed
from asrsim.recordings.data import Column, RawSeries, Recording
from asrsim.recordings.matching import matching_name
from asrsim.recordings.names import KNOWN, Meaning, find_raw, joint_of, meaning_of, stated_unit
from asrsim.recordings.reading import ColumnMap, Reading
from asrsim.recordings.suspicions import condense, suspicions
from asrsim.recordings.units import Unit, find_unit, fits, unknown_unit

LARGEST = 1e30
"""SI units: what is beyond it was not measured, and its squares and slopes leave the range of numbers."""
_NAMED = 12
"""Columns that an error names."""
_TURNS = 20.0
"""Whole numbers beyond it are no angles in rad: counts of an encoder, or degrees."""
BY_NAME = "by its name"
"""Origin of a column whose name says what it is."""


def build(
    path: Path, form: str, series: Sequence[RawSeries], reading: Reading, joints: Sequence[str] | None, *,
    findings: list[Problem], epoch: float | None, topics: Sequence[str] = (),
) -> Recording:  # fmt: skip
    """The recording; raises RecordingError with all problems of the mapping."""
    series = _windowed(path, series, reading)
    explicit = _explicit(path, series, reading, joints, topics)
    repeated = {re.sub(r"#\d+$", "", one.name) for one in series if "#" in one.name}
    with np.errstate(over="ignore", invalid="ignore"):
        columns = [_column(one, explicit.get(i), reading, joints, repeated) for i, one in enumerate(series)]
    columns = [_measured(column, findings) for column in _without_repeats(path, columns, findings)]
    findings += [*suspicions(columns, series), *_questions(path, columns)]
    mapped = [column for column in columns if column.quantity]
    if len({id(column.time) for column in mapped}) > 1:
        sizes = sorted({len(column.time) for column in mapped}, reverse=True)
        findings.append(
            Problem(f"its columns have times of their own, with {listed(sizes, 6)} samples; each is kept", code="several-times")
        )
    return Recording(
        path=path, format=form, time=max(columns, key=lambda column: len(column.time)).time, epoch=epoch,
        channels={column.source: column for column in columns}, reading=reading.origin,
        findings=tuple(replace(one, file=one.file or path) for one in condense(findings)),
    )  # fmt: skip


def _windowed(path: Path, series: Sequence[RawSeries], reading: Reading) -> list[RawSeries]:
    """The series within the window; raises RecordingError where nothing is left."""
    if reading.window is None:
        return list(series)
    times = {id(one.time): (one.time >= reading.start) & (one.time <= reading.end) for one in series}
    cut = {id(one.time): one.time[times[id(one.time)]] for one in series}
    kept = [replace(one, time=cut[id(one.time)], values=one.values[times[id(one.time)]])
            for one in series if len(cut[id(one.time)]) > 1]  # fmt: skip
    if not kept:
        start, end = min(one.time[0] for one in series), max(one.time[-1] for one in series)
        raise RecordingError(
            f"has no samples from {reading.start:g} to {reading.end:g} s; it lasts from {start:g} to {end:g} s", file=path,
            key="window", code="no-overlap",
        )  # fmt: skip
    return kept


def _explicit(
    path: Path, series: Sequence[RawSeries], reading: Reading, joints: Sequence[str] | None, topics: Sequence[str]
) -> dict[int, ColumnMap]:
    """Index of series -> what is stated of it. Raises RecordingError for columns, units and joints that there are not.

    joints: of the simulation. A document may serve a larger robot, and so name others.
    """
    names = [one.name for one in series]
    found: dict[int, ColumnMap] = {}
    problems: list[Problem] = []
    for one in reading.maps:
        parts = [i for i, name in enumerate(names) if name.startswith((f"{one.column}/", f"{one.column}."))]
        if one.quantity is None and (parts or one.column in topics) and one.column not in names:
            found |= dict.fromkeys(parts, one)
            continue
        index = find_raw(one.column, [one.column for one in series])
        if index is None:
            problems.append(
                Problem(f"there is no such column, named by {one.origin}", key=one.column, choices=_shown(names),
                        hint=did_you_mean(one.column, names), code="no-such-column")
            )  # fmt: skip
            continue
        unit = one.unit or stated_unit(series[index].name, series[index].column.unit)
        if one.quantity is not None and unit is not None and not fits(unit.si, KNOWN[one.quantity].unit):
            problems.append(
                Problem(f"is in {unit.symbol}, which cannot be a {one.quantity} ({KNOWN[one.quantity].unit})", key=one.column,
                        hint="Give the unit of its numbers: --map COLUMN=JOINT.QUANTITY [unit]", code="wrong-unit")
            )  # fmt: skip
        elif joints and one.joint and one.origin == "command line" and matching_name(one.joint, joints) is None:
            problems.append(
                Problem(f"the simulation has no joint '{one.joint}'", key=one.column, choices=_shown(joints),
                        hint=did_you_mean(one.joint, tuple(joints)), code="no-such-joint")
            )  # fmt: skip
        else:
            found[index] = one
    if problems:
        raise RecordingError([replace(problem, file=path) for problem in problems])
    return found


def _shown(names: Sequence[str]) -> tuple[str, ...]:
    """Names for a message: of very many the first."""
    return (*names[:_NAMED], f"and {len(names) - _NAMED} more") if len(names) > _NAMED + 1 else tuple(names)


def _column(
    series: RawSeries, one: ColumnMap | None, reading: Reading, joints: Sequence[str] | None, repeated: Collection[str]
) -> Column:
    """The column in SI units: as it is stated, else by what the file or its name says for certain."""
    unit = stated_unit(series.name, series.column.unit)
    if one is not None:
        return in_si(series, one)
    if reading.columns is not None:
        return _in_si(series, unit, None, None, f"not used: not in {reading.origin.name if reading.origin else 'the document'}")
    meaning = _meaning(series, unit, joints)
    if re.sub(r"#\d+$", "", series.name) in repeated and (meaning.quantity or meaning.asked):
        meaning = replace(meaning, reason="several columns have its name", asked=True)
    if meaning.quantity is None or meaning.asked:
        word = "asked" if meaning.asked else "not used"
        return _in_si(series, unit, meaning.joint, None, f"{word}: {meaning.reason}")
    origin = "named in the file" if series.column.quantity else BY_NAME
    return _in_si(series, unit, meaning.joint, meaning.quantity, origin)


def in_si(series: RawSeries, one: ColumnMap | None) -> Column:
    """A column in SI units by what is stated of it, else by the unit in its header."""
    unit = stated_unit(series.name, series.column.unit)
    if one is None:
        return _in_si(series, unit, None, None, "")
    origin = one.origin if one.quantity else f"not used: {one.origin}"
    return _scaled(_in_si(series, one.unit or unit, one.joint, one.quantity, origin), one)


def _meaning(series: RawSeries, unit: Unit | None, joints: Sequence[str] | None) -> Meaning:
    column = series.column
    if column.quantity is not None:
        place = re.search(r"\[(\d+)\]$", column.name)
        joint, doubt = (column.joint, "") if column.joint else joint_of(int(place[1]) if place else None, joints, indexed=True)
        return Meaning(joint=joint, quantity=column.quantity, reason=doubt, asked=bool(doubt))
    own = column.joint is not None  # then the place in its array counts no joints
    name = re.sub(r"(?:\[\d+\]|(?<=[a-z])\d+)$", "", column.name) if own else column.name
    found = meaning_of(name, unit, [str(column.joint)] if own else joints)
    if found.quantity is None:
        return replace(found, joint=found.joint or column.joint)
    doubt = "" if unit is not None else _doubt(series, found.quantity)
    if column.joint is not None:
        found = replace(found, joint=column.joint)
    return replace(found, reason=f"its name says {found.quantity}, but {doubt}", asked=True) if doubt else found


def _doubt(series: RawSeries, quantity: str) -> str:
    """Why numbers without a unit that is known are hardly in SI; "" without doubt."""
    stated = series.column.unit or unknown_unit(series.name)
    if stated and find_unit(stated) is None:
        return f"its unit [{stated}] is not known"
    values = series.values[np.isfinite(series.values)]
    angle = KNOWN[quantity].unit == "rad" or quantity == "reference_1"
    if angle and len(values) > 1 and np.max(np.abs(values)) > _TURNS and np.all(values == np.round(values)):
        return f"its whole numbers up to {np.max(np.abs(values)):g} look like counts or degrees, not rad"
    return ""


def _in_si(series: RawSeries, unit: Unit | None, joint: str | None, quantity: str | None, origin: str) -> Column:
    """The column in SI units, its conversion in words."""
    si = KNOWN[quantity].unit if quantity is not None else ""
    values, said = series.values, f"{si} assumed" if si and not origin.startswith("named") else ""
    if unit is not None:
        values = values if unit.factor == 1.0 else values * unit.factor
        said = "" if unit.factor == 1.0 else f"{unit.symbol} -> {unit.si}, x {unit.factor:.6g}"
        si = "" if unit.si == "1" else unit.si
    return Column(time=series.time, values=values, unit=si, joint=joint, quantity=quantity, source=series.name,
                  conversion=said, stated=unit is not None, origin=origin)  # fmt: skip


def _scaled(column: Column, one: ColumnMap) -> Column:
    """With the mapping's own factor and offset."""
    values, said = column.values * one.scale, [] if one.scale == 1.0 else [f"x {one.scale:g}"]
    good = np.isfinite(values)
    if one.unwrapped:
        values = values.copy()
        values[good] = np.unwrap(values[good])
        said.append("unwrapped")
    zero = 0.0
    if one.zero and good.any():
        zero = float(values[good][0] if one.zero == "start" else np.mean(values[good]))
        said.append(f"- {zero:.6g} (its {one.zero})")
    if one.offset:
        said.append(f"{'+' if one.offset > 0 else '-'} {abs(one.offset):g}")
    if not said:
        return column
    conversion = "; ".join([*([column.conversion] if column.conversion else []), " ".join(said)])
    return replace(column, values=values - zero + one.offset, conversion=conversion)


def _measured(column: Column, findings: list[Problem]) -> Column:
    """Without numbers that cannot have been measured: their squares and slopes leave the range of numbers."""
    beyond = np.abs(column.values) > LARGEST
    if not beyond.any():
        return column
    message = f"{int(beyond.sum())} of {len(beyond)} samples are beyond {LARGEST:g}, or infinite: read as no number"
    findings.append(Problem(message, key=column.source, code="no-measurement"))
    return replace(column, values=np.where(beyond, np.nan, column.values))


def _without_repeats(path: Path, columns: list[Column], findings: list[Problem]) -> list[Column]:
    """One column a quantity: what is stated wins over what the file names, and that over names; a position that is told over
    the torque that a controller makes of it; then the first."""

    def rank(column: Column) -> int:
        words = ("command line", "named in the file", BY_NAME)
        return next((2 * i for i, word in enumerate(words) if column.origin.startswith(word)), 1)

    torques = [column.quantity == "reference_1" and column.unit in ("N m", "N") for column in columns]
    order = sorted(range(len(columns)), key=lambda i: (rank(columns[i]), torques[i], i))
    owner: dict[tuple[str | None, str], int] = {}
    problems: list[Problem] = []
    result = list(columns)
    for i in order:
        column = columns[i]
        if column.quantity is None:
            continue
        first = columns[owner.setdefault((column.joint, column.quantity), i)]
        if first is column:
            continue
        message = f"is a second {column.joint}.{column.quantity} beside '{first.source}'"
        if rank(column) == rank(first) < 2:
            problems.append(Problem(message, file=path, key=column.source, code="mapped-twice"))
        elif rank(column) == rank(first):
            findings.append(
                Problem(f"{message}, which is used", key=column.source, code="second-column",
                        hint=f"Choose with --map '{column.source}={column.joint}.{column.quantity}'")
            )  # fmt: skip
        result[i] = replace(
            column, joint=None, quantity=None, origin=f"not used: {column.joint}.{column.quantity} is '{first.source}'"
        )
    if problems:
        raise RecordingError(problems)
    return result


def _questions(path: Path, columns: Sequence[Column]) -> list[Problem]:
    """What is asked about columns that are not used, with the line that answers it."""
    asked = [column for column in columns if column.origin.startswith("asked")]
    propose = f"`asrsim init --experiment {path.name}` writes all of them down for you to complete"
    if asked:
        first = asked[0]
        joint = first.joint or "JOINT"
        return [
            Problem(f"not used, since {first.origin.partition(': ')[2]}" + (" (and the like)" if len(asked) > 1 else ""),
                    key=listed([column.source for column in asked], 6), code="asked",
                    hint=f"If it is a joint's: --map '{first.source}={joint}.QUANTITY [unit]'; {propose}")
        ]  # fmt: skip
    if any(column.quantity for column in columns):
        return []
    names = listed([column.source for column in columns], 20)
    return [
        Problem(f"no column is a joint's quantity by its name; found {names}", code="nothing-mapped",
                hint=f"Say what a column is with --map COLUMN=JOINT.QUANTITY [unit]; {propose}")
    ]  # fmt: skip
