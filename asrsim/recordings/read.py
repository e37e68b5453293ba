"""Reads recordings of any format: determines each column's quantity and unit, and checks its numbers."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from asrsim.document.file import DOCUMENTS, mistaken
from asrsim.errors import Problem, RecordingError, did_you_mean, listed
from asrsim.plain import one_or_more
from asrsim.recordings.data import Column, Content, RawSeries, Recording
from asrsim.recordings.formats import content_of
from asrsim.recordings.matching import matching_name
from asrsim.recordings.names import KNOWN, Meaning, find_raw, joint_of, meaning_of, stated_unit
from asrsim.recordings.reading import ColumnMap, Reading, is_document, load_reading, resolve_reading
from asrsim.recordings.suspicions import condense, suspicions
from asrsim.recordings.times import series_of
from asrsim.recordings.units import Unit, find_unit, fits

LARGEST = 1e30
"""Largest magnitude of a measured value, SI units; squares and slopes of larger values would overflow."""
_TURNS = 20.0
"""Whole numbers above this magnitude are encoder counts or degrees, not angles in rad."""
ORIGINS = ("command line", "", "named in the file", "by its name")
"""Sources of a column's meaning, the strongest first; "" stands for the name of a document."""


def read_recording(
    path: str | PathLike[str],
    *,
    mapping: Mapping[str, str] | Sequence[str] | Path | None = None,
    joints: Sequence[str] | None = None,
    rate: float | None = None,
) -> Recording:
    """Recording of an experiment, read from a file.

    Args:
        path: A file of any format in `asrsim.recordings.READERS`, or a reading document whose key `file` names the recording.
        mapping: Meanings of columns: items `COLUMN=JOINT.QUANTITY [unit]`, `COLUMN=time [ms]` or `COLUMN=ignore`, or a mapping
            from column to meaning, or a reading document in place of `lab.csv.yaml`. Items take precedence over documents.
        joints: Joints of the simulation, which numbers in the names of columns refer to.
        rate: Sampling rate, Hz; evenly spaced times from 0 replace the file's time.

    Returns:
        The recording in SI units with all findings.

    Raises:
        RecordingError: With what was found and what was expected.
    """
    path, joints = Path(path), None if joints is None else one_or_more(joints)
    if is_document(str(path)) and mapping is None:
        with suppress(RecordingError):  # a recording may have the file ending of a document
            described = load_reading(path).file
            path, mapping = (path, None) if described is None else (path.parent / described, path)
    return read_series(path, resolve_reading(mapping, path, rate), joints)[2]


def read_series(
    path: Path, reading: Reading, joints: Sequence[str] | None
) -> tuple[Content, list[RawSeries], Recording]:  # fmt: skip
    """Content of the file, its series at strictly increasing times, and the recording."""
    findings: list[Problem] = []
    series: list[RawSeries] = []
    try:
        content = content_of(path, reading)
        findings += content.findings
        series, epoch = series_of(content, reading, findings)
        recording = _recording(path, content, series, reading, joints, findings=findings, epoch=epoch)
    except RecordingError as error:
        # A file that cannot be read may be another kind of document.
        unread = not series and path.suffix.lower() in (*DOCUMENTS, ".urdf", ".xacro")
        other = mistaken(path, "recording") if unread else None
        problems = [other] if other is not None else [replace(one, file=one.file or path) for one in error.problems]
        raise RecordingError(problems) from None
    return content, series, recording


def _recording(
    path: Path, content: Content, series: Sequence[RawSeries], reading: Reading, joints: Sequence[str] | None, *,
    findings: list[Problem], epoch: float | None,
) -> Recording:  # fmt: skip
    """Recording made of the series. Raises RecordingError with all problems of the mapping."""
    series = _windowed(series, reading)
    explicit = _explicit(series, reading, joints)
    repeated = {_first_of(one.name) for one in series if _first_of(one.name) != one.name}
    with np.errstate(over="ignore", invalid="ignore"):
        columns = [_column(one, explicit.get(i), reading, joints, repeated) for i, one in enumerate(series)]
    columns = [_measured(column, findings) for column in _without_repeats(columns, findings)]
    findings += [*suspicions(columns, series), *_questions(path, columns)]
    times = {id(column.time): len(column.time) for column in columns if column.quantity}
    if len(times) > 1:
        message = f"its columns have different times, with {listed(sorted({*times.values()}), 6)} samples; all are kept"
        findings.append(Problem(message, code="several-times"))
    return Recording(
        path=path, format=content.format, time=max(columns, key=lambda column: len(column.time)).time, epoch=epoch,
        channels={column.source: column for column in columns}, reading=reading.origin,
        findings=tuple(replace(one, file=one.file or path) for one in condense(findings)),
    )  # fmt: skip


def _first_of(name: str) -> str:
    """Name without its repetition number: q for q#2."""
    return re.sub(r"#\d+$", "", name)


