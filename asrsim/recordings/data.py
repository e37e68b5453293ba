"""Data classes of recordings: raw tables as the readers of file formats return them, and columns in SI units."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError, listed
from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.recordings.reading import ColumnMap

EPOCH = 1e9
"""Times above this value count as Unix times (September 2001 and later), s."""
LARGEST = 1e30
"""Largest magnitude of a measured value, in SI units. Squares and slopes of larger values would overflow."""


_LOST = ("wrapped", "unsigned", "missing-numbers", "not-a-number", "ragged-row", "dropped-samples", "falling-time",
         "repeated-time", "bad-time", "two-time-bases", "truncated", "broken-message",
         "repeated-name")  # fmt: skip
"""Codes of findings about samples that were changed, are missing, or contradict each other."""


def places_text(noun: str, numbers: Iterable[int]) -> str:
    """The noun and the numbers as text, for example `lines 3, 11`."""
    words = [*map(str, numbers)]
    return f"{noun}{'s' if len(words) > 1 else ''} {listed(words, 8)}"


def unique(name: str, seen: Counter[str]) -> str:
    """Unique name: `q` for the first column with this name, then `q#2`, `q#3`, ... seen: number of uses of each name."""
    seen[name] += 1
    while seen[name] > 1:
        name = f"{name}#{seen[name]}"
        seen[name] += 1
    return name


@dataclass(frozen=True, kw_only=True, eq=False)
class RawColumn:
    """A numeric column with its values as stored in the file."""

    name: str
    """Name in the file: header of a column, field of a message, or path of a variable."""
    values: Array
    """Values (n,) in the file's unit; NaN for a cell without a number. Dates and times of day are in s since `zero`."""
    zero: int | None = None
    """Origin of the values: Unix time in ns for dates, ns since midnight for times of day, None for other columns."""
    place: int = 0
    """Number of the column in the file, counted from 1; 0: the number is the position in the table."""
    joint: str | None = None
    """Joint that the file states for the column, as in JointState messages."""
    quantity: str | None = None
    """Quantity that the message type implies."""
    file: str = ""
    """Name of the column's file without its ending, if a folder with several files is the recording; otherwise empty."""

    @property
    def header(self) -> str:
        """Name of the column in its file, without the name of the file."""
        return self.name.removeprefix(f"{self.file}/") if self.file else self.name


@dataclass(frozen=True, kw_only=True, eq=False)
class RawTable:
    """Columns of equal length, from a text file, from a sheet, from the vectors of a struct, or from the messages of a
    topic.
    """

    name: str = ""
    """Topic of the messages; "" for other tables."""
    columns: tuple[RawColumn, ...]
    lines: NDArray[np.int64] | None = None
    """Line number (n,) of each row in a text file, counted from 1."""
    time: Array = field(default_factory=lambda: np.empty(0))
    """Strictly increasing times (n,), s. `asrsim.recordings.times` sets them; a reader returns an empty array."""
    clock: Mapping[str, Any] = field(default_factory=dict)
    """Column and unit of the time, with the keys of `time` in a reading document."""
    zero: int = 0
    """Unix time of time 0, ns; 0 if the times do not count from a date."""

    def line(self, row: int) -> int | None:
        """Line number of a row; None if the table is not from a text file."""
        return None if self.lines is None else int(self.lines[row])

    def places(self, rows: NDArray[np.intp]) -> str:
        """Places of rows as text, such as `lines 3, 11`, or `samples 2, 10` if the table is not from a text file."""
        return places_text("sample", rows + 1) if self.lines is None else places_text("line", self.lines[rows])

    def selected(self, rows: NDArray[np.bool_]) -> RawTable:
        """Table with the rows that a mask (n,) selects."""
        columns = tuple(replace(column, values=column.values[rows]) for column in self.columns)
        lines = None if self.lines is None else self.lines[rows]
        return replace(self, columns=columns, lines=lines, time=self.time[rows])


