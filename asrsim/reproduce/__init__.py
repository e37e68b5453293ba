"""Repeats the experiments of the paper, checks the paper's claims, and writes one page about them (`asrsim reproduce`).

The experiments are examples (`examples/paper`), with one file for each figure; `asrsim.reproduce.data` defines their parts.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from asrsim.errors import AsrsimError, InputError
from asrsim.outfile import make_folder, write_json, write_text, written
from asrsim.reproduce.data import (
    Claim,
    Evidence,
    FigureBound,
    FigureOutcome,
    FigurePart,
    FigurePicture,
    FigureTable,
    PaperFigure,
    Reproduction,
    above,
    at_least,
    at_most,
    below,
    figures,
    near,
)
from asrsim.reproduce.page import page
from asrsim.workers import Lost
from asrsim.workers.local import Processes

__all__ = [
    "Claim",
    "Evidence",
    "FigureBound",
    "FigureOutcome",
    "FigurePart",
    "FigurePicture",
    "FigureTable",
    "PaperFigure",
    "Reproduction",
    "above",
    "at_least",
    "at_most",
    "below",
    "figures",
    "near",
    "reproduce",
]


def reproduce(
    names: Sequence[str] = (),
    folder: Path = Path("out/reproduce"),
    *,
    workers: int = 2,
    on_figure: Callable[[Reproduction], None] | None = None,
) -> FigureOutcome:
    """Reproduce figures, and write `reproduce.html`, `reproduce.json`, pictures and the logs of the runs into `folder`.

    names: numbers of the figures, all by default; workers: number of processes; on_figure: function that is called with the
    result of each figure when this result is available, in any order. If a figure cannot be run, its result states the reason,
    its claims count as failed, and the other figures continue.
    Raises InputError for unknown figures and OutputError if a file cannot be written.
    """
    known = figures()
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"no figure is called '{unknown[0]}'", choices=tuple(known), code="unknown-figure")
    order = sorted(set(names or known), key=lambda name: -known[name].cost)
    began = clock.perf_counter()
    make_folder(folder / "runs")
    make_folder(folder / "pictures")
    found, task, count = [], partial(run_figure, folder=folder / "runs"), min(workers, len(order))
    with ExitStack() as stack:
        results: Iterable[tuple[int, Any]] = enumerate(map(task, order))
        if count > 1:
            results = chain.from_iterable(stack.enter_context(Processes(count)).results(task, order))
        for number, one in results:
            found.append(Reproduction(name=order[number], error=one.reason) if isinstance(one, Lost) else one)
            if on_figure is not None:
                on_figure(found[-1])
    found.sort(key=lambda one: int(one.name))
    outcome = FigureOutcome(figures=tuple(found), page=folder / "reproduce.html", seconds=clock.perf_counter() - began)
    for picture in (picture for one in found for part in one.parts for picture in part.pictures):
        with written(folder / "pictures" / f"{picture.name}.{picture.kind}", "picture") as stream:
            stream.write(picture.data)
    write_text(outcome.page, page(outcome.figures, seconds=outcome.seconds), "page")
    write_json(folder / "reproduce.json", outcome.as_dict())
    return outcome


def run_figure(name: str, folder: Path) -> Reproduction:
    """Run the experiments of one figure, with their logs in `folder`, and return the result. An error is part of the result."""
    began = clock.perf_counter()
    try:
        done = Reproduction(name=name, parts=figures()[name].parts(folder))
    except AsrsimError as caught:
        done = Reproduction(name=name, error=str(caught))
    return replace(done, seconds=clock.perf_counter() - began)
