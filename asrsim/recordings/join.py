"""Several files of one experiment as one recording: the command in one, the response in another, or one signal a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from asrsim.errors import Problem
from asrsim.recordings.data import Raw, RawSeries


def parts_of(path: Path) -> tuple[Path, ...]:
    """The files of `command.csv+response.csv`, each sought as it is and beside the first; any other path is its only part."""
    names = str(path).split("+")
    if path.exists() or len(names) < 2:
        return (path,)
    first = Path(names[0])
    parts = [first, *(Path(name) if Path(name).exists() else first.with_name(name) for name in names[1:])]
    return tuple(parts) if any(part.exists() for part in parts) else (path,)


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
            Problem(
                message=f"{without} has no date, the others have; all are taken to begin together", file=path, code="two-clocks"
            )
        )
    count = Counter(series.name for raw in raws for series in raw.series)
    joined: list[RawSeries] = []
    for part, raw in zip(parts, raws, strict=True):
        # A float of 1.7e9 s resolves 2.4e-7 s.
        shift = round((raw.epoch or 0.0) - zero, 6) if absolute else 0.0
        times = {id(series.time): series.time + shift if shift else series.time for series in raw.series}
        alone = len(raw.series) == 1
        for series in raw.series:
            name = f"{part.stem}/{series.name}" if alone or count[series.name] > 1 else series.name
            joined.append(replace(series, name=name, time=times[id(series.time)], part=part, label=series.name, shift=shift))
    names = tuple(name for raw in raws for name in raw.names)
    return Raw(format="joined", series=tuple(joined), findings=tuple(findings), epoch=zero if absolute else None, names=names)
