"""From raw series to columns: of which joint and quantity each is, by what was mapped, named in the file, or guessed."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asrsim.errors import Problem
from asrsim.quantities import DERIVED, QUANTITIES
from asrsim.recordings.adjust import scaled
from asrsim.recordings.data import Column, Raw, RawSeries
from asrsim.recordings.mapping import ColumnMap
from asrsim.recordings.names import Guess, guess, joint_numbers, stated_unit, theta_is_motor, tokens_of
from asrsim.recordings.numbering import one_behind, settled, unclear, zero_based
from asrsim.recordings.units import Unit, find_unit, split_header, unknown_unit

KNOWN = {**QUANTITIES, **DERIVED}
"""Every quantity that a column may be of, by name."""
_TURNS = 20.0
"""Whole numbers beyond it are no angles in rad: counts of an encoder, or degrees."""
_VENDORS = (
    (re.compile(r"(?i)(?:present|goal)[ _]?(?:position|velocity)"), "steps of a Dynamixel, or degrees"),
    (re.compile(r"(?i)(?:pos|vel)_estimate"), "turns (ODrive)"),
    (re.compile(r"\bA[IS]Pos|\bAxisPos_"), "degrees (KUKA)"),
    (re.compile(r"(?i)(?:position|velocity) (?:actual|demand) value"), "increments (CiA 402)"),
)
"""Names that programs of vendors give by themselves -> what their numbers are, seldom rad."""
_IN_DEGREES = re.compile(r"(?im)^\s*indegrees\s*=\s*yes\s*$")
"""The line by which OpenSim says it."""


@dataclass(frozen=True, kw_only=True)
class _Reading:
    """How the names of a file are understood together."""

    known: tuple[str, ...]
    """Joints: those given, else those that the file names."""
    meanings: Mapping[int, Guess]
    """Column -> what its name means, of those neither mapped nor named."""
    shifted: AbstractSet[int]
    """Columns whose numbers count joints from 0."""
    by_words: bool
    """Words beside the quantity name joints."""
    unclear: AbstractSet[int] = frozenset()
    """Columns whose numbers may mean one joint as well as another."""

    def joint_of(self, index: int, series: RawSeries) -> str | None:
        """The joint of a column whose quantity was guessed."""
        meaning = self.meanings[index]
        if index in self.unclear:
            return None
        words = meaning.words if self.by_words else ()
        return series.joint or meaning.joint or _joint(meaning.number, self.known, words, zero=index in self.shifted)


def columns_of(
    path: Path, raw: Raw, explicit: Mapping[int, ColumnMap], joints: Sequence[str] | None, findings: list[Problem]
) -> list[Column]:
    """A column for each series, in SI units; what is unclear is not used, and said. explicit: index of a series -> its map."""
    reading = _read_names(path, raw, explicit, joints, findings)
    columns: list[Column] = []
    homeless: list[str] = []
    doubts: dict[str, list[str]] = {}
    for index, series in enumerate(raw.series):
        unit = stated_unit(series.name, series.unit)
        one = explicit.get(index)
        quantity = one.quantity if one is not None else reading.meanings[index].quantity if index in reading.meanings else None
        unit = unit or _of_angles(raw.remarks, series.name, quantity)
        if one is not None:
            columns.append(_mapped(series, unit, one))
        elif series.quantity is not None:
            columns.append(_named(series, unit, reading.known))
        else:
            columns.append(_guessed(index, series, unit, reading, homeless, doubts))
    findings += [
        Problem(f"not used, since {doubt}", file=path, key=", ".join(names[:6]), code="unclear-unit",
                hint=f"State the unit: --map '{names[0]}=JOINT.QUANTITY [unit]'")
        for doubt, names in doubts.items()
    ]  # fmt: skip
    if homeless:
        findings.append(
            Problem(f"which joint these columns are of is unclear: {', '.join(homeless)}", file=path, choices=reading.known,
                    hint="Say it with --map COLUMN=JOINT.QUANTITY", code="unclear-joint")
        )  # fmt: skip
    return columns


def _read_names(
    path: Path, raw: Raw, explicit: Mapping[int, ColumnMap], joints: Sequence[str] | None, findings: list[Problem]
) -> _Reading:
    # The second "angle" of a file is angle#2, and no joint 2.
    plain = [_plain_name(split_header(re.sub(r"#\d+$", "", series.name))[0]) for series in raw.series]
    known = tuple(joints) if joints is not None else _spelled(raw, plain)
    behind = one_behind(plain, known)
    if behind:
        findings.append(
            Problem(f"its joints count from 0: {known[0].removesuffix('1')}0 is {known[0]}", file=path, code="joints-from-zero",
                    hint="Say otherwise with --map COLUMN=JOINT.QUANTITY")
        )  # fmt: skip
    counted = joint_numbers(plain)
    said = [[str(one.quantity)] for one in explicit.values()]
    motors = theta_is_motor([*map(tokens_of, plain), *said])
    meanings = {
        index: guess(plain[index], stated_unit(series.name, series.unit),
                     joints=() if behind else known, counted=counted, theta_is_motor=motors)
        for index, series in enumerate(raw.series)
        if index not in explicit and series.quantity is None
    }  # fmt: skip
    meanings = settled(meanings, () if behind else known)
    places = [int(m[1]) for series in raw.series if series.quantity and (m := re.search(r"(\d+)\]?$", series.name))]
    numbered = {i: (plain[i], m.number) for i, m in meanings.items() if m.quantity and m.number is not None}
    shifted = zero_based(numbered, len(known), zero=0 in counted or 0 in places)
    # Words beside the quantity name joints if they tell columns apart: hip_pos and knee_pos, but not filtered_pos alone.
    words = {m.words for m in meanings.values() if m.quantity and m.number is None and m.joint is None and m.words}
    return _Reading(
        known=known, meanings=meanings, shifted=shifted, by_words=len(words) > 1 or (bool(words) and bool(known)),
        unclear=unclear(meanings, plain, known),
    )  # fmt: skip


def _spelled(raw: Raw, plain: Sequence[str]) -> tuple[str, ...]:
    """Joints that the file names: elbow.link_position and the like say whose they are."""
    found = [(series.joint or name.rpartition(".")[0]) for series, name in zip(raw.series, plain, strict=True)
             if series.joint is not None or ("." in name and name.rpartition(".")[2] in KNOWN)]  # fmt: skip
    return tuple(dict.fromkeys(found))


def _mapped(series: RawSeries, unit: Unit | None, one: ColumnMap) -> Column:
    if one.role == "ignore":
        return _column(series, unit, None, None, f"not used: {one.origin}")
    return scaled(_column(series, one.unit or unit, one.joint, one.quantity, one.origin), one)


def _named(series: RawSeries, unit: Unit | None, known: Sequence[str]) -> Column:
    """Of a series whose quantity the file names, and perhaps its joint."""
    joint = series.joint
    if joint is None:
        number = next((int(word) for word in reversed(tokens_of(series.name)) if word.isdecimal()), None)
        joint = known[number] if number is not None and number < len(known) else None
    if joint is None:
        return _column(series, unit, None, None, "not used: no joint named")
    return _column(series, unit, joint, series.quantity, "named in the file")


def _guessed(
    index: int, series: RawSeries, unit: Unit | None, reading: _Reading, homeless: list[str], doubts: dict[str, list[str]]
) -> Column:
    """Of a series by its name; what is unclear about it is added to `homeless` or `doubts`."""
    meaning = reading.meanings[index]
    if meaning.quantity is None:
        return _column(series, unit, series.joint, None, f"not used: {meaning.reason}")
    if doubt := _doubt(series, unit, meaning.quantity):
        doubts.setdefault(doubt, []).append(series.name)
        return _column(series, unit, None, None, f"not used: looks like {meaning.quantity}, but {doubt}")
    joint = reading.joint_of(index, series)
    if joint is None:
        homeless.append(series.name)
        return _column(series, unit, None, None, "not used: which joint it is of is unclear")
    return _column(series, unit, joint, meaning.quantity, f"guessed: {meaning.reason}")


def _of_angles(remarks: str, name: str, quantity: str | None) -> Unit | None:
    """The unit of an angle or its rate in a file of OpenSim, which says once whether all are in degrees."""
    unit = KNOWN[quantity].unit if quantity is not None and unknown_unit(name) is None else ""
    if unit not in ("rad", "rad/s") or _IN_DEGREES.search(remarks) is None:
        return None
    return find_unit(unit.replace("rad", "deg"))


def _doubt(series: RawSeries, unit: Unit | None, quantity: str) -> str:
    """Why the numbers under a guessed name are hardly in SI; "" without doubt."""
    if unit is not None:
        return ""
    if (stated := unknown_unit(series.name)) is not None:
        return f"its unit [{stated}] is not known"
    if (usual := next((what for pattern, what in _VENDORS if pattern.search(series.name)), None)) is not None:
        return f"no unit is stated, and what writes such names counts {usual}"
    values = series.values[np.isfinite(series.values)]
    angle = KNOWN[quantity].unit == "rad" or quantity == "reference_1"
    if angle and len(values) > 1 and np.max(np.abs(values)) > _TURNS and np.all(values == np.round(values)):
        return f"its whole numbers up to {np.max(np.abs(values)):g} look like counts or degrees, not rad"
    return ""


def _plain_name(name: str) -> str:
    """Without the field of a message that holds nothing else, and the first port of a block of Simulink or dSPACE."""
    return re.sub(r"/data$|/Out1$|(?<=\w):1$", "", name)


def _joint(number: int | None, known: Sequence[str], words: Sequence[str], *, zero: bool) -> str | None:
    """The joint of a number, which may count from 0: of that ending, else by its place; of words in its name; without either
    the only joint."""
    if words:
        if not known and number is None:
            return "_".join(words)
        fitting = [joint for joint in known if {*words, *([] if number is None else [str(number)])} <= set(tokens_of(joint))]
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
    expected = KNOWN[quantity].unit if quantity is not None else ""
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
