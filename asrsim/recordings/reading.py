"""How a file is read: a small document beside it, `lab.csv.yaml`, and items of `--map`, which overrule it."""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

from asrsim.document.block import block_of, declare
from asrsim.document.composite import Either, ListOf, MapOf, is_list
from asrsim.document.file import read_file
from asrsim.document.kinds import NUMBER, Choice, Integer, Number, Optional, Text
from asrsim.errors import Details, InputError, Problem, RecordingError
from asrsim.recordings.names import ALIASES, KNOWN
from asrsim.recordings.units import Unit, find_unit, parse_unit

ENDING = ".yaml"
"""Behind a recording's name: the document that says how it is read."""
SEPARATORS = {"tab": "\t", ";": ";", ",": ",", "|": "|", "blanks": None}
"""Word in a document -> what stands between cells; None: runs of white space."""
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_TARGET = re.compile(
    rf"(?P<minus>-)?\s*(?:(?P<factor>{_NUMBER})\s*\*)?\s*(?:(?P<joint>[^\[\]*]+)\.)?(?P<name>\w+)(?:\s*\[(?P<unit>[^\[\]]*)\])?"
    rf"(?P<unwrapped>\s+unwrapped)?(?:\s+(?P<offset>[-+]\s*{_NUMBER})|\s+-\s*(?P<zero>start|mean))?"
)
"""`-0.01*JOINT.QUANTITY [unit] unwrapped - 0.02`."""


@dataclass(frozen=True, kw_only=True)
class ColumnMap:
    """What one column is."""

    column: str
    """Its header, or its number counted from 1."""
    joint: str | None = None
    quantity: str | None = None
    """None: the column is not used."""
    unit: Unit | None = None
    """Replaces the unit in the header."""
    scale: float = 1.0
    """Factor on the numbers beside the unit, such as -1 for a reversed axis."""
    offset: float = 0.0
    """Added after scaling, in SI units."""
    zero: str = ""
    """`start` or `mean`: what is taken away after scaling, of the column's own numbers."""
    unwrapped: bool = False
    """An angle goes on where it jumps by a whole turn."""
    origin: str = "command line"
    text: str = "ignore"
    """What stands behind `COLUMN=` in an item of `--map`."""


@dataclass(frozen=True, kw_only=True)
class TimeKeys:
    """Where the time is."""

    column: str | tuple[str, ...] | None = declare(
        Optional(Either(((is_list, ListOf(of=Text(noun="name of a column"), minimum=1)), (lambda _: True, Text())))),
        doc="its column, by header or number from 1; a list of two that are added: seconds and nanoseconds, a date and a "
        "time of day; of messages `header` or `received`", default=None,
    )  # fmt: skip
    unit: str | None = declare(Optional(Text(noun="unit of time")), doc="of its numbers", default=None, shown="the header's")
    rate: float | None = declare(
        Optional(Number(above=0.0)), doc="sampling rate that replaces the file's time by an even one from 0", unit="Hz",
        default=None,
    )  # fmt: skip

    @property
    def columns(self) -> tuple[str, ...]:
        """Its columns."""
        return () if self.column is None else (self.column,) if isinstance(self.column, str) else self.column

    @property
    def factor(self) -> float | None:
        """s of its unit; None where it states none."""
        unit = None if self.unit is None else parse_unit(self.unit)
        return None if unit is None else unit.factor

    def __post_init__(self) -> None:
        if self.unit is not None and (find_unit(self.unit) is None or parse_unit(self.unit).si != "s"):
            raise _error("unit", f"time cannot be in {self.unit}", choices=("s", "ms", "us", "ns"))


