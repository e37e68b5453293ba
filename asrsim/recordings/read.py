"""`read_recording`: one entry to every format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from asrsim.document.mistaken import DOCUMENTS, mistaken
from asrsim.errors import Problem, RecordingError, similar_file
from asrsim.plain import one_or_more
from asrsim.quantities import QUANTITIES, unit_of
from asrsim.recordings.bags import read_bag
from asrsim.recordings.build import build
from asrsim.recordings.data import Raw, RawSeries, Recording
from asrsim.recordings.delimited import Table
from asrsim.recordings.join import alone, join, parts_of
from asrsim.recordings.mapping import ColumnMap, resolve_mapping
from asrsim.recordings.matlab import read_mat
from asrsim.recordings.names import find_column
from asrsim.recordings.read_csv import read_text, series_of
from asrsim.recordings.read_echo import is_echo, read_echo
from asrsim.recordings.read_json import is_json, read_json
from asrsim.recordings.sheets import SheetReader, sheet_reader

FORMATS = {
    ".csv": "delimited text", ".txt": "delimited text", ".tsv": "delimited text", ".dat": "delimited text",
    ".log": "delimited text", ".asc": "delimited text", ".mcap": "MCAP", ".bag": "ROS 1 bag", ".db3": "ROS 2 bag",
    ".mat": "MATLAB (to version 7)", ".npz": "numpy", ".npy": "numpy",
    ".xlsx": "Excel", ".parquet": "Parquet", ".feather": "Feather", ".json": "JSON", ".jsonl": "JSON", ".ndjson": "JSON",
}  # fmt: skip
"""File endings that are read; a folder with a metadata.yaml is a ROS 2 bag, any other ending is tried as text."""


def read_recording(
    path: str | PathLike[str],
    *,
    mapping: Mapping[str, str] | Sequence[str] | Path | None = None,
    joints: Sequence[str] | None = None,
    rate: float | None = None,
) -> Recording:
    """Reads an experiment's file.

    Args:
        path: Delimited text, JSON, a workbook, MCAP (of robots or our own logs), ROS 1 or ROS 2 bag, a MATLAB or numpy file;
            `command.csv+response.csv` joins files of one experiment.
        mapping: From columns to quantities: items `COLUMN=JOINT.QUANTITY [unit]` (or `COLUMN=time [ms]`,
            `COLUMN=ignore`), a table of the same, or a YAML file. Added to (and winning over) the YAML beside the file,
            `lab.csv.yaml` or `lab.map.yaml`. What is not mapped is guessed from names.
        joints: Joints of the simulation, for the guesses.
        rate: Hz; replaces the file's time by an even one from 0, for text and MATLAB files without a time.

    Returns:
        The recording in SI units with all findings; show `guess_rows(recording)` to the user.

    Raises:
        RecordingError: With what was found and what was expected.
    """
    path, joints = Path(path), None if joints is None else one_or_more(joints)
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise RecordingError("the sampling rate must be positive", value=rate, code="bad-rate")
    parts = parts_of(path)
    if len(parts) == 1:
        maps = resolve_mapping(mapping, path)
        return build(path, alone(path, _raw(path, maps, rate)), maps, joints)
    beside = [resolve_mapping(mapping, part) for part in parts]
    raws = [_raw(part, maps, rate, partly=True) for part, maps in zip(parts, beside, strict=True)]
    every = {(one.column, one.role): one for maps in beside for one in maps}
    return build(path, join(path, parts, raws), tuple(every.values()), joints)


def _raw(path: Path, maps: Sequence[ColumnMap], rate: float | None, *, partly: bool = False) -> Raw:
    """The series of one file; `partly`: a time that is mapped may be in another one."""
    if not path.exists():
        raise RecordingError("there is no such file", file=path, hint=similar_file(path), code="no-file")
    if path.is_file() and path.stat().st_size == 0:
        raise RecordingError("the file is empty", file=path, code="empty", hint="Expected a header and rows of numbers")
    suffix = path.suffix.lower()
    ignored = {one.column for one in maps if one.role == "ignore"}
    try:
        if path.is_dir():
            if not (path / "metadata.yaml").is_file():
                raise RecordingError("is a folder without a metadata.yaml, so no ROS 2 bag", file=path, code="no-bag")
            return read_bag(path, ignored)
        if suffix == ".mcap":
            return _own_log(path) if _is_own_log(path) else read_bag(path, ignored)
        if suffix in (".bag", ".db3"):
            return read_bag(path, ignored)
        if suffix in (".npz", ".npy") or (suffix == ".mat" and not _is_text(path)):
            return read_mat(path, maps, rate)
        if (reader := sheet_reader(path)) is not None:
            form, table = "sheet", _sheet(path, reader, maps)
        else:
            form, table = _text(path, maps)
        if partly:
            here = [one for one in maps if one.role != "time" or find_column(one.column, table.layout.names) is not None]
            maps = here
        return series_of(table, path, maps, rate, form=form)
    except RecordingError:
        # What was read is a recording, whatever its keys are called.
        other = mistaken(path, "recording") if suffix in (*DOCUMENTS, ".urdf", ".xacro") else None
        if other is None:
            raise
        raise RecordingError([other]) from None
    except OSError as error:
        raise RecordingError(f"cannot be read: {error.strerror or error}", file=path, code="no-file") from None


def _text(path: Path, maps: Sequence[ColumnMap]) -> tuple[str, Table]:
    """What kind of text it is, and its table."""
    if is_json(path):
        return "json", read_json(path)
    if is_echo(path):
        return "echo", read_echo(path)
    return "csv", read_text(path, maps)


def _sheet(path: Path, reader: SheetReader, maps: Sequence[ColumnMap]) -> Table:
    """A table that is no text, by way of the text that it would be exported as."""
    text, found = reader(path)
    with TemporaryDirectory(prefix="asrsim-sheet-") as folder:
        copy = Path(folder) / f"{path.stem}.csv"
        copy.write_bytes(text)
        try:
            table = read_text(copy, maps)
        except RecordingError as error:
            raise RecordingError([replace(problem, file=path) for problem in error.problems]) from None
    return replace(table, findings=(*found, *(replace(problem, file=path) for problem in table.findings)))


def _is_text(path: Path) -> bool:
    """Whether a .mat file is text, as MATLAB's `save -ascii` writes it."""
    with path.open("rb") as stream:
        start = stream.read(512)
    return start.isascii() and b"\0" not in start and any(chr(one).isdecimal() for one in start)


def _is_own_log(path: Path) -> bool:
    """Whether asrsim wrote the file: the MCAP header's library says so."""
    with path.open("rb") as stream:
        start = stream.read(128)
    return start[1:5] == b"MCAP" and b"asrsim " in start


def _own_log(path: Path) -> Raw:
    """A log of another run as a recording."""
    from asrsim.errors import LogError
    from asrsim.log import read_log

    try:
        log = read_log(path)
    except LogError as error:
        raise RecordingError(error.problems) from None
    slides = {info.name for info in log.info.joints if info.prismatic}
    series = [
        RawSeries(
            name=f"{joint}.{quantity}",
            time=log.samples.time,
            values=values,
            joint=joint,
            quantity=quantity,
            unit=unit_of(quantity, prismatic=joint in slides),
        )
        for joint in log.samples.joints
        for quantity, values in log.samples.joint(joint).items()
        if quantity in QUANTITIES
    ]
    if not series:
        raise RecordingError("the log holds nothing of any joint", file=path, code="no-columns")
    findings: tuple[Problem, ...] = ()
    if log.truncated:
        findings = (Problem("the log was cut off; read up to its last whole chunk", file=path, code="truncated"),)
    return Raw(format="asrsim", series=tuple(series), findings=findings)
