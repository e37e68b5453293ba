"""Reads recordings of any format. Determines the quantity and unit of each column, and checks its numbers."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from os import PathLike
from pathlib import Path

import numpy as np

from asrsim.document.file import DOCUMENTS, mistaken
from asrsim.errors import Problem, RecordingError, did_you_mean, listed
from asrsim.plain import one_or_more
from asrsim.plugins import plugin_options
from asrsim.quantities import each_motor, unit_of
from asrsim.recordings.commands import command_unit
from asrsim.recordings.data import LARGEST, Column, Content, RawColumn, Recording
from asrsim.recordings.folders import require_one_recording
from asrsim.recordings.formats import READERS, content_of, with_reader_hint
from asrsim.recordings.matching import matching_name
from asrsim.recordings.names import check_path, find_raw, meaning_of, stated_unit, within_joint
from asrsim.recordings.owners import find_joint, joint_of
from asrsim.recordings.reading import ColumnMap, Reading, is_document, load_reading, resolve_reading
from asrsim.recordings.suspicions import condense, suspicions
from asrsim.recordings.times import with_times
from asrsim.recordings.turns import turn_of, unwrapped
from asrsim.recordings.units import Unit, fits, split_header, unread_unit, unsure_units
from asrsim.recordings.words import UNIT_KINDS, DoubtError
from asrsim.samples import Array

_TURNS = 20.0
"""Whole numbers above this magnitude count as encoder counts or degrees, not as angles in rad."""
ORIGINS = ("command line", "", "named in the file", "by its name")
"""Sources of a column's meaning, in order of precedence. "" represents the name of a reading document."""


def read_recording(
    path: str | PathLike[str],
    *,
    mapping: Sequence[str] | Path | None = None,
    joints: Sequence[str] | None = None,
    rate: float | None = None,
) -> Recording:
    """Recording of an experiment, read from a file.

    Args:
        path: A file of any format in `asrsim.recordings.READERS`, or a reading document whose key `file` names the recording.
        mapping: Meanings of columns: items `COLUMN=JOINT.QUANTITY [unit]`, `COLUMN=time [ms]` or `COLUMN=ignore`, or the path
            of a reading document that replaces `lab.csv.yaml`. Items have precedence over the entries of documents.
        joints: Joints of the simulation. Numbers in the names of columns refer to them.
        rate: Sampling rate, Hz. If it is stated, evenly spaced times from 0 replace the file's time.

    Returns:
        The recording in SI units with all findings.

    Raises:
        RecordingError: The file cannot be read. The message states what was found and what was expected.
    """
    path, joints = Path(path), None if joints is None else one_or_more(joints)
    if is_document(str(path)) and mapping is None:
        with suppress(RecordingError):  # a recording may have the file ending of a document
            described = load_reading(path).file
            path, mapping = (path, None) if described is None else (path.parent / described, path)
    return read_tables(path, resolve_reading(mapping, path, rate), joints)[1]


@lru_cache(maxsize=4)
def read_cached(
    path: Path,
    _modified: tuple[int, int],
    *,
    mapping: tuple[str, ...] = (),
    joints: tuple[str, ...] | None = None,
    rate: float | None = None,
    in_seconds: bool = False,
) -> tuple[Content, Recording]:
    """Content and recording as in `read_tables`, from memory if they were read before.

    _modified: result of `asrsim.recordings.reading.modified` for the path; in_seconds: as in `Reading`. The other arguments are
    as in `read_recording`.
    """
    return read_tables(path, replace(resolve_reading(mapping, path, rate), in_seconds=in_seconds), joints)


def read_tables(path: Path, reading: Reading, joints: Sequence[str] | None = None) -> tuple[Content, Recording]:
    """Content of the file with times and all findings, and the recording from its tables. Raises RecordingError."""
    findings: list[Problem] = []
    content: Content | None = None
    try:
        findings += READERS.broken()
        content = content_of(path, reading)
        findings += content.findings
        content = with_times(content, reading, findings)
        content = _windowed(content, reading)
        recording = _recording(path, content, reading, joints, findings)
    except RecordingError as error:
        # If the file cannot be read, it may be a document of another kind.
        unread = content is None and path.suffix.lower() in (*DOCUMENTS, ".urdf", ".xacro")
        if unread and (other := mistaken(path, "recording")) is not None:
            raise RecordingError(other) from None
        # Also report columns of text: if no time was found, the time may be in such a column, in a format that is not a date.
        said = [*error.problems, *READERS.broken(), *(one for one in findings if one.code == "text-column")]
        said[0] = with_reader_hint(said[0], path)
        raise RecordingError(replace(one, file=one.file or path) for one in said) from None
    # Tables with the same clock have the same findings about it.
    found = tuple({str(one): replace(one, file=one.file or path) for one in findings}.values())
    return replace(content, findings=found), replace(recording, findings=tuple(condense(found)))


