"""Data of a data sheet: charts, and entries that state each number with the method that determined it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote
from typing import Any

from asrsim.plots.chart import Chart


@dataclass(frozen=True, kw_only=True)
class Published:
    """Statement that a publication makes about an actuator."""

    key: str
    """Key of the entry to which the statement belongs; "" for a remark."""
    text: str
    source: str
    why: str = ""
    """Reason why the statement differs from the number on the sheet, or a remark that the two agree."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One line of a data sheet: a number and the method by which it was found."""

    key: str
    words: str
    unit: str
    value: float | None
    """Number in SI units; None if it is unknown."""
    how: str
    """Method by which the number was found: `closed form: ...`, `simulation: ...` or `stated: ...`. For an unknown number, the
    tag or key that would state it, or the reason why the number does not apply to the actuator.
    """

    @property
    def known(self) -> bool:
        """Whether the number is known."""
        return self.value is not None and math.isfinite(self.value)

    def as_dict(self) -> dict[str, Any]:
        """Entry as plain data."""
        value, found = (self.value, self.how.partition(":")[0]) if self.known else (None, None)
        return {"words": self.words, "unit": self.unit, "value": value, "found": found, "how": self.how}


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """Data sheet of one actuator."""

    name: str
    """Name of the files: name of the actuator, or names of robot and joint."""
    short: str
    """Name in comparisons of sheets: name of the actuator or of the joint."""
    title: str
    source: str
    """Publication of the actuator's law."""
    law: str
    origin: str
    """Source of the parameter values."""
    entries: tuple[Entry, ...]
    rows: tuple[tuple[Chart, ...], ...]
    """Charts of the picture, row by row."""
    published: tuple[Published, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    """Texts of the files with which the user can repeat the simulations, by name of the file."""
    plugins: Sequence[Path] = ()
    values: Mapping[str, float] = field(default_factory=dict)
    """Values of all parameters."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units of the parameters."""
    doubts: tuple[str, ...] = ()
    """Sentences about numbers of the measured curves that are missing or doubtful."""

    @property
    def command(self) -> str:
        """Command that repeats the simulations, in the folder of the files."""
        scenario = next(name for name in self.files if name.endswith(".yaml"))
        return " ".join(["asrsim run", scenario, *(f"--plugin {quote(str(path.absolute()))}" for path in self.plugins)])

    def entry(self, key: str) -> Entry:
        """Entry with this key. Raises KeyError."""
        return {one.key: one for one in self.entries}[key]

    def as_dict(self) -> dict[str, Any]:
        """Numbers of the sheet as plain data; charts are left out."""
        return {
            "name": self.name,
            "title": self.title,
            "source": self.source,
            "law": self.law,
            "origin": self.origin,
            "command": self.command,
            "numbers": {one.key: one.as_dict() for one in self.entries},
            "published": [vars(one) for one in self.published],
            "doubts": [*self.doubts],
            "parameters": {name: value if math.isfinite(value) else None for name, value in self.values.items()},
        }
