"""What a reproduced figure is, and the registry of those that we have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from asrsim.registry import Registry
from asrsim.reproduce.claim import Claim

if TYPE_CHECKING:
    from asrsim.reproduce.lab import Lab


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture, ready to be put into a page."""

    name: str
    """Of its file, without suffix."""
    caption: str
    """What it shows, a sentence; also what a screen reader says."""
    kind: str
    """svg or png."""
    data: bytes = field(repr=False)


@dataclass(frozen=True, kw_only=True)
class Table:
    """Numbers beside the claims."""

    caption: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Part:
    """A part of a figure's section: text, claims, numbers and pictures that belong together."""

    title: str
    text: str
    claims: tuple[Claim, ...] = ()
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """A figure of the paper, run again."""

    number: int
    title: str
    section: str
    """Of the paper."""
    paper: str
    """What the paper claims, in our own words."""
    parts: tuple[Part, ...]
    """The first is the paper's figure; the others are what it could not show."""
    error: str = ""
    """Why it could not be run."""
    simulated: float = 0.0
    """s of simulated time."""
    seconds: float = 0.0
    """s of wall-clock time, pictures included."""
    simulating: float = 0.0
    """s of wall-clock time in the simulations' loops."""

    @property
    def claims(self) -> tuple[Claim, ...]:
        """All claims."""
        return tuple(claim for part in self.parts for claim in part.claims)

    @property
    def holds(self) -> bool:
        """Whether it could be run and every claim holds."""
        return not self.error and all(claim.holds for claim in self.claims)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON, without pictures."""
        return {
            "figure": self.number,
            "title": self.title,
            "section": self.section,
            "paper": self.paper,
            "holds": self.holds,
            "error": self.error,
            "claims": [{"figure": self.number, **claim.as_dict()} for claim in self.claims],
            "tables": [
                {"caption": table.caption, "headings": list(table.headings), "rows": [list(row) for row in table.rows]}
                for part in self.parts
                for table in part.tables
            ],
            "simulated_time": self.simulated,
            "simulating_time": self.simulating,
            "wall_time": self.seconds,
        }


@dataclass(frozen=True, kw_only=True)
class Figure:
    """How to reproduce a figure. One file each: it runs scenarios in the lab, measures, draws."""

    number: int
    title: str
    section: str
    paper: str
    parts: Callable[[Lab], tuple[Part, ...]]
    """Runs everything."""
    cost: float = 1.0
    """About how long it takes, relative to the others: long ones are begun first."""


FIGURES: Registry[Figure] = Registry("figure", "asrsim.figures")
"""The figures by number, as text. Installed packages add theirs under the entry point group `asrsim.figures`."""