def _recording(
    path: Path, content: Content, reading: Reading, joints: Sequence[str] | None, findings: list[Problem]
) -> Recording:
    """Recording from the tables of a content. Raises RecordingError with all problems of the mapping."""
    raw = [column for table in content.tables for column in table.columns]
    times = [table.time for table in content.tables for _ in table.columns]
    meanings = _meanings(raw, _explicit(raw, reading, joints), reading, joints)
    with np.errstate(over="ignore", invalid="ignore"):
        columns = [in_si(column, time, meaning) for column, time, meaning in zip(raw, times, meanings, strict=True)]
    require_one_recording(raw, columns)
    columns = _without_repeats(columns, findings)
    findings += [
        *_unread_units(raw, columns),
        *suspicions(columns, [column.values for column in raw]),
        *_questions(path, columns, READERS.file_of(content.format)),
    ]
    return Recording(
        path=path,
        format=content.format,
        time=max(times, key=len),
        channels={column.source: column for column in columns},
    )


def _windowed(content: Content, reading: Reading) -> Content:
    """Content, cut to the time window of the reading. Raises RecordingError if no samples are left."""
    if reading.window is None:
        return content
    start, end = reading.window
    parts = [table.selected((table.time >= start) & (table.time <= end)) for table in content.tables]
    kept = tuple(table for table in parts if len(table.time) > 1)
    if not kept:
        first, last = min(table.time[0] for table in content.tables), max(table.time[-1] for table in content.tables)
        message = f"has no samples from {start:g} to {end:g} s; the recording lasts from {first:g} to {last:g} s"
        raise RecordingError(message, key="window", code="no-overlap")
    return replace(content, tables=kept)


def _explicit(raw: Sequence[RawColumn], reading: Reading, joints: Sequence[str] | None) -> dict[int, ColumnMap]:
    """Mappings of columns, by index of the column. Raises RecordingError for unknown columns, unknown joints, and units that do
    not fit.

    joints: joints of the simulation. Documents may name other joints, since they may describe a larger robot.
    """
    names = tuple(column.name for column in raw)
    found: dict[int, ColumnMap] = {}
    problems: list[Problem] = []
    for one in reading.maps:
        if (index := find_raw(one.column, raw)) is not None:
            # The last mapping of a column counts, so that items have precedence over the document. An item and the document may
            # name the same column differently, with its unit or by its number.
            found[index] = one
            continue
        message, hint = f"the file has no such column; it is named by {one.origin}", did_you_mean(one.column, names)
        problems.append(Problem(message, key=one.column, choices=names[:20], hint=hint, code="no-such-column"))
    for index, one in found.items():
        problem = Problem("", key=one.column, code="wrong-unit")
        if one.quantity is not None and one.unit is None and (choices := unsure_units(raw[index].header)):
            hint = f"State it: --map '{one.column}={one.joint}.{one.quantity} [{choices[0]}]'"
            problems.append(
                replace(problem, message="its unit may mean several units", choices=choices, hint=hint, code="wrong-unit")
            )
        elif one.quantity is not None and not fits((unit := _unit(raw[index], one)).si, unit_of(one.quantity)):
            message = f"is in {unit.symbol}, which is not a unit of {one.quantity} ({unit_of(one.quantity)})"
            hint = "Give the unit of its numbers: --map COLUMN=JOINT.QUANTITY [unit]"
            problems.append(replace(problem, message=message, hint=hint, code="wrong-unit"))
        elif joints and one.joint and one.origin == "command line" and matching_name(one.joint, joints) is None:
            message, hint = f"the simulation has no joint '{one.joint}'", did_you_mean(one.joint, tuple(joints))
            problems.append(replace(problem, message=message, choices=tuple(joints[:20]), hint=hint, code="no-such-joint"))
    if problems:
        raise RecordingError(problems)
    return found


def _unread_units(raw: Sequence[RawColumn], columns: Sequence[Column]) -> Iterator[Problem]:
    """Problems of mapped columns whose headers end with an unknown unit, while neither mapping nor factor states it.

    columns: columns in the order of `raw`.
    """
    by_name = {column.source: column for column in columns}
    for one in raw:
        column = by_name[one.name]
        unread = "" if one.joint is not None or column.stated or not column.given else unread_unit(one.header)
        if unread and column.quantity and column.read_as is not None and abs(column.read_as.scale) == 1.0:
            message = f"its header states '{unread}', which is not a known unit: the unit {column.unit or 'of SI'} is assumed"
            hint = f"State the unit, or a factor: --map '{one.name}={column.meaning} [unit]'"
            yield Problem(message, key=one.name, hint=hint, code="suspected-unit")


