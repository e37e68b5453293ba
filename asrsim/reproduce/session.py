"""Several figures at once, on several processes, into one folder."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from asrsim.errors import AsrsimError
from asrsim.outfile import make_folder, write_json, write_text, written
from asrsim.reproduce.figure import FIGURES, Reproduction
from asrsim.workers import Lost, executor

PAGE, NUMBERS, PICTURES, RUNS = "reproduce.html", "reproduce.json", "pictures", "runs"
"""Names in the folder."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of all figures."""

    figures: tuple[Reproduction, ...]
    page: Path
    numbers: Path
    seconds: float
    """Wall-clock time of everything."""

    @property
    def holds(self) -> bool:
        """Whether every claim of every figure holds."""
        return all(figure.holds for figure in self.figures)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "ok": self.holds,
            "page": str(self.page),
            "wall_time": self.seconds,
            "simulated_time": sum(figure.simulated for figure in self.figures),
            "figures": [figure.as_dict() for figure in self.figures],
        }


def reproduce(
    names: Sequence[str] = (),
    folder: Path = Path("out/reproduce"),
    *,
    processes: int = 2,
    on_figure: Callable[[Reproduction], None] | None = None,
) -> Outcome:
    """Run figures, judge them, and write `reproduce.html`, `reproduce.json`, the pictures and the runs' logs into `folder`.

    names: of :data:`FIGURES`, all by default; on_figure: told of each as it ends, in any order. A figure that cannot be run
    is reported, its claims do not hold, and the others go on.
    Raises InputError for unknown figures and OutputError where something cannot be written.
    """
    chosen = sorted(dict.fromkeys(names or FIGURES.names()), key=lambda name: FIGURES.get(name).number)
    # The longest first, so that no process is left alone with it at the end.
    order = sorted(chosen, key=lambda name: -FIGURES.get(name).cost)
    began = clock.perf_counter()
    make_folder(folder / RUNS)
    found: dict[str, Reproduction] = {}
    with executor(min(processes, len(order))) as workers:
        for number, one in chain.from_iterable(workers.results(partial(run_figure, folder=folder / RUNS), order)):
            name = order[number]
            found[name] = _unfinished(name, one.reason) if isinstance(one, Lost) else one
            if on_figure is not None:
                on_figure(found[name])
    outcome = Outcome(
        figures=tuple(found[name] for name in chosen),
        page=folder / PAGE,
        numbers=folder / NUMBERS,
        seconds=clock.perf_counter() - began,
    )
    _write(folder, outcome)
    return outcome


def run_figure(name: str, folder: Path) -> Reproduction:
    """Run one figure, its logs going into `folder`; an error becomes part of the result."""
    from asrsim.reproduce.lab import Lab

    began = clock.perf_counter()
    lab = Lab(folder=folder)
    try:
        done = replace(_unfinished(name, ""), parts=FIGURES.get(name).parts(lab))
    except AsrsimError as caught:
        done = _unfinished(name, str(caught))
    return replace(done, simulated=lab.simulated, simulating=lab.simulating, seconds=clock.perf_counter() - began)


def _unfinished(name: str, error: str) -> Reproduction:
    figure = FIGURES.get(name)
    return Reproduction(
        number=figure.number, title=figure.title, section=figure.section, paper=figure.paper, parts=(), error=error,
    )  # fmt: skip


def _write(folder: Path, outcome: Outcome) -> None:
    from asrsim.reproduce.page import page

    make_folder(folder / PICTURES)
    done: set[Path] = set()
    for figure in outcome.figures:
        for part in figure.parts:
            for picture in part.pictures:
                path = folder / PICTURES / f"{picture.name}.{picture.kind}"
                with written(path, "picture", replace=path in done) as stream:
                    stream.write(picture.data)
                done.add(path)
    write_text(outcome.page, page(outcome.figures, seconds=outcome.seconds), "page")
    write_json(outcome.numbers, outcome.as_dict())