def _windowed(series: Sequence[RawSeries], reading: Reading) -> Sequence[RawSeries]:
    """Series cut to the window. Raises RecordingError where no samples are left."""
    if reading.window is None:
        return series
    inside = {id(one.time): (one.time >= reading.start) & (one.time <= reading.end) for one in series}
    times = {id(one.time): one.time[inside[id(one.time)]] for one in series}
    kept = [replace(one, time=times[id(one.time)], values=one.values[inside[id(one.time)]])
            for one in series if len(times[id(one.time)]) > 1]  # fmt: skip
    if not kept:
        start, end = min(one.time[0] for one in series), max(one.time[-1] for one in series)
        message = f"has no samples from {reading.start:g} to {reading.end:g} s; the recording lasts from {start:g} to {end:g} s"
        raise RecordingError(message, key="window", code="no-overlap")
    return kept


def _explicit(series: Sequence[RawSeries], reading: Reading, joints: Sequence[str] | None) -> dict[int, ColumnMap]:
    """Mappings by index of the series. Raises RecordingError for unknown columns, unknown joints and unfitting units.

    joints: joints of the simulation. Documents may name other joints, as they may describe a larger robot.
    """
    names = [one.name for one in series]
    found: dict[int, ColumnMap] = {}
    problems: list[Problem] = []
    for one in reading.maps:
        index = find_raw(one.column, [one.column for one in series])
        if index is None:
            message, hint = f"the file has no such column; it is named by {one.origin}", did_you_mean(one.column, names)
            problems.append(Problem(message, key=one.column, choices=tuple(names[:20]), hint=hint, code="no-such-column"))
        elif one.quantity is not None and not fits((unit := _unit(series[index], one)).si, KNOWN[one.quantity].unit):
            message = f"is in {unit.symbol}, which is no unit of {one.quantity} ({KNOWN[one.quantity].unit})"
            hint = "Give the unit of its numbers: --map COLUMN=JOINT.QUANTITY [unit]"
            problems.append(Problem(message, key=one.column, hint=hint, code="wrong-unit"))
        elif joints and one.joint and one.origin == "command line" and matching_name(one.joint, joints) is None:
            message, hint = f"the simulation has no joint '{one.joint}'", did_you_mean(one.joint, tuple(joints))
            problems.append(Problem(message, key=one.column, choices=tuple(joints[:20]), hint=hint, code="no-such-joint"))
        else:
            found[index] = one
    if problems:
        raise RecordingError(problems)
    return found


def _unit(series: RawSeries, one: ColumnMap | None) -> Unit:
    """Unit stated by the mapping or the file; an empty unit where neither states it."""
    stated = None if one is None else one.unit
    return stated or stated_unit(series.name, series.column.unit) or Unit("", "", 1.0)


def _column(
    series: RawSeries, one: ColumnMap | None, reading: Reading, joints: Sequence[str] | None, repeated: Collection[str]
) -> Column:
    """Column in SI units, by its mapping, or else by the file or the column's name."""
    if one is not None:
        return in_si(series, one)
    if reading.columns is not None:
        return in_si(series, None, f"not used: missing in {reading.origin.name if reading.origin else 'the document'}")
    meaning = _meaning(series, joints)
    if _first_of(series.name) in repeated and (meaning.quantity or meaning.asked):
        meaning = replace(meaning, reason="several columns have its name", asked=True)
    if meaning.quantity is None or meaning.asked:
        column = in_si(series, None, f"{'asked' if meaning.asked else 'not used'}: {meaning.reason}")
        return replace(column, joint=meaning.joint)
    origin = ORIGINS[2 if series.column.quantity else 3]
    return in_si(series, ColumnMap(column=series.name, joint=meaning.joint, quantity=meaning.quantity, origin=origin))


def _meaning(series: RawSeries, joints: Sequence[str] | None) -> Meaning:
    """Joint and quantity that the file states for a column, or else that the column's name implies."""
    column, unit = series.column, stated_unit(series.name, series.column.unit)
    if column.quantity is not None:
        place = re.search(r"\[(\d+)\]$", column.name)
        joint, doubt = (column.joint, "") if column.joint else joint_of(int(place[1]) if place else None, joints, indexed=True)
        return Meaning(joint=joint, quantity=column.quantity, reason=doubt, asked=bool(doubt))
    own = column.joint is not None  # the file states the joint, so the array index is not a joint number
    name = re.sub(r"(?:\[[^\]]*\]|(?<=[a-z])\d+)$", "", column.name) if own else column.name
    found = meaning_of(name, unit, [str(column.joint)] if own else joints)
    if own:
        found = replace(found, joint=column.joint)
    if found.quantity is None or unit is not None:
        return found
    doubt = f"its unit [{column.unit}] is unknown" if column.unit and find_unit(column.unit) is None else ""
    values = series.values[np.isfinite(series.values)]
    angle = KNOWN[found.quantity].unit == "rad" or found.quantity == "reference_1"
    if angle and len(values) > 1 and np.max(np.abs(values)) > _TURNS and np.all(values == np.round(values)):
        doubt = f"its whole numbers up to {np.max(np.abs(values)):g} look like encoder counts or degrees, not rad"
    return replace(found, reason=f"its name means {found.quantity}, but {doubt}", asked=True) if doubt else found