def _unit(raw: RawColumn, one: ColumnMap | None) -> Unit:
    """Unit stated by the mapping or the file; an empty unit if neither states it."""
    stated = None if one is None else one.unit
    return stated or stated_unit(raw.header) or Unit("", "", 1.0)


def _meanings(
    raw: Sequence[RawColumn], explicit: Mapping[int, ColumnMap], reading: Reading, joints: Sequence[str] | None
) -> Iterator[ColumnMap]:
    """Meaning of each column. A mapping has precedence; otherwise the file or the column's name states the meaning."""
    names = [re.sub(r"(#\d+)+$", "", column.header) for column in raw]
    uses = Counter((column.file, name) for column, name in zip(raw, names, strict=True))
    for i, (column, name) in enumerate(zip(raw, names, strict=True)):
        if i in explicit:
            yield explicit[i]
        elif reading.columns is not None:
            yield ColumnMap(origin=f"not used: not listed in {reading.document}")
        else:
            try:
                joint, quantity = _meaning(column, name, joints)
                first = re.sub(r"(?<![\[\d])\d+", "0", name, count=1)
                unnamed = joints and quantity and column.joint is None
                if unnamed and first != name and first in names:
                    # The file counts its joints from 0. Raise DoubtError unless the names of the robot's joints also do.
                    joint_of(0, joints, indexed=False)
                if unnamed and name.startswith("field.") and "0" in name and name.replace("0", "1", 1) in names:
                    raise DoubtError("the file has several joints, but does not name them")
                if quantity and uses[column.file, name] > 1:
                    raise DoubtError("several columns have its name")
            except DoubtError as doubt:
                owner = column.joint or find_joint(f"{split_header(name)[0]} {column.file}", joints or ())[0]
                yield ColumnMap(origin=f"asked: {doubt}", joint=owner, text=doubt.target)
                continue
            origin = ORIGINS[2 if column.quantity else 3] if quantity else "not used: its name states no quantity of a joint"
            yield ColumnMap(joint=joint, quantity=quantity, origin=origin)


def _meaning(raw: RawColumn, name: str, joints: Sequence[str] | None) -> tuple[str | None, str | None]:
    """Joint and quantity of a column. The file states them or, if it does not, the column's name implies them. Raises
    DoubtError.

    name: name of the column without the number that distinguishes equal names, such as `#2`.
    """
    unit = stated_unit(name)
    if choices := unsure_units(name):
        raise DoubtError(f"its unit may be {' or '.join(choices)}")
    check_path(name, raw.joint, joints)
    if raw.quantity is not None:
        place = re.search(r"\[(\d+)\]$", name)
        return raw.joint or joint_of(int(place[1]) if place else None, joints, indexed=True), raw.quantity
    if raw.joint is None:
        joint, quantity = meaning_of(name, unit, joints, raw.file)
    else:  # the file states the joint, so the array index is not a joint number
        name = re.sub(r"(?:\[[^\]]*\]|\(\d+\)|(?<=[a-z])\d+)$", "", name)
        joint, quantity = raw.joint, meaning_of(within_joint(name), unit, [raw.joint], raw.file)[1]
    if quantity is None or unit is not None:
        return joint, quantity
    values = raw.values[np.isfinite(raw.values)]
    angle = unit_of(quantity) == "rad" or quantity == "reference_1"
    if angle and len(values) > 1 and np.max(np.abs(values)) > _TURNS and np.all(values == np.round(values)):
        numbers = f"its whole numbers up to {np.max(np.abs(values)):g} look like encoder counts or degrees, not rad"
        raise DoubtError(f"its name means {quantity}, but {numbers}")
    return joint, quantity


