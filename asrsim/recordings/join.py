"""Several files of one experiment as one recording: the command in one, the response in another, or one signal a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from asrsim.errors import Problem
from asrsim.recordings.data import Raw, RawSeries
from asrsim.recordings.names import tokens_of
from asrsim.recordings.units import split_header
from asrsim.samples import Array

_SILENT = {"value", "values", "val", "data", "signal", "output", "y", "column", "field"}
"""Names of columns that say nothing."""


def parts_of(path: Path) -> tuple[Path, ...]:
    """The files of `command.csv+response.csv`, each sought as it is and beside the first; any other path is its only part."""
    names = str(path).split("+")
    if path.exists() or len(names) < 2:
        return (path,)
    first = Path(names[0])
    parts = [first, *(Path(name) if Path(name).exists() else first.with_name(name) for name in names[1:])]
    return tuple(parts) if any(part.exists() for part in parts) else (path,)


def name_of(path: Path) -> str:
    """A recording's name without its folders; of joined files with all of their names."""
    return "+".join(part.name for part in parts_of(path))


def alone(path: Path, raw: Raw) -> Raw:
    """A file's only series, whose column is called `value` or so, named by the file."""
    words = {word for word in tokens_of(raw.series[0].name) if not word.isdecimal()}
    if len(raw.series) > 1 or raw.series[0].quantity or not words <= _SILENT:
        return raw
    return replace(raw, series=(by_file(path, raw.series[0]),))


def by_file(part: Path, series: RawSeries) -> RawSeries:
    """A series with its file's name before its own, and the unit that stands there: `q1_deg.csv`."""
    stated = split_header(part.stem)[1] if split_header(series.name)[1] is None else None
    unit = series.unit or (stated.symbol if stated else "")
    return replace(series, name=f"{part.stem}/{series.name}", unit=unit, part=part, label=series.name)


def _shared(time: Array, clocks: list[Array]) -> Array:
    """The clock that is the same as this one, which joins the list if it is new."""
    found = next((clock for clock in clocks if np.array_equal(clock, time)), None)
    if found is None:
        clocks.append(time)
    return time if found is None else found


def join(path: Path, parts: Sequence[Path], raws: Sequence[Raw]) -> Raw:
    """All series of the parts on one clock: by their Unix times where all have them, else as their clocks are.

    A part with one series gives it its own name, which often says what it is; names that repeat get their file's in front.
    """
    epochs = [raw.epoch for raw in raws]
    known = [epoch for epoch in epochs if epoch is not None]
    absolute = len(known) == len(raws)
    zero = min(known) if absolute else 0.0
    findings = [problem for raw in raws for problem in raw.findings]
    if known and not absolute:
        without = ", ".join(part.name for part, epoch in zip(parts, epochs, strict=True) if epoch is None)
        findings.append(
            Problem(f"{without} has no date, the others have; all are taken to begin together", file=path, code="two-clocks")
        )
    count = Counter(series.name for raw in raws for series in raw.series)
    joined: list[RawSeries] = []
    clocks: list[Array] = []
    for part, raw in zip(parts, raws, strict=True):
        # A float of 1.7e9 s resolves 2.4e-7 s.
        shift = round((raw.epoch or 0.0) - zero, 6) if absolute else 0.0
        times = {id(series.time): _shared(series.time + shift, clocks) for series in raw.series}
        for series in raw.series:
            named = by_file(part, series) if len(raw.series) == 1 or count[series.name] > 1 else series
            joined.append(replace(named, time=times[id(series.time)], part=part, label=series.name, shift=shift))
    names = tuple(name for raw in raws for name in raw.names)
    return Raw(format="joined", series=tuple(joined), findings=tuple(findings), epoch=zero if absolute else None, names=names)
