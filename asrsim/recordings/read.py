"""`read_recording`: one entry to every format, and several files of one experiment as one recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from asrsim.document.mistaken import DOCUMENTS, mistaken
from asrsim.errors import Problem, RecordingError
from asrsim.plain import one_or_more
from asrsim.recordings.build import build
from asrsim.recordings.data import RawSeries, Recording
from asrsim.recordings.formats import content_of
from asrsim.recordings.reading import Reading, is_document, load_reading, resolve_reading
from asrsim.recordings.times import series_of
from asrsim.samples import Array


def read_recording(
    path: str | PathLike[str],
    *,
    mapping: Mapping[str, str] | Sequence[str] | Path | None = None,
    joints: Sequence[str] | None = None,
    rate: float | None = None,
) -> Recording:
    """Reads an experiment's file.

    Args:
        path: A file of any format in :data:`asrsim.recordings.READERS`; `command.csv+response.csv` joins files of one
            experiment; a document with the key `file` stands for the recording that it describes.
        mapping: What columns are: items `COLUMN=JOINT.QUANTITY [unit]` (or `COLUMN=time [ms]`, `COLUMN=ignore`), a table of the
            same, or a document that is read in place of the one beside the file, `lab.csv.yaml`. Items overrule documents.
        joints: Of the simulation; numbers in columns' names count them.
        rate: Hz; replaces the file's time by an even one from 0.

    Returns:
        The recording in SI units with all findings.

    Raises:
        RecordingError: With what was found and what was expected.
    """
    path, joints = Path(path), None if joints is None else one_or_more(joints)
    if is_document(str(path)) and mapping is None:
        with suppress(RecordingError):  # any other file may be called so, too
            described = load_reading(path).file
            path, mapping = (path, None) if described is None else (path.parent / described, path)
    return read_parts(path, mapping=mapping, joints=joints, rate=rate)[1]


def read_parts(
    path: Path, *, mapping: Mapping[str, str] | Sequence[str] | Path | None, joints: Sequence[str] | None, rate: float | None,
    beside: bool = True,
) -> tuple[list[Part], Recording]:  # fmt: skip
    """The files of a recording as they were read, and the recording. beside: documents beside the files are read, too."""
    parts = parts_of(path)
    findings: list[Problem] = []
    read = [_read(part, resolve_reading(mapping, part, rate, beside=beside), findings, partly=len(parts) > 1) for part in parts]
    reading = read[0].reading
    if len(read) == 1:
        one = read[0]
        return read, build(path, one.content.format, one.series, reading, joints, findings=findings, epoch=one.epoch,
                           topics=one.content.topics)  # fmt: skip
    maps = {entry.column: entry for one in read for entry in one.reading.maps}
    series, epoch = _joined(parts, read, findings)
    reading = replace(reading, maps=tuple(maps.values()))
    return read, build(path, "joined", series, reading, joints, findings=findings, epoch=epoch)


class Part:
    """One file, read."""

    def __init__(self, path: Path, reading: Reading, findings: list[Problem], *, partly: bool) -> None:
        self.content, self.reading = content_of(path, reading), reading
        found: list[Problem] = [*self.content.findings]
        self.series, self.epoch = series_of(self.content, reading, found, partly=partly)
        findings += [replace(problem, file=problem.file or path) for problem in found]


def _read(path: Path, reading: Reading, findings: list[Problem], *, partly: bool) -> Part:
    """partly: a time that is stated may be in another file."""
    try:
        return Part(path, reading, findings, partly=partly)
    except RecordingError as error:
        # What was read is a recording, whatever its keys are called.
        other = mistaken(path, "recording") if path.suffix.lower() in (*DOCUMENTS, ".urdf", ".xacro") else None
        problems = [other] if other is not None else [replace(one, file=one.file or path) for one in error.problems]
        raise RecordingError(problems) from None


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


def _joined(parts: Sequence[Path], read: Sequence[Part], findings: list[Problem]) -> tuple[list[RawSeries], float | None]:
    """All series of the parts on one clock: by their Unix times where all have them, else as their clocks are.

    A part with one series, and names that repeat, get the file's name in front.
    """
    known = [one.epoch for one in read if one.epoch is not None]
    absolute = len(known) == len(read)
    zero = min(known) if absolute else 0.0
    if known and not absolute:
        without = ", ".join(part.name for part, one in zip(parts, read, strict=True) if one.epoch is None)
        findings.append(Problem(f"{without} has no date, the others have; all are taken to begin together", code="two-clocks"))
    count = Counter(series.name for one in read for series in one.series)
    joined: list[RawSeries] = []
    clocks: list[Array] = []
    for part, one in zip(parts, read, strict=True):
        # A float of 1.7e9 s resolves 2.4e-7 s.
        shift = round((one.epoch or 0.0) - zero, 6) if absolute else 0.0
        times: dict[int, Array] = {}
        for series in one.series:
            if id(series.time) not in times:
                shifted = series.time + shift
                same = next((clock for clock in clocks if np.array_equal(clock, shifted)), None)
                times[id(series.time)] = shifted if same is None else same
                clocks += [shifted] if same is None else []
            named = len(one.series) == 1 or count[series.name] > 1
            column = replace(series.column, name=f"{part.stem}/{series.name}") if named else series.column
            joined.append(
                replace(series, column=column, time=times[id(series.time)], part=part, label=series.name, shift=shift)
            )
    return joined, zero if absolute else None