TIME = block_of(TimeKeys, "time", main="column")


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How a file is read. What it does not state is found in the file; with `columns`, no meaning is taken from a name."""

    file: str | None = declare(
        Optional(Text(noun="name of a file")), doc="the recording, where this document is given in its place", default=None
    )
    time: TimeKeys = declare(TIME, doc="the time's column, unit and rate", default=TimeKeys(), shown="the column named so")
    separator: str | None = declare(
        Optional(Choice(tuple(SEPARATORS))), doc="text: what stands between cells", default=None, shown="found"
    )
    decimal: str | None = declare(Optional(Choice((".", ","))), doc="text: the decimal mark", default=None, shown="found")
    encoding: str | None = declare(Optional(Text()), doc="text: such as utf-8, latin-1, shift_jis", default=None, shown="found")
    header: int | None = declare(
        Optional(Integer(minimum=0)), doc="text and sheets: line of the names, counted from 1; 0: there are none",
        default=None, shown="found",
    )  # fmt: skip
    sheet: str | None = declare(
        Optional(Text(noun="name of a sheet")), doc="workbooks: the sheet", default=None, shown="the first with numbers"
    )
    missing: float | None = declare(
        Optional(NUMBER), doc="the number that stands for a missing one, in the file's unit, such as -9999", default=None,
        shown="none",
    )  # fmt: skip
    window: tuple[float | None, ...] | None = declare(
        Optional(ListOf(of=Optional(NUMBER), length=2, names=("start", "end"))), doc="the part that is kept, on its clock",
        unit="s", default=None,
    )  # fmt: skip
    columns: Mapping[str, str] | None = declare(
        Optional(MapOf(of=Text(noun="JOINT.QUANTITY [unit]"), noun="column", star=False)), key="map",
        doc="what each column is that is used: `JOINT.QUANTITY [unit]`", default=None, shown="by the columns' names",
    )  # fmt: skip
    maps: tuple[ColumnMap, ...] = ()
    """`columns` and the items of `--map`."""
    origin: Path | None = None

    def __post_init__(self) -> None:
        problems: list[Problem] = []
        if self.encoding is not None:
            try:
                codecs.lookup(self.encoding)
            except LookupError:
                problems.append(Problem("is no encoding that Python knows", key="encoding", value=self.encoding, code="choice"))
        if self.window is not None and not self.start < self.end:
            problems.append(Problem("must be START..END in s", key="window", value=list(self.window), code="range"))
        known = {one.column for one in self.maps}
        maps: list[ColumnMap] = []
        for column, text in (self.columns or {}).items():
            try:
                found = parse_item(f"{column}={text}", origin="")
                if not isinstance(found, ColumnMap):
                    raise _error(column, "is the time: state it under `time`")
                maps += [found] if column not in known else []
            except RecordingError as error:
                problems += [replace(one, key="columns", message=f"{column}: {one.message}") for one in error.problems]
        if problems:
            raise RecordingError(problems)
        object.__setattr__(self, "maps", (*self.maps, *maps))

    @property
    def start(self) -> float:
        """s, where the window begins."""
        return -math.inf if self.window is None or self.window[0] is None else self.window[0]

    @property
    def end(self) -> float:
        """s, where the window ends."""
        return math.inf if self.window is None or self.window[1] is None else self.window[1]

    @property
    def items(self) -> list[str]:
        """What it says of columns and the window, as items of `--map`."""
        ends = ["" if end is None else f"{end:.12g}" for end in self.window or ()]
        unit = f" [{self.time.unit}]" if self.time.unit else ""
        times = [f"{column}=time{unit}" for column in self.time.columns[:1]]
        return [*times, *(f"{one.column}={one.text}" for one in self.maps), *([f"window={'..'.join(ends)}"] if ends else [])]

    @property
    def ignored(self) -> set[str]:
        """Columns and topics that are not read."""
        return {one.column for one in self.maps if one.quantity is None}


READING = block_of(Reading, "reading")
"""The document's keys."""


def reading_file(path: Path) -> Path | None:
    """The document beside a recording that says how it is read, or None."""
    beside = path.with_name(path.name + ENDING)
    return beside if beside.is_file() else None


def load_reading(path: Path) -> Reading:
    """A document that says how a file is read. Raises RecordingError with all problems."""
    try:
        found = read_file(READING, path)
    except InputError as error:
        raise RecordingError(error.problems) from None
    return replace(found, maps=tuple(replace(one, origin=path.name) for one in found.maps), origin=path)


