"""A figure of the paper as data: its experiments, its claims, and their results."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from asrsim.metrics.expect import compares
from asrsim.plain import finite_or_none
from asrsim.runs.examples import examples_folder

Evidence = Literal["paper", "theory", "simulation", "beyond"]


@dataclass(frozen=True)
class FigureBound:
    """Condition that the measured number of a claim must satisfy."""

    comparison: str
    """Comparison operator `==`, `<`, `<=`, `>` or `>=`; `==` holds within `tolerance`."""
    value: float
    unit: str = ""
    tolerance: float = 0.0

    def __str__(self) -> str:
        sign = "" if self.comparison == "==" else f"{self.comparison} "
        spread = f" ± {self.tolerance:.3g}" if self.tolerance else ""
        return f"{sign}{self.value:.6g}{spread}{f' {self.unit}' if self.unit else ''}"


below, at_most, above, at_least = (partial(FigureBound, sign) for sign in ("<", "<=", ">", ">="))


def near(value: float, tolerance: float, unit: str = "") -> FigureBound:
    """Condition that a measured number equals `value` within `tolerance`."""
    return FigureBound("==", value, unit, tolerance)


@dataclass(frozen=True, kw_only=True)
class Claim:
    """Statement about a number that the experiments of a figure measure."""

    text: str
    """Statement in the words of asrsim's authors."""
    quantity: str
    """Name of the measured quantity."""
    measured: float
    """Measured number; NaN if it cannot be measured, so that the claim does not hold."""
    bound: FigureBound
    origin: Evidence = "paper"

    @property
    def holds(self) -> bool:
        """Whether the measured number satisfies the condition."""
        return compares(self.measured, self.bound.comparison, self.bound.value, self.bound.tolerance)

    @property
    def found(self) -> str:
        """The measured number as text, with unit."""
        return f"{self.measured:.6g} {self.bound.unit}".strip() if math.isfinite(self.measured) else "not measurable"


@dataclass(frozen=True, kw_only=True)
class FigurePicture:
    """Picture that the page shows."""

    name: str
    """Name of the picture's file, without suffix."""
    caption: str
    """Sentence below the picture, which also describes the picture for screen readers."""
    kind: Literal["svg", "png"]
    data: bytes = field(repr=False)


@dataclass(frozen=True, kw_only=True)
class FigureTable:
    """Table of numbers that the page shows beside the claims."""

    caption: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class FigurePart:
    """Part of the page's section about a figure: text, claims, numbers and pictures of one experiment."""

    title: str
    text: str
    claims: tuple[Claim, ...] = ()
    tables: tuple[FigureTable, ...] = ()
    pictures: tuple[FigurePicture, ...] = ()


@dataclass(frozen=True, kw_only=True)
class PaperFigure:
    """Description of a figure of the paper and of its experiments. A file `figure_N.py` defines it as `FIGURE`."""

    number: int
    title: str
    section: str
    """Section of the paper that contains the figure."""
    paper: str
    """Claim that the paper makes with the figure, in the words of asrsim's authors."""
    parts: Callable[[Path], tuple[FigurePart, ...]]
    """Function that runs the experiments, writes their logs into the given folder, and returns the parts of the figure's
    section. The first part repeats the paper's figure; the other parts extend it.
    """
    cost: float = 1.0
    """Duration of the experiments relative to the experiments of other figures. The figure with the longest duration starts
    first."""


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """Result of reproducing a figure of the paper."""

    name: str
    """Number of the figure as text."""
    parts: tuple[FigurePart, ...] = ()
    error: str = ""
    """Reason why the figure could not be run; empty if it was run."""
    seconds: float = 0.0
    """Wall-clock time of the figure's experiments, s."""

    @property
    def figure(self) -> PaperFigure:
        """Description of the figure and its experiments."""
        return figures()[self.name]

    @property
    def claims(self) -> tuple[Claim, ...]:
        """Claims of all parts of the figure."""
        return tuple(claim for part in self.parts for claim in part.claims)

    @property
    def holds(self) -> bool:
        """Whether the figure could be run and every claim holds."""
        return not self.error and all(claim.holds for claim in self.claims)

    def as_dict(self) -> dict[str, Any]:
        """Result as data for JSON, without pictures."""
        figure = self.figure
        return {
            "figure": figure.number, "title": figure.title, "section": figure.section, "paper": figure.paper,
            "holds": self.holds, "error": self.error,
            "claims": [
                {"figure": figure.number, "claim": one.text, "origin": one.origin, "quantity": one.quantity, **vars(one.bound),
                 "measured": finite_or_none(one.measured), "holds": one.holds}
                for one in self.claims
            ],
            "tables": [vars(table) for part in self.parts for table in part.tables],
            "wall_time": self.seconds,
        }  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class FigureOutcome:
    """Results of all figures."""

    figures: tuple[Reproduction, ...]
    page: Path
    seconds: float
    """Wall-clock time for all figures together, s."""

    @property
    def holds(self) -> bool:
        """Whether every claim of every figure holds."""
        return all(figure.holds for figure in self.figures)

    def as_dict(self) -> dict[str, Any]:
        """Results as data for JSON."""
        return {
            "ok": self.holds,
            "page": str(self.page),
            "wall_time": self.seconds,
            "figures": [figure.as_dict() for figure in self.figures],
        }


@cache
def figures() -> dict[str, PaperFigure]:
    """Figures of `examples/paper` by number (as text). Raises InputError if this installation has no examples."""
    examples = examples_folder()
    sys.path.insert(0, str(examples))
    try:
        found = [import_module(f"paper.{path.stem}").FIGURE for path in (examples / "paper").glob("figure_*.py")]
    finally:
        sys.path.remove(str(examples))
    return {str(figure.number): figure for figure in sorted(found, key=lambda figure: figure.number)}
