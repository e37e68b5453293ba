"""A recording of an experiment: columns on their time, in SI units, with everything that was odd about the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from asrsim.errors import Problem, RecordingError
from asrsim.samples import Array


@dataclass(frozen=True, kw_only=True)
class RawSeries:
    """One numeric column as a file holds it, before it is understood."""

    name: str
    """Name in the file: a column's header, `topic/field`, a variable's path."""
    time: Array
    """(n,) s; columns of one table share one array."""
    values: Array
    """(n,) in the file's unit; NaN where a cell is missing."""
    unit: str = ""
    """Unit that the file states, "" if it states none."""
    joint: str | None = None
    """Joint that the file itself names (JointState)."""
    quantity: str | None = None
    """Quantity that the kind of message fixes."""
    part: Path | None = None
    """Of files that were joined, the one that it is from."""
    label: str = ""
    """Its name there."""
    shift: float = 0.0
    """s that were added to the time there."""


@dataclass(frozen=True, kw_only=True)
class Raw:
    """What a reader of a file format hands on."""

    format: str
    series: tuple[RawSeries, ...]
    findings: tuple[Problem, ...] = ()
    epoch: float | None = None
    """Unix time in s of time 0, where the file had absolute stamps."""
    names: tuple[str, ...] = ()
    """Columns and topics that the file has, those without numbers too."""
    remarks: str = ""
    """What the file says beside its numbers and their names."""


@dataclass(frozen=True, kw_only=True)
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
    """Why it is mapped so: "command line", "map file", "named in the file", "guessed: ...", "not used: ..."."""
    part: Path | None = None
    """Of files that were joined, the one that it is from."""
    label: str = ""
    """Its name there."""
    shift: float = 0.0
    """s that were added to the time there."""


@dataclass(frozen=True, kw_only=True)
class Recording:
    """An experiment's file, read: never resampled, only cleaned, with each cleaning step in `findings`."""

    path: Path
    format: str
    """csv, json, mcap, rosbag1, rosbag2, mat, asrsim; joined: of several files."""
    time: Array
    """(n,) s, strictly increasing; its start as in the file (absolute stamps: from the first, see `epoch`)."""
    channels: Mapping[str, Column]
    """By source name, in the file's order. A column has its own time (`column.time`), which is `time` for the largest table."""
    findings: tuple[Problem, ...] = ()
    """Everything odd: bad rows, gaps, jitter, constant columns, assumed units. Nothing is dropped without one."""
    epoch: float | None = None
    """Unix time in s of time 0 where the file has absolute stamps."""
    guesses: tuple[Column, ...] = field(default=(), repr=False)
    """Columns whose mapping was guessed from the name; show them to the user."""

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
            choices=tuple(f"{c.joint}.{c.quantity}" for c in self.channels.values() if c.quantity),
            hint=f"Columns in the file: {', '.join(self.channels)}. Map one with --map COLUMN={joint}.{quantity}",
            code="no-such-quantity",
        )
