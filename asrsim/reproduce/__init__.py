"""Repeats the paper's experiments, checks their claims, and writes one page (`asrsim reproduce`).

The experiments are examples (`examples/paper`), one file per figure; this module defines their parts and runs them.
"""

from __future__ import annotations

import math
import sys
import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache, partial
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from asrsim.errors import AsrsimError, InputError
from asrsim.metrics.expect import compares
from asrsim.outfile import make_folder, write_json, write_text, written
from asrsim.plain import finite_or_none
from asrsim.runs.examples import examples_folder
from asrsim.workers import Lost, executor

if TYPE_CHECKING:
    from asrsim.api import Result
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario

Origin = Literal["paper", "theory", "simulation", "beyond"]


@dataclass(frozen=True)
class FigureBound:
    """Condition on the measured number of a claim."""

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
    """Condition that a number equals a value within a tolerance."""
    return FigureBound("==", value, unit, tolerance)


@dataclass(frozen=True, kw_only=True)
class Claim:
    """Statement about a measured number."""

    text: str
    """Statement in the words of asrsim's authors."""
    quantity: str
    """Name of the measured quantity."""
    measured: float
    """Measured number; NaN if it cannot be measured: the claim then does not hold."""
    bound: FigureBound
    origin: Origin = "paper"

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
    """Picture for the page."""

    name: str
    """Name of its file, without suffix."""
    caption: str
    """Sentence that describes the picture, also for screen readers."""
    kind: Literal["svg", "png"]
    data: bytes = field(repr=False)