@dataclass(frozen=True, kw_only=True)
class Content:
    """Content of a file, as its format's reader returns it."""

    tables: tuple[RawTable, ...]
    format: str = ""
    """Name of the reader in `asrsim.recordings.READERS`; `asrsim.recordings.formats.content_of` sets it."""
    findings: tuple[Problem, ...] = ()
    layout: Mapping[str, str | int] = field(default_factory=dict)
    """Detected layout of a text or sheet, with the keys of a reading document."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """A column of a recording, in SI units."""

    time: Array
    """Times (n,), s. Columns of a table share this array, except columns with a delay."""
    values: Array
    """Values (n,) in `unit`; NaN for samples without a valid number."""
    unit: str
    """SI unit, such as `rad`, `N m` or `s`; "" if neither the file nor the quantity states a unit."""
    joint: str | None
    quantity: str | None
    """Name in `asrsim.quantities.QUANTITIES` or `DERIVED`; None: the column is not mapped to the simulation."""
    source: str
    """Name of the column in the file."""
    conversion: str
    """Conversion of the numbers, such as "deg -> rad, x 0.0174533" or "rad assumed"; "" if they are not converted."""
    stated: bool = False
    """True if the file or the mapping states the unit, False if it is assumed."""
    origin: str = ""
    """Source of the meaning: "command line", "lab.csv.yaml", "named in the file" or "by its name". For a column without a
    meaning: "asked: ..." or "not used: ...", with the reason.
    """
    read_as: ColumnMap | None = None
    """Joint, quantity, unit and conversion by which the column was read."""

    @property
    def meaning(self) -> str:
        """`joint.quantity`; "-" for a column that is not used."""
        return f"{self.joint}.{self.quantity}" if self.quantity else "-"

    @property
    def reading(self) -> str:
        """Description as text: name of the column in the file, conversion of its numbers, and source of its meaning."""
        return f"'{self.source}' ({'; '.join(filter(None, (self.conversion or self.unit, self.origin)))})"

    @property
    def question(self) -> str:
        """Reason why the user is asked about the meaning of the column; "" if the user is not asked."""
        return self.origin.removeprefix("asked: ") if self.origin.startswith("asked: ") else ""

    @property
    def target(self) -> str:
        """Meaning that a mapping may give to a column about which the user is asked, such as `reference_1 [unit]`; "" for other
        columns.
        """
        return self.read_as.text if self.question and self.read_as is not None else ""

    @property
    def given(self) -> bool:
        """Whether the command line or a reading document states the meaning of the column."""
        return self.origin == "command line" or self.origin.endswith((".yaml", ".yml"))


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Recording of an experiment. Faulty samples are removed, but samples are never resampled. `findings` lists each
    removal.
    """

    path: Path
    format: str
    """Name of the reader in `asrsim.recordings.READERS`, such as text, numpy or bag."""
    time: Array
    """Strictly increasing times (n,) as in the file, s. Dates and Unix times are relative to the first time."""
    channels: Mapping[str, Column]
    """Columns by name, in the order of the file. Each column has its own times; `Recording.time` is from the longest table."""
    findings: tuple[Problem, ...] = ()
    """Problems of the file: faulty rows, gaps, constant columns, suspected units. Every removed sample is reported."""

    @property
    def asked(self) -> tuple[Column, ...]:
        """Unused columns with ambiguous names, which may contain a joint's quantity."""
        return tuple(column for column in self.channels.values() if column.question)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences on numbers and times that are lost or probably wrong."""
        found = [one for one in self.findings if one.code.startswith("suspected-") or one.code in _LOST]
        return tuple(f"{one.key}: {one.message}".removeprefix("None: ") + f". {one.hint}" * bool(one.hint) for one in found)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints with at least one mapped column, in the order of the file."""
        names = [column.joint for column in self.channels.values() if column.joint is not None and column.quantity]
        return tuple(dict.fromkeys(names))

    def column(self, joint: str, quantity: str) -> Column:
        """Column of a joint's quantity. If there is no such column, raises RecordingError with a list of the columns."""
        for column in self.channels.values():
            if column.joint == joint and column.quantity == quantity:
                return column
        raise RecordingError(
            f"has no column for {joint}.{quantity}",
            file=self.path,
            choices=tuple(c.meaning for c in self.channels.values() if c.quantity),
            hint=f"Columns in the file: {', '.join(self.channels)}. Map a column with --map COLUMN={joint}.{quantity}",
            code="no-such-quantity",
        )
