"""Options for reading a recording. They are from a document such as `lab.csv.yaml`, and from items of `--map`, which have
precedence.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from asrsim.document.block import block_of, declare
from asrsim.document.file import read_file
from asrsim.document.kinds import NUMBER, Choice, Either, Integer, ListOf, MapOf, Number, Text
from asrsim.errors import Details, InputError, Problem, RecordingError
from asrsim.plain import one_or_more
from asrsim.recordings.names import ALIASES, column_quantities
from asrsim.recordings.units import Unit, find_unit, parse_unit

if TYPE_CHECKING:
    from asrsim.recordings.data import Column

ENDING = ".yaml"
"""Ending that, appended to a recording's name, gives the name of its reading document."""
SEPARATORS = {"tab": "\t", ";": ";", ",": ",", "|": "|", "blanks": None}
"""Separator of cells for each word that a document may state. None: any number of blanks."""
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_TARGET = re.compile(
    rf"(?P<minus>-)?\s*(?:(?P<factor>{_NUMBER})\s*\*)?\s*"
    rf"(?:(?P<joint>[^\[\]*]+(?:\[[^\[\]]*\][^\[\]*\s]*)*)\.)?(?P<name>[^\W\d]\w*)(?:\s*\[(?P<unit>[^\[\]]*)\])?"
    rf"(?P<unwrapped>\s+unwrapped(?:\s+(?P<period>{_NUMBER}))?)?"
    rf"(?:\s+(?P<offset>[-+]\s*{_NUMBER}))?(?:\s+late\s+(?P<late>-?{_NUMBER}))?"
)
"""Pattern of a column's meaning, such as `-0.01*JOINT.QUANTITY [unit] unwrapped 4096 - 0.02 late 0.003`."""
_TIME = re.compile(r"time(?:\s*\[(?P<unit>[^\[\]]*)\])?")
"""Pattern of the meaning of a time column in an item of `--map`, such as `time [ms]`."""


@dataclass(frozen=True, kw_only=True)
class ColumnMap:
    """Meaning of a column: joint, quantity, unit and conversion."""

    column: str = ""
    """Header of the column, or its number counted from 1; "" if the column's name implies the meaning."""
    joint: str | None = None
    quantity: str | None = None
    """Quantity in the column; None: the column is not used."""
    unit: Unit | None = None
    """Unit that replaces the unit in the header; None: the unit in the header."""
    scale: float = 1.0
    """Factor of the numbers in addition to the factor of the unit, such as -1 for a reversed axis."""
    offset: float = 0.0
    """Offset that is added after scaling, in SI units."""
    unwrapped: bool = False
    """Whether jumps by whole turns, or by whole periods, are removed."""
    period: float | None = None
    """Number in the file after which the sensor restarts, such as 4096; None: a whole turn."""
    late: float = 0.0
    """Delay of the column's values behind the recording's clock, s. It is subtracted from their times."""
    origin: str = "command line"
    text: str = "ignore"
    """Text after `COLUMN=` in an item of `--map`. For a column about which the user is asked, it is only the part after the
    joint.
    """

    def corrected(self, *, gain: float = 1.0, offset: float = 0.0, late: float = 0.0) -> ColumnMap:
        """Meaning that gives the values gain * (values - offset), at times `late` s earlier."""
        moved = gain * (self.offset - offset)
        found = replace(self, scale=gain * self.scale, offset=moved, late=self.late + late)
        return replace(found, text=found._as_text())

    def _as_text(self) -> str:
        """Text that `parse_meaning` reads as this meaning."""
        parts = [
            {1.0: "", -1.0: "-"}.get(self.scale, f"{self.scale:.10g}*"),
            f"{self.joint}.{self.quantity}",
            f" [{self.unit.symbol}]" if self.unit else "",
            " unwrapped" if self.unwrapped else "",
            f" {self.period:.10g}" if self.unwrapped and self.period else "",
            f" {'-' if self.offset < 0.0 else '+'} {abs(self.offset):.10g}" if self.offset else "",
            f" late {self.late:.10g}" if self.late else "",
        ]
        return "".join(parts)


def item_of(
    column: Column, *, gain: float = 1.0, joint: str | None = None, unwrapped: bool = False, period: float | None = None
) -> str:
    """Item of `--map` that multiplies the values of a column by `gain`, or removes its jumps. It keeps the rest of its mapping.

    joint: joint of the robot; None: the joint of the column. unwrapped, period: as in `ColumnMap`.
    """
    read = replace(column.read_as or ColumnMap(quantity=column.quantity), joint=joint or column.joint)
    if unwrapped:
        read = replace(read, unwrapped=True, period=period)
    return f"{column.source}={read.corrected(gain=gain).text}"