def in_si(series: RawSeries, one: ColumnMap | None, origin: str = "") -> Column:
    """Column in SI units, converted by its mapping or else by the unit in its header. Its `conversion` lists the steps."""
    unit = _unit(series, one)
    one = one or ColumnMap(column=series.name, origin=origin)
    quantity = KNOWN[one.quantity].unit if one.quantity is not None else ""
    stated = bool(unit.symbol)
    said = [f"{unit.symbol} -> {unit.si}, x {unit.factor:.6g}"] if unit.factor != 1.0 else []
    # The unit of a reference depends on the mode.
    assumed = "SI" if one.quantity in ("reference_1", "reference_2") else quantity
    said += [f"{assumed} assumed"] if assumed and not stated and not one.origin.startswith("named") else []
    values = series.values * unit.factor * one.scale
    said += [] if one.scale == 1.0 else [f"x {one.scale:g}"]
    if one.unwrapped:
        good = np.isfinite(values)
        values[good] = np.unwrap(values[good])
        said.append("unwrapped")
    said += [f"{one.offset:+g}"] if one.offset else []
    reason = one.origin if one.quantity or origin else f"not used: {one.origin}"
    return Column(
        time=series.time, values=values + one.offset, unit="" if unit.si == "1" else unit.si or quantity,
        joint=one.joint, quantity=one.quantity, source=series.name, conversion="; ".join(said), stated=stated, origin=reason,
    )  # fmt: skip


def _measured(column: Column, findings: list[Problem]) -> Column:
    """Column in which values above `LARGEST`, which no sensor measures, are replaced by NaN."""
    beyond = np.abs(column.values) > LARGEST
    if not beyond.any():
        return column
    message = f"{int(beyond.sum())} of {len(beyond)} samples are above {LARGEST:g} or infinite; they are read as missing"
    findings.append(Problem(message, key=column.source, code="no-measurement"))
    return replace(column, values=np.where(beyond, np.nan, column.values))


def _without_repeats(columns: list[Column], findings: list[Problem]) -> list[Column]:
    """Columns of which at most one has each joint and quantity.

    The strongest source in `ORIGINS` wins, then a commanded position over the torque of its controller, then the first column.
    Raises RecordingError where the user maps two columns to one quantity.
    """

    def rank(column: Column) -> tuple[int, bool]:
        origin = ORIGINS.index(column.origin) if column.origin in ORIGINS else 1
        return origin, column.quantity == "reference_1" and column.unit in ("N m", "N")

    owner: dict[tuple[str | None, str], Column] = {}
    problems: list[Problem] = []
    result = {column.source: column for column in columns}
    for column in sorted(columns, key=rank):
        if column.quantity is None or (first := owner.setdefault((column.joint, column.quantity), column)) is column:
            continue
        message = f"is a second column for {column.meaning}, beside '{first.source}'"
        if rank(column)[0] == rank(first)[0] < 2:
            problems.append(Problem(message, key=column.source, code="mapped-twice"))
        elif rank(column)[0] == rank(first)[0]:
            hint = f"To use this column instead: --map '{column.source}={column.meaning}'"
            findings.append(Problem(f"{message}, which is used", key=column.source, code="second-column", hint=hint))
        origin = f"not used: {column.meaning} is '{first.source}'"
        result[column.source] = replace(column, joint=None, quantity=None, origin=origin)
    if problems:
        raise RecordingError(problems)
    return list(result.values())


def _questions(path: Path, columns: Sequence[Column]) -> list[Problem]:
    """Questions about ambiguous columns, each with the option that answers it."""
    asked = [column for column in columns if column.question]
    propose = f"`asrsim init --experiment {path.name}` writes a document with all questions, for you to complete"
    if asked:
        first = asked[0]
        message = f"not used, since {first.question}" + (" (and similar)" if len(asked) > 1 else "")
        hint = f"If it is a quantity of a joint: --map '{first.source}={first.joint or 'JOINT'}.QUANTITY [unit]'; {propose}"
        return [Problem(message, key=listed([column.source for column in asked], 6), code="asked", hint=hint)]
    if any(column.quantity for column in columns):
        return []
    message = f"no column's name means a quantity of a joint; columns: {listed([column.source for column in columns], 20)}"
    hint = f"State the meaning of a column with --map COLUMN=JOINT.QUANTITY [unit]; {propose}"
    return [Problem(message, code="nothing-mapped", hint=hint)]
