"""The paper's experiments run again, judged, on one page (`asrsim reproduce`).

The experiments are examples (`examples/paper`), one file a figure; here is what they are made of, and what runs them.
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
class Bound:
    """What a number is claimed to be."""

    comparison: str
    """One of `==`, `<`, `<=`, `>`, `>=`; `==` within `tolerance`."""
    value: float
    unit: str = ""
    tolerance: float = 0.0

    def __str__(self) -> str:
        sign = "" if self.comparison == "==" else f"{self.comparison} "
        spread = f" ± {self.tolerance:.3g}" if self.tolerance else ""
        return f"{sign}{self.value:.6g}{spread}{f' {self.unit}' if self.unit else ''}"


below, at_most, above, at_least = (partial(Bound, sign) for sign in ("<", "<=", ">", ">="))


def near(value: float, tolerance: float, unit: str = "") -> Bound:
    """Within the tolerance of the value."""
    return Bound("==", value, unit, tolerance)


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One statement about one number."""

    text: str
    """The statement in our own words."""
    quantity: str
    """What was measured."""
    measured: float
    """NaN where it cannot be measured; such a claim does not hold."""
    bound: Bound
    origin: Origin = "paper"

    @property
    def holds(self) -> bool:
        """Whether the measured number is as claimed."""
        return compares(self.measured, self.bound.comparison, self.bound.value, self.bound.tolerance)

    @property
    def found(self) -> str:
        """The measured number as text, with unit."""
        return f"{self.measured:.6g} {self.bound.unit}".strip() if math.isfinite(self.measured) else "not measurable"


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture, ready to be put into a page."""

    name: str
    """Of its file, without suffix."""
    caption: str
    """What it shows, a sentence; also what a screen reader says."""
    kind: Literal["svg", "png"]
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
class Heading:
    """What a figure is about."""

    number: int
    title: str
    section: str
    """Of the paper."""
    paper: str
    """What the paper claims, in our own words."""


@dataclass(frozen=True, kw_only=True)
class Figure(Heading):
    """How to reproduce a figure: the `FIGURE` of a file `figure_N.py`."""

    parts: Callable[[Lab], tuple[Part, ...]]
    """Runs everything. The first part is the paper's figure; the others are what it could not show."""
    cost: float = 1.0
    """About how long it takes, relative to the others: long ones are begun first."""


@dataclass(frozen=True, kw_only=True)
class Reproduction(Heading):
    """A figure of the paper, run again."""

    parts: tuple[Part, ...] = ()
    error: str = ""
    """Why it could not be run."""
    simulated: float = 0.0
    """s of simulated time."""
    simulating: float = 0.0
    """s of wall-clock time in the simulations."""
    seconds: float = 0.0
    """s of wall-clock time, pictures included."""

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
    """Where a figure's runs happen: variants of example scenarios. It counts what they take."""

    folder: Path
    """Takes the logs, one folder a run."""
    simulated: float = 0.0
    """s simulated so far."""
    simulating: float = 0.0
    """s of wall-clock time in simulations so far."""

    def scenario(self, name: str, variant: str | None = None, overrides: Sequence[str] = ()) -> Scenario:
        """A variant of an example scenario. Raises ScenarioError."""
        from asrsim.scenario import load_scenario

        return load_scenario(examples_folder() / "scenarios" / f"{name}.yaml", variant=variant, overrides=overrides)[0]

    def run(
        self, name: str, variant: str, *, overrides: Sequence[str] = (), label: str | None = None, robot: Robot | None = None,
        log: bool = True,
    ) -> Result:  # fmt: skip
        """Run a variant of an example scenario.

        label: name of the run's folder after the scenario's, the variant if not given; robot: replaces the scenario's; log:
        write one. Raises what :func:`asrsim.run` raises.
        """
        from asrsim.api import run

        out = self.folder / f"{name}_{label or variant}" if log else None
        began = clock.perf_counter()
        scenario = self.scenario(name, variant, overrides)
        if overrides or robot is not None:
            # The example's claims are about the unchanged example.
            scenario = replace(scenario, expect=())
        result = run(scenario, robot=robot, out=out, overwrite=True)
        self.count(result.run.simulated_time, clock.perf_counter() - began)
        return result

    def pairs(self, name: str, variants: Sequence[str]) -> dict[str, Result]:
        """Several variants, by name."""
        return {variant: self.run(name, variant) for variant in variants}

    def count(self, simulated: float, seconds: float) -> None:
        """Note simulated time and the wall-clock time that it took."""
        self.simulated += simulated
        self.simulating += seconds


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of all figures."""

    figures: tuple[Reproduction, ...]
    page: Path
    seconds: float
    """Wall-clock time of everything."""

    @property
    def holds(self) -> bool:
        """Whether every claim of every figure holds."""
        return all(figure.holds for figure in self.figures)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "ok": self.holds, "page": str(self.page), "wall_time": self.seconds,
            "simulated_time": sum(figure.simulated for figure in self.figures),
            "figures": [figure.as_dict() for figure in self.figures],
        }  # fmt: skip


@cache
def figures() -> dict[str, Figure]:
    """The figures of `examples/paper` by number, as text. Raises InputError if this installation has no examples."""
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
) -> Outcome:  # fmt: skip
    """Run figures, judge them, and write `reproduce.html`, `reproduce.json`, the pictures and the runs' logs into `folder`.

    names: of :func:`figures`, all by default; on_figure: told of each as it ends, in any order. A figure that cannot be run
    is reported, its claims do not hold, and the others go on.
    Raises InputError for unknown figures and OutputError where something cannot be written.
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
    outcome = Outcome(figures=tuple(found), page=folder / "reproduce.html", seconds=clock.perf_counter() - began)
    for path, data in _pictures(found, folder / "pictures"):
        with written(path, "picture") as stream:
            stream.write(data)
    write_text(outcome.page, page(outcome.figures, seconds=outcome.seconds), "page")
    write_json(folder / "reproduce.json", outcome.as_dict())
    return outcome


def run_figure(name: str, folder: Path) -> Reproduction:
    """Run one figure, its logs going into `folder`; an error becomes part of the result."""
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