@dataclass(frozen=True, kw_only=True)
class TimeKeys:
    """Column, unit and rate of the time."""

    column: str | tuple[str, ...] | None = declare(
        Either((ListOf(of=Text(text="name of a column"), minimum=1), Text(text="name of a column"))),
        doc="column of the time, by header or number from 1; a list of two columns that are added: seconds and nanoseconds, "
        "a date and a time of day; for messages `header` or `received`",
        default=None,
    )
    unit: str | None = declare(Text(text="unit of time"), doc="unit of the time", default=None, shown="the unit in the header")
    rate: float | None = declare(
        Number(above=0.0), doc="sampling rate; evenly spaced times from 0 replace the file's time", unit="Hz", default=None
    )

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns that contain the time, by header or by number in the file."""
        return () if self.column is None else one_or_more(self.column)

    @property
    def stated(self) -> Unit | None:
        """Stated unit of the time; None if no unit is stated."""
        return None if self.unit is None else find_unit(self.unit)

    def __post_init__(self) -> None:
        if self.unit is not None and (self.stated is None or self.stated.si != "s"):
            raise _error("unit", f"{self.unit} is not a unit of time", choices=("s", "ms", "us", "ns"))


TIME = block_of(TimeKeys, "mapping that describes the time", main="column")


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Options for reading a file. Options that are None are detected. If `columns` is stated, the names of columns have no
    meaning.
    """

    file: str | None = declare(Text(text="name of a file"), doc="the recording that this document describes", default=None)
    time: TimeKeys = declare(
        TIME, doc="column, unit and rate of the time", default=TimeKeys(), shown="the column whose name means time"
    )
    separator: str | None = declare(
        Choice(tuple(SEPARATORS)), doc="text: the separator of cells", default=None, shown="detected"
    )
    decimal: str | None = declare(Choice((".", ",")), doc="text: the decimal mark", default=None, shown="detected")
    encoding: str | None = declare(
        Text(), doc="text: the encoding, such as utf-8, latin-1, shift_jis", default=None, shown="detected"
    )
    header: int | None = declare(
        Integer(minimum=0),
        doc="text and sheets: line with the names of the columns, counted from 1; 0: the file has no names",
        default=None,
        shown="detected",
    )
    sheet: str | None = declare(
        Text(text="name of a sheet"), doc="workbooks: name of the sheet", default=None, shown="the first sheet with numbers"
    )
    joint: str | None = declare(
        Text(text="name of a column"),
        doc="text and sheets: column with the joint of each row, if the rows alternate between several joints",
        default=None,
        shown="none",
    )
    missing: float | None = declare(
        NUMBER, doc="number that marks a missing value, in the unit of the file, such as -9999", default=None, shown="none"
    )
    window: tuple[float, ...] | None = declare(
        ListOf(of=NUMBER, names=("start", "end")),
        doc="start and end of the part that is kept, on the recording's clock",
        unit="s",
        default=None,
    )
    columns: Mapping[str, str] | None = declare(
        MapOf(of=Text(text="JOINT.QUANTITY [unit]"), noun="column", star=False),
        key="map",
        doc="meaning of each column that is used: `JOINT.QUANTITY [unit]`",
        default=None,
        shown="by the columns' names",
    )
    given: tuple[ColumnMap, ...] = ()
    """Meanings of columns from the items of `--map`. They have precedence over `columns`."""
    maps: tuple[ColumnMap, ...] = field(default=(), init=False)
    """Meanings of columns, first from `columns` and then from `given`. If a column has two meanings, the last one counts."""
    in_seconds: bool = False
    """Whether a time without a unit is in s, as in scenarios. If false, the user is asked about the unit if the time step is
    implausible in s.
    """
    document: str = ""
    """Name of the reading document; "" if there is none."""

    def __post_init__(self) -> None:
        problems: list[Problem] = []
        if self.encoding is not None:
            try:
                "a".encode(self.encoding)
            except (LookupError, ValueError):
                problems.append(Problem("is not a known encoding", key="encoding", value=self.encoding, code="choice"))
        if self.window is not None and self.window[0] >= self.window[1]:
            problems.append(Problem("must be a start and a later end", key="window", value=self.window, code="range"))
        maps: list[ColumnMap] = []
        taken = {one.column for one in self.given}
        for column, text in (self.columns or {}).items():
            try:
                maps += [] if column in taken else [parse_meaning(column, text, self.document)]
            except RecordingError as error:
                problems += [replace(one, key="columns", message=f"{column}: {one.message}") for one in error.problems]
        if problems:
            raise RecordingError(problems)
        object.__setattr__(self, "maps", (*maps, *self.given))