def resolve_reading(
    mapping: Mapping[str, str] | Sequence[str] | Path | None, path: Path, rate: float | None = None, *, beside: bool = True
) -> Reading:
    """How a file is read: by the document beside it or that `mapping` names, and by items, which overrule it."""
    given = [f"{column}={target}" for column, target in mapping.items()] if isinstance(mapping, Mapping) else mapping
    items: Sequence[str | Path] = [given] if isinstance(given, str | Path) else given or []
    documents = [Path(item) for item in items if is_document(item)]
    document = documents[-1] if documents else reading_file(path) if beside else None
    reading = Reading() if document is None else load_reading(document)
    problems: list[Problem] = []
    maps: list[ColumnMap] = []
    for text in (str(item) for item in items if not is_document(item)):
        try:
            found = parse_item(text)
        except RecordingError as error:
            problems += error.problems
            continue
        if isinstance(found, TimeKeys):
            reading = replace(reading, time=found)
        elif isinstance(found, tuple):
            reading = replace(reading, window=found)
        else:
            maps.append(found)
    if rate is not None:
        if not (math.isfinite(rate) and rate > 0):
            problems.append(Problem("the sampling rate must be positive", value=rate, code="bad-rate"))
        reading = replace(reading, time=replace(reading.time, rate=rate))
    if problems:
        raise RecordingError(problems)
    taken = {one.column for one in maps}
    return replace(reading, maps=(*maps, *(one for one in reading.maps if one.column not in taken)))


def is_document(item: str | Path) -> bool:
    """Whether an item of `--map` is the path of a document that says how a file is read."""
    return isinstance(item, Path) or (Path(item).suffix.lower() in (".yaml", ".yml") and Path(item).is_file())


def parse_item(text: str, origin: str = "command line") -> ColumnMap | TimeKeys | tuple[float | None, ...]:
    """One item of `--map`: what a column is, `COLUMN=JOINT.QUANTITY [unit]` or `COLUMN=ignore`; `COLUMN=time [ms]`;
    `window=2..12`, which gives start and end.

    A minus before the joint turns the sign: `COLUMN=-JOINT.QUANTITY`; a factor stands there as well: `COLUMN=0.01*JOINT...`.
    An offset comes last, in SI: `... [deg] - 0.02`, or `- start`, `- mean` of the column's own numbers; before it `unwrapped`,
    for an angle that jumps by whole turns. Raises RecordingError.
    """
    column, _, target = (part.strip() for part in text.rpartition("="))
    if not column or not target:
        raise _error(text, "is not COLUMN=JOINT.QUANTITY", hint="For example --map 'q1=joint_1.link_position [deg]'")
    if column == "window" and ".." in target:
        try:
            return tuple(float(end) if end.strip() else None for end in target.split(".."))
        except ValueError:
            raise _error("window", f"must be START..END in s, is {target}") from None
    if target.lower() == "ignore":
        return ColumnMap(column=column, origin=origin)
    found = _TARGET.fullmatch(target)
    if found is None:
        raise _error(column, f"'{target}' is not JOINT.QUANTITY")
    if found["name"] == "time" and found["joint"] is None:
        return TimeKeys(column=column, unit=found["unit"])
    quantity = ALIASES.get(found["name"], found["name"])
    if found["joint"] is None:
        raise _error(column, f"'{target}' is not JOINT.QUANTITY", hint=f"Did you mean {found['name']}.link_position?")
    if quantity not in KNOWN:
        raise _error(column, f"no quantity is called '{found['name']}'", choices=(*KNOWN, *ALIASES), meant=found["name"])
    return ColumnMap(
        column=column, joint=found["joint"], quantity=quantity, origin=origin, text=target, zero=found["zero"] or "",
        unit=parse_unit(found["unit"]) if found["unit"] else None, unwrapped=found["unwrapped"] is not None,
        scale=float(found["factor"] or 1.0) * (-1.0 if found["minus"] else 1.0),
        offset=float((found["offset"] or "0").replace(" ", "")),
    )  # fmt: skip


def _error(key: str, message: str, **details: Unpack[Details]) -> RecordingError:
    return RecordingError(message, key=key, code="bad-mapping", **details)
