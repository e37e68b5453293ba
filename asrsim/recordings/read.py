"""`read_recording`: one entry to every format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from os import PathLike
from pathlib import Path

from asrsim.document.mistaken import DOCUMENTS, mistaken
from asrsim.errors import Problem, RecordingError
from asrsim.plain import one_or_more
from asrsim.recordings.build import build
from asrsim.recordings.data import Content, RawSeries, Recording
from asrsim.recordings.formats import content_of
from asrsim.recordings.reading import Reading, is_document, load_reading, resolve_reading
from asrsim.recordings.times import series_of


def read_recording(
    path: str | PathLike[str],
    *,
    mapping: Mapping[str, str] | Sequence[str] | Path | None = None,
    joints: Sequence[str] | None = None,
    rate: float | None = None,
) -> Recording:
    """Reads an experiment's file.

    Args:
        path: A file of any format in :data:`asrsim.recordings.READERS`; a document with the key `file` stands for the recording
            that it describes.
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
    return read_series(path, resolve_reading(mapping, path, rate), joints)[2]


def read_series(
    path: Path, reading: Reading, joints: Sequence[str] | None
) -> tuple[Content, list[RawSeries], Recording]:  # fmt: skip
    """What the file holds, its series on their clean times, and the recording."""
    findings: list[Problem] = []
    try:
        content = content_of(path, reading)
        findings += content.findings
        series, epoch = series_of(content, reading, findings)
        recording = build(
            path, content.format, series, reading, joints, findings=findings, epoch=epoch, topics=content.topics
        )  # fmt: skip
    except RecordingError as error:
        # What was read is a recording, whatever its keys are called.
        other = mistaken(path, "recording") if path.suffix.lower() in (*DOCUMENTS, ".urdf", ".xacro") else None
        problems = [other] if other is not None else [replace(one, file=one.file or path) for one in error.problems]
        raise RecordingError(problems) from None
    return content, series, recording