READING = block_of(Reading, "reading")
"""Keys of the reading document."""


def reading_file(path: Path) -> Path | None:
    """Path of the reading document of a recording, in the same folder; None if it does not exist."""
    beside = path.with_name(path.name + ENDING)
    return beside if beside.is_file() else None


def modified(path: Path) -> tuple[int, int]:
    """Modification times of a recording and of its reading document, ns; 0 if a file does not exist. Caches use them to notice
    changes.
    """
    beside = reading_file(path)
    files = [path, *path.iterdir()] if path.is_dir() else [path]
    latest = max((file.stat().st_mtime_ns for file in files if file.exists()), default=0)
    return latest, beside.stat().st_mtime_ns if beside else 0


def load_reading(path: Path) -> Reading:
    """Reading options from a reading document. Raises RecordingError with all problems."""
    try:
        return replace(read_file(READING, path), document=path.name)
    except InputError as error:
        raise RecordingError(error.problems) from None


def resolve_reading(
    mapping: Sequence[str] | Path | None, path: Path, rate: float | None = None, *, beside: bool = True
) -> Reading:
    """Reading options from a document and from items of `--map`, which have precedence. The document is named in `mapping`, or
    it is the document of the recording. beside: whether to use the document of the recording.
    """
    items: Sequence[str | Path] = () if mapping is None else one_or_more(mapping)
    documents = [Path(item) for item in items if is_document(item)]
    document = documents[-1] if documents else reading_file(path) if beside else None
    reading = Reading() if document is None else load_reading(document)
    for text in (str(item) for item in items if not is_document(item)):
        reading = _with_item(reading, text)
    if rate is None:
        return reading
    if not (math.isfinite(rate) and rate > 0):
        raise RecordingError("the sampling rate must be positive", value=rate, code="bad-rate")
    return replace(reading, time=replace(reading.time, rate=rate))


def _with_item(reading: Reading, text: str) -> Reading:
    """Reading options with an additional item of `--map`. Raises RecordingError."""
    column, _, target = (part.strip() for part in text.rpartition("="))
    if not column or not target:
        raise _error(text, "is not COLUMN=JOINT.QUANTITY", hint="For example --map 'q1=joint_1.link_position [deg]'")
    if (time := _TIME.fullmatch(target)) is not None:
        return replace(reading, time=TimeKeys(column=column, unit=time["unit"]))
    return replace(reading, given=(*reading.given, parse_meaning(column, target)))


def is_document(item: str | Path) -> bool:
    """Whether an item of `--map` is the path of a reading document."""
    return isinstance(item, Path) or (Path(item).suffix.lower() in (".yaml", ".yml") and Path(item).is_file())


def parse_meaning(column: str, target: str, origin: str = "command line") -> ColumnMap:
    """Meaning of a column, from a text `JOINT.QUANTITY [unit]` or `ignore`. Raises RecordingError.

    A minus sign or a factor before the joint scales the values: `-JOINT.QUANTITY`, `0.01*JOINT.QUANTITY`. `unwrapped` after the
    unit removes jumps by whole turns, and `unwrapped 4096` removes jumps by 4096 in the numbers of the file. An offset in SI
    units may follow: `... [deg] - 0.02`. `late 0.003` at the end means that the values are 3 ms behind the recording's clock.
    """
    if target.lower() == "ignore":
        return ColumnMap(column=column, origin=origin)
    found = _TARGET.fullmatch(target)
    if target == "time":
        raise _error(column, "is the time; state its column under `time`")
    if found is None or found["joint"] is None:
        hint = None if found is None else f"Did you mean {found['name']}.link_position?"
        raise _error(column, f"'{target}' is not JOINT.QUANTITY", hint=hint)
    quantity = ALIASES.get(found["name"], found["name"])
    known = column_quantities()
    if quantity not in known:
        raise _error(column, f"no quantity is called '{found['name']}'", choices=(*known, *ALIASES), meant=found["name"])
    return ColumnMap(
        column=column,
        joint=found["joint"],
        quantity=quantity,
        origin=origin,
        text=target,
        unit=parse_unit(found["unit"]) if found["unit"] else None,
        unwrapped=found["unwrapped"] is not None,
        period=float(found["period"] or 0.0) or None,
        scale=float(found["factor"] or 1.0) * (-1.0 if found["minus"] else 1.0),
        offset=float((found["offset"] or "0").replace(" ", "")),
        late=float(found["late"] or 0.0),
    )


def _error(key: str, message: str, **details: Unpack[Details]) -> RecordingError:
    return RecordingError(message, key=key, code="bad-mapping", **details)
