"""Several figures at once, on several processes, into one folder."""

from __future__ import annotations

import json
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from asrsim.errors import AsrsimError
from asrsim.outfile import make_folder, write_text, written
from asrsim.processes import end_with_parent
from asrsim.reproduce.figure import FIGURES, Reproduction

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
    with _mapping(min(processes, len(order))) as each:
        for name, one in each(partial(run_figure, folder=folder / RUNS), order):
            found[name] = one
            if on_figure is not None:
                on_figure(one)
    outcome = Outcome(
        figures=tuple(found[name] for name in chosen),
        page=folder / PAGE,
        numbers=folder / NUMBERS,
        seconds=clock.perf_counter() - began,
    )
    _write(folder, outcome)
    return outcome


def run_figure(name: str, folder: Path) -> tuple[str, Reproduction]:
    """Run one figure, its logs going into `folder`; an error becomes part of the result."""
    from asrsim.reproduce.lab import Lab

    figure = FIGURES.get(name)
    began = clock.perf_counter()
    lab = Lab(folder=folder)
    error = ""
    try:
        parts = figure.parts(lab)
    except AsrsimError as caught:
        parts, error = (), str(caught)
    return name, Reproduction(
        number=figure.number,
        title=figure.title,
        section=figure.section,
        paper=figure.paper,
        parts=parts,
        error=error,
        simulated=lab.simulated,
        simulating=lab.simulating,
        seconds=clock.perf_counter() - began,
    )


@contextmanager
def _mapping(processes: int) -> Iterator[Any]:
    """A `map` that gives results as they come: here, or in so many fresh processes, which end with the context."""
    if processes <= 1:
        yield map
        return
    from multiprocessing import get_context

    # Fresh interpreters: engines and threads do not survive a fork. Ctrl-C is ours to handle: leaving the context ends them.
    with get_context("spawn").Pool(processes, initializer=end_with_parent) as pool:
        yield pool.imap_unordered


def _write(folder: Path, outcome: Outcome) -> None:
    from asrsim import __version__
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
    write_text(outcome.page, page(outcome.figures, version=__version__, seconds=outcome.seconds), "page")
    numbers = {"generator": f"asrsim {__version__}", **outcome.as_dict()}
    write_text(outcome.numbers, json.dumps(numbers, indent=2, ensure_ascii=False) + "\n", "json")