def in_si(raw: RawColumn, time: Array, meaning: ColumnMap) -> Column:
    """Column in SI units. Its mapping and the unit in its header determine the conversion. `conversion` lists the steps of the
    conversion.

    Values above `LARGEST` become NaN, since no sensor measures them.
    """
    unit = _unit(raw, meaning)
    usual = "" if meaning.quantity is None else unit_of(meaning.quantity)
    commands = meaning.quantity in each_motor("reference_{}")
    # The unit of a reference depends on the operation mode, unless its name states the kind of the command.
    if commands:
        usual = command_unit(raw.name, meaning.joint) if meaning.scale == 1.0 else ""
    assumed = usual or ("SI" if commands else "")
    numbers, period = raw.values, meaning.period
    if meaning.unwrapped and period is None:
        period = turn_of(numbers[np.isfinite(numbers)], unit.factor, meaning.scale)
    if meaning.unwrapped and period is not None:
        numbers = unwrapped(numbers, period)
    steps = (
        (unit.factor != 1.0, f"{unit.symbol} -> {unit.si}, x {unit.factor:.6g}"),
        (assumed and not unit.symbol and not meaning.origin.startswith("named"), f"{assumed} assumed"),
        (meaning.scale != 1.0, f"x {meaning.scale:g}"),
        (period, f"unwrapped by {period:.6g}" if meaning.period else "unwrapped"),
        (meaning.offset, f"{meaning.offset:+g}"),
        (meaning.late, f"{-meaning.late:+g} s"),
    )
    values = numbers * unit.factor * meaning.scale
    values[np.abs(values) > LARGEST] = np.nan
    unused = not meaning.quantity and ":" not in meaning.origin
    return Column(
        time=time - meaning.late if meaning.late else time,
        values=values + meaning.offset,
        unit="" if unit.si == "1" and not commands else unit.si or usual,
        joint=meaning.joint,
        quantity=meaning.quantity,
        source=raw.name,
        conversion="; ".join(text for applies, text in steps if applies),
        stated=bool(unit.symbol),
        origin=f"not used: {meaning.origin}" if unused else meaning.origin,
        read_as=meaning,
    )


def _without_repeats(columns: list[Column], findings: list[Problem]) -> list[Column]:
    """Columns, of which only one is used for each joint and quantity: the first column whose source of the meaning has the
    highest precedence in `ORIGINS`.

    Raises RecordingError if the user maps two columns to the same quantity.
    """

    def rank(column: Column) -> int:
        return ORIGINS.index(column.origin) if column.origin in ORIGINS else 1

    def order(column: Column) -> tuple[int, bool, bool]:
        """Sort key. Of several commands of a joint, a position precedes the torque or current of an inner controller. A column
        with the joint's name precedes a column with the joint's number.
        """
        inner = column.quantity == "reference_1" and UNIT_KINDS.get(column.unit, "position") != "position"
        return rank(column), inner, column.joint is not None and find_joint(column.source, [column.joint])[0] is None

    owner: dict[tuple[str | None, str], Column] = {}
    problems: list[Problem] = []
    result = {column.source: column for column in columns}
    for column in sorted(columns, key=order):
        if column.quantity is None or (first := owner.setdefault((column.joint, column.quantity), column)) is column:
            continue
        message = f"is a second column for {column.meaning}, in addition to '{first.source}'"
        if rank(column) == rank(first) < 2:
            problems.append(Problem(message, key=column.source, code="mapped-twice"))
        elif rank(column) == rank(first):
            hint = f"To use this column: --map '{column.source}={column.meaning}'"
            findings.append(Problem(f"{message}, which is used", key=column.source, code="second-column", hint=hint))
        origin = f"not used: {column.meaning} is '{first.source}'"
        result[column.source] = replace(column, joint=None, quantity=None, origin=origin)
    if problems:
        raise RecordingError(problems)
    return list(result.values())


ASKED = ("asked", "nothing-mapped")
"""Codes of findings that are questions about columns."""


def _questions(path: Path, columns: Sequence[Column], plugin: str) -> list[Problem]:
    """Questions to the user about ambiguous columns. plugin: plugin file of the file's reader; "" for a reader of asrsim."""
    asked = [column for column in columns if column.question]
    commands = [column for column in asked if "command" in column.question]
    command = shlex.join(["asrsim", "init", "--experiment", path.name, *plugin_options([plugin] if plugin else [])])
    propose = f"`{command}` writes a document with all questions, for you to complete"
    if asked:
        first = (commands or asked)[0]
        reasons = dict.fromkeys(one.question for one in commands or asked[:1])
        message = f"not used, since {listed([*reasons], 4, '; ')}" + (" (and similar)" if len(asked) > len(reasons) else "")
        hint = f"If it is a quantity of a joint: --map '{first.source}={first.joint or 'JOINT'}.{first.target}'; {propose}"
        return [Problem(message, key=listed([column.source for column in asked], 6), code="asked", hint=hint)]
    if any(column.quantity for column in columns):
        return []
    message = f"no column's name states a quantity of a joint; columns: {listed([column.source for column in columns], 20)}"
    hint = f"State the meaning of a column with --map COLUMN=JOINT.QUANTITY [unit]; {propose}"
    return [Problem(message, code="nothing-mapped", hint=hint)]