@dataclass(frozen=True, kw_only=True)
class FigureTable:
    """Table of numbers beside the claims."""

    caption: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class FigurePart:
    """Part of a figure's section: text, claims, numbers and pictures about one experiment."""

    title: str
    text: str
    claims: tuple[Claim, ...] = ()
    tables: tuple[FigureTable, ...] = ()
    pictures: tuple[FigurePicture, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Heading:
    """Title and subject of a figure."""

    number: int
    title: str
    section: str
    """Section of the paper."""
    paper: str
    """Claim of the paper, in the words of asrsim's authors."""


@dataclass(frozen=True, kw_only=True)
class Figure(Heading):
    """Experiments of a figure of the paper: the `FIGURE` of a file `figure_N.py`."""

    parts: Callable[[Lab], tuple[FigurePart, ...]]
    """Function that runs the experiments. Its first part is the paper's figure; the others extend it."""
    cost: float = 1.0
    """Relative duration of the experiments; the figure with the longest duration starts first."""


@dataclass(frozen=True, kw_only=True)
class Reproduction(Heading):
    """Result of reproducing a figure of the paper."""

    parts: tuple[FigurePart, ...] = ()
    error: str = ""
    """Reason why the figure could not be run."""
    simulated: float = 0.0
    """Simulated time, s."""
    simulating: float = 0.0
    """Wall-clock time of the simulations, s."""
    seconds: float = 0.0
    """Wall-clock time including pictures, s."""

    @property
    def claims(self) -> tuple[Claim, ...]:
        """All claims of the figure."""
        return tuple(claim for part in self.parts for claim in part.claims)

    @property
    def holds(self) -> bool:
        """Whether the figure could be run and every claim holds."""
        return not self.error and all(claim.holds for claim in self.claims)

    def as_dict(self) -> dict[str, Any]:
        """Result as data for JSON, without pictures."""
        return {
            "figure": self.number, "title": self.title, "section": self.section, "paper": self.paper, "holds": self.holds,
            "error": self.error,
            "claims": [
                {"figure": self.number, "claim": one.text, "origin": one.origin, "quantity": one.quantity, **vars(one.bound),
                 "measured": finite_or_none(one.measured), "holds": one.holds}
                for one in self.claims
            ],
            "tables": [vars(table) for part in self.parts for table in part.tables],
            "simulated_time": self.simulated, "simulating_time": self.simulating, "wall_time": self.seconds,
        }  # fmt: skip


@dataclass(kw_only=True)
class Lab:
    """Runs variants of example scenarios for a figure, and sums their simulated time and duration."""

    folder: Path
    """Folder for the logs, with one subfolder per run."""
    simulated: float = 0.0
    """Simulated time so far, s."""
    simulating: float = 0.0
    """Wall-clock time of the simulations so far, s."""

    def scenario(self, name: str, variant: str | None = None, overrides: Sequence[str] = ()) -> Scenario:
        """Variant of an example scenario. Raises ScenarioError."""
        from asrsim.scenario import load_scenario

        return load_scenario(examples_folder() / "scenarios" / f"{name}.yaml", variant=variant, overrides=overrides)[0]

    def run(
        self, name: str, variant: str, *, overrides: Sequence[str] = (), label: str | None = None, robot: Robot | None = None,
        log: bool = True,
    ) -> Result:  # fmt: skip
        """Result of a run of an example scenario's variant.

        label: name of the run's folder inside the scenario's, by default the variant; robot: replaces the scenario's
        robot; log: write a log. Raises the errors of `asrsim.run`.
        """
        from asrsim.api import run

        out = self.folder / f"{name}_{label or variant}" if log else None
        began = clock.perf_counter()
        scenario = self.scenario(name, variant, overrides)
        if overrides or robot is not None:
            # The claims in the example hold for the unchanged example only.
            scenario = replace(scenario, expect=())
        result = run(scenario, robot=robot, out=out, overwrite=True)
        self.count(result.run.simulated_time, clock.perf_counter() - began)
        return result

    def pairs(self, name: str, variants: Sequence[str]) -> dict[str, Result]:
        """Result of the run of each variant."""
        return {variant: self.run(name, variant) for variant in variants}

    def count(self, simulated: float, seconds: float) -> None:
        """Add simulated time and the wall-clock time of a simulation to the totals."""
        self.simulated += simulated
        self.simulating += seconds


@dataclass(frozen=True, kw_only=True)
class FigureOutcome:
    """Results of all figures."""

    figures: tuple[Reproduction, ...]
    page: Path
    seconds: float
    """Total wall-clock time, s."""

    @property
    def holds(self) -> bool:
        """Whether every claim of every figure holds."""
        return all(figure.holds for figure in self.figures)

    def as_dict(self) -> dict[str, Any]:
        """Results as data for JSON."""
        return {
            "ok": self.holds, "page": str(self.page), "wall_time": self.seconds,
            "simulated_time": sum(figure.simulated for figure in self.figures),
            "figures": [figure.as_dict() for figure in self.figures],
        }  # fmt: skip


@cache
def figures() -> dict[str, Figure]:
    """Figures of `examples/paper` by number (as text). Raises InputError if this installation has no examples."""
    examples = examples_folder()
    sys.path.insert(0, str(examples))
    try:
        found = [import_module(f"paper.{path.stem}").FIGURE for path in (examples / "paper").glob("figure_*.py")]
    finally:
        sys.path.remove(str(examples))
    return {str(figure.number): figure for figure in sorted(found, key=lambda figure: figure.number)}


def reproduce(
    names: Sequence[str] = (), folder: Path = Path("out/reproduce"), *, workers: int = 2,
    on_figure: Callable[[Reproduction], None] | None = None,
) -> FigureOutcome:  # fmt: skip
    """Reproduce figures and write `reproduce.html`, `reproduce.json`, the pictures and the runs' logs into `folder`.

    names: figures to run, all by default; on_figure: called with each result, in any order. For a figure that cannot be run
    the reason is reported, its claims count as failed, and the other figures continue.
    Raises InputError for unknown figures and OutputError if a file cannot be written.
    """
    from asrsim.reproduce.page import page

    known = figures()
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"no figure is called '{unknown[0]}'", choices=tuple(known), code="unknown-figure")
    order = sorted(set(names or known), key=lambda name: -known[name].cost)
    began = clock.perf_counter()
    make_folder(folder / "runs")
    make_folder(folder / "pictures")
    found = []
    with executor(min(workers, len(order))) as pool:
        for number, one in chain.from_iterable(pool.results(partial(run_figure, folder=folder / "runs"), order)):
            found.append(_about(order[number], error=one.reason) if isinstance(one, Lost) else one)
            if on_figure is not None:
                on_figure(found[-1])
    found.sort(key=lambda one: one.number)
    outcome = FigureOutcome(figures=tuple(found), page=folder / "reproduce.html", seconds=clock.perf_counter() - began)
    for path, data in _pictures(found, folder / "pictures"):
        with written(path, "picture") as stream:
            stream.write(data)
    write_text(outcome.page, page(outcome.figures, seconds=outcome.seconds), "page")
    write_json(folder / "reproduce.json", outcome.as_dict())
    return outcome


def run_figure(name: str, folder: Path) -> Reproduction:
    """Result of one figure, with its logs in `folder`; an error becomes part of the result."""
    began, lab = clock.perf_counter(), Lab(folder=folder)
    try:
        done = _about(name, parts=figures()[name].parts(lab))
    except AsrsimError as caught:
        done = _about(name, error=str(caught))
    return replace(done, simulated=lab.simulated, simulating=lab.simulating, seconds=clock.perf_counter() - began)


def _about(name: str, **more: Any) -> Reproduction:
    figure = figures()[name]
    return Reproduction(**{one.name: getattr(figure, one.name) for one in fields(Heading)}, **more)


def _pictures(found: Sequence[Reproduction], folder: Path) -> Iterator[tuple[Path, bytes]]:
    for figure in found:
        for part in figure.parts:
            for picture in part.pictures:
                yield folder / f"{picture.name}.{picture.kind}", picture.data
