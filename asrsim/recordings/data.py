"""Data of recordings: what a reader of a file format hands on, and the columns that are made of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError
from asrsim.samples import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class RawColumn:
    """One numeric column as the file holds it."""

    name: str
    """Name in the file: a column's header, a message's field, a variable's path."""
    values: Array
    """(n,) in the file's unit, NaN where a cell has no number; of dates s since `zero`."""
    unit: str = ""
    """Unit that stands beside the name, such as in a row of units; "" where it stands in the name or nowhere."""
    zero: int | None = None
    """Of dates: Unix time in ns at which the values are 0; of times of day: ns since midnight."""
    place: int = 0
    """Its number among all columns of the file, from 1; 0: as it stands in its table."""
    joint: str | None = None
    """Joint that the file itself names (JointState)."""
    quantity: str | None = None
    """Quantity that the kind of message fixes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RawTable:
    """Columns of one length: a sheet, the vectors of a struct, the messages of a topic."""

    name: str = ""
    """Stands before the names of its columns: a topic, a struct's path."""
    columns: tuple[RawColumn, ...]
    lines: NDArray[np.int64] | None = None
    """(n,) line of each row in a text file, counted from 1."""
    received: NDArray[np.int64] | None = None
    """(n,) ns at which messages were recorded; None for tables whose time is a column."""
    stamped: NDArray[np.int64] | None = None
    """(n,) ns in the headers of messages; None where they have none."""


@dataclass(frozen=True, kw_only=True)
class Content:
    """What a reader of a file format hands on."""

    format: str
    tables: tuple[RawTable, ...]
    findings: tuple[Problem, ...] = ()
    layout: Mapping[str, str | int] = field(default_factory=dict)
    """How a text or sheet was found to be laid out, as the keys of a document state it."""
    topics: tuple[str, ...] = ()
    """Topics of a bag, those without numbers too."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RawSeries:
    """A raw column on its clean time."""

    column: RawColumn
    time: Array
    """(n,) s; columns of one table share one array."""
    values: Array
    """(n,), of the rows that were kept."""
    clock: str = ""
    """Where its time stands, as a document states it."""

    @property
    def name(self) -> str:
        """Name of its column."""
        return self.column.name


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """One column of a recording, in SI units."""

    time: Array
    """(n,) s; the same array for all columns of one table."""
    values: Array
    """(n,) in `unit`; NaN where the file had no valid number."""
    unit: str
    """SI unit, such as `rad`, `N m`, `s`; "" where the file states none and no quantity implies one."""
    joint: str | None
    quantity: str | None
    """Name from :data:`asrsim.quantities.QUANTITIES` or `DERIVED`; None: not mapped to the simulation."""
    source: str
    """Name of the column in the file."""
    conversion: str
    """What was done to the numbers: "deg -> rad, x 0.0174533", "rad assumed", "" for nothing."""
    stated: bool = False
    """The file or the mapping states the unit; else it is assumed."""
    origin: str = ""
    """Why: "command line", "lab.csv.yaml", "named in the file", "by its name", "asked: ...", "not used: ..."."""

    @property
    def meaning(self) -> str:
        """`joint.quantity`, or "-" for a column that is not used."""
        return f"{self.joint}.{self.quantity}" if self.quantity else "-"

    @property
    def reading(self) -> str:
        """How it was read: its name in the file, what was done to its numbers, and why."""
        return f"'{self.source}' ({'; '.join(filter(None, (self.conversion or self.unit, self.origin)))})"

    @property
    def given(self) -> bool:
        """Whether the command line or a document says what it is."""
        return self.origin == "command line" or self.origin.endswith((".yaml", ".yml"))


@dataclass(frozen=True, kw_only=True)
class Recording:
    """An experiment's file, read: never resampled, only cleaned, with each cleaning step in `findings`."""

    path: Path
    format: str
    """Name of the reader: text, json, mcap, bag, matlab, numpy, excel, arrow, asrsim, or a user's."""
    time: Array
    """(n,) s, strictly increasing; its start as in the file (absolute stamps: from the first, see `epoch`)."""
    channels: Mapping[str, Column]
    """By source name, in the file's order. A column has its own time (`column.time`), which is `time` for the largest table."""
    findings: tuple[Problem, ...] = ()
    """Everything odd: bad rows, gaps, jitter, constant columns, assumed units. Nothing is dropped without one."""
    epoch: float | None = None
    """Unix time in s of time 0 where the file has absolute stamps."""
    reading: Path | None = field(default=None, repr=False)
    """Document that says how the file is read; None: its columns were read by their names."""

    @property
    def asked(self) -> tuple[Column, ...]:
        """Columns that may be a joint's quantity and are not used, since their names do not say it for certain."""
        return tuple(column for column in self.channels.values() if column.origin.startswith("asked"))

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints with at least one mapped column, in the file's order."""
        names = [column.joint for column in self.channels.values() if column.joint is not None and column.quantity]
        return tuple(dict.fromkeys(names))

    def quantities(self, joint: str) -> tuple[str, ...]:
        """Quantities recorded of a joint."""
        return tuple(
            column.quantity for column in self.channels.values() if column.joint == joint and column.quantity is not None
        )

    def column(self, joint: str, quantity: str) -> Column:
        """The column of a joint's quantity; raises RecordingError naming what there is."""
        for column in self.channels.values():
            if column.joint == joint and column.quantity == quantity:
                return column
        raise RecordingError(
            f"has no column for {joint}.{quantity}",
            file=self.path,
            choices=tuple(c.meaning for c in self.channels.values() if c.quantity),
            hint=f"Columns in the file: {', '.join(self.channels)}. Map one with --map COLUMN={joint}.{quantity}",
            code="no-such-quantity",
        )
