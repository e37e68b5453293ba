"""Readers of file formats: one each, in a registry that users extend by the entry point group `asrsim.recordings`."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.confined import ConfinedError, run_confined
from asrsim.errors import AsrsimError, InputError, Problem, RecordingError, similar_file
from asrsim.recordings.arrays import read_matlab, read_numpy
from asrsim.recordings.bags import read_bag
from asrsim.recordings.data import Content, RawColumn, RawTable
from asrsim.recordings.reading import ColumnMap, Reading, TimeKeys
from asrsim.recordings.sheets import is_json, read_arrow, read_excel, read_json
from asrsim.recordings.text import read_text
from asrsim.recordings.units import Unit
from asrsim.registry import Registry

SECONDS = 300.0
"""Of wall clock that a reader of a binary format may take."""
LEAST, RATIO = 256 * 2**20, 50
"""Bytes that any file may unpack to, and times its own size; measured signals in text compress by 3 to 30."""


@dataclass(frozen=True, kw_only=True)
class Reader:
    """What reads a file format."""

    suffixes: tuple[str, ...]
    read: Callable[[Path, Reading], Content]
    """Raises RecordingError with what is wrong; other errors are taken for damage of the file."""
    magic: tuple[bytes, ...] = ()
    """First bytes by which it is known, whatever its name ends in."""
    doc: str
    """For tables: what is read."""
    confined: bool = True
    """It is read in a process of its own, bounded in time and memory: every format but text."""


READERS: Registry[Reader] = Registry("file format", "asrsim.recordings", instance=Reader)
for _name, _reader in {
    "text": Reader(
        suffixes=(".csv", ".tsv", ".txt", ".dat", ".log", ".asc"), read=read_text, confined=False, doc="delimited text"
    ),
    "json": Reader(suffixes=(".json", ".jsonl", ".ndjson"), read=read_json, confined=False, doc="records, or lists by name"),
    "excel": Reader(
        suffixes=(".xlsx", ".xlsm", ".xls", ".ods"), read=read_excel, magic=(b"\xd0\xcf\x11\xe0",),
        doc="workbooks of Excel and LibreOffice",
    ),
    "matlab": Reader(
        suffixes=(".mat", ".h5", ".hdf5"), read=read_matlab, magic=(b"MATLAB ", b"\x89HDF"),
        doc="MATLAB; version 7.3 and other HDF5 files with the extra `hdf5`",
    ),
    "numpy": Reader(suffixes=(".npz", ".npy"), read=read_numpy, magic=(b"\x93NUMPY",), doc="NumPy's arrays"),
    "arrow": Reader(
        suffixes=(".parquet", ".feather"), read=read_arrow, magic=(b"PAR1", b"ARROW1"),
        doc="Parquet and Feather, with the extra `sweep`",
    ),
    "bag": Reader(
        suffixes=(".mcap", ".bag", ".db3"), read=read_bag, magic=(b"\x89MCAP0", b"#ROSBAG"),
        doc="ROS 1 and ROS 2 bags, MCAP files, our own logs",
    ),
}.items():  # fmt: skip
    READERS.add(_name, _reader)

_KNOWN = {
    b"\x80\x03": "a pickle of Python", b"\x80\x04": "a pickle of Python", b"\x80\x05": "a pickle of Python",
    b"PK\x03\x04": "a zip archive", b"\x1f\x8b": "compressed by gzip", b"BZh": "compressed by bzip2",
    b"\xfd7zXZ": "compressed by xz", b"7z\xbc\xaf": "a 7z archive", b"Rar!": "a rar archive",
    b"\x28\xb5\x2f\xfd": "compressed by zstd", b"\x02P": "a C3D file of markers", b"TDSm": "a TDMS file of LabVIEW",
    b"MDF     ": "a measurement file by ASAM (MDF)", b"%PDF": "a PDF document", b"<": "HTML or XML", b"\x89PNG": "a picture",
    b"\xff\xd8\xff": "a picture", b"SQLite format 3": "a database; ROS 2 bags end in .db3",
}  # fmt: skip
"""First bytes of files that laboratories have and that are not read here."""


def content_of(path: Path, reading: Reading) -> Content:
    """What the file holds, by the reader of its format. Raises RecordingError with what was found and expected."""
    name = format_of(path)
    reader = READERS.get(name)
    try:
        found = _confined(name, path, reading) if reader.confined else reader.read(path, reading)
        tables = tuple(_without(table, reading.missing) for table in found.tables)
        return replace(found, tables=tables, findings=tuple(replace(one, file=path) for one in found.findings))
    except RecordingError as error:
        raise RecordingError([replace(problem, file=problem.file or path) for problem in error.problems]) from None
    except OSError as error:
        raise RecordingError(f"cannot be read: {error.strerror or error}", file=path, code="no-file") from None


def _without(table: RawTable, missing: float | None) -> RawTable:
    """The table without the number that stands for a missing one."""
    if missing is None:
        return table
    return replace(
        table, columns=tuple(replace(one, values=np.where(one.values == missing, np.nan, one.values)) for one in table.columns)
    )


def format_of(path: Path) -> str:
    """Name of the reader: by the first bytes, else by the ending, else as text. Raises RecordingError."""
    if not path.exists():
        raise RecordingError("there is no such file", file=path, hint=similar_file(path), code="no-file")
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise RecordingError("is a folder without a metadata.yaml, so no ROS 2 bag", file=path, code="no-bag")
        return "bag"
    with path.open("rb") as stream:
        start = stream.read(512)
    if not start:
        raise RecordingError("the file is empty", file=path, code="empty", hint="Expected a header and rows of numbers")
    readers = {name: READERS.get(name) for name in READERS}
    suffix = path.suffix.lower()
    by_suffix = next((name for name, reader in readers.items() if suffix in reader.suffixes), None)
    by_magic = next((name for name, reader in readers.items() if reader.magic and start.startswith(reader.magic)), None)
    found = by_magic or by_suffix
    what = next((what for magic, what in _KNOWN.items() if start.startswith(magic)), None)
    if what is not None and by_magic is None and (found is None or not readers[found].confined):
        raise RecordingError(
            f"is {what}, which is not read here", file=path, code="foreign-format", hint=f"Read are {_formats()}"
        )
    # Text under another ending, as MATLAB's `save -ascii` writes it.
    text = start.isascii() and b"\0" not in start
    if found is None or (by_magic is None and readers[found].confined and text):
        return "json" if is_json(path) else "text"
    return "json" if found == "text" and is_json(path) else found


def _formats() -> str:
    return ", ".join(suffix for name in READERS for suffix in READERS.get(name).suffixes)


def _confined(name: str, path: Path, reading: Reading) -> Content:
    """A reader's content from a process of its own: damaged files crash libraries, or make them ask for all memory."""
    if path.is_file() and zipfile.is_zipfile(path):
        _check_unpacked(path)
    request = {
        "root": str(Path(__file__).parents[2]),
        "reader": name,
        "path": str(path.resolve()),
        "reading": pack(reading).hex(),
    }
    try:
        answer = run_confined(Path(__file__).with_name("reader_child.py"), request, seconds=SECONDS)
    except ConfinedError as error:
        raise RecordingError(f"cannot be read: its reader {error}", file=path, code="damaged") from None
    found = unpack(answer)
    if isinstance(found, Content):
        return found
    raise RecordingError(found)


def answer_of(request: dict[str, str]) -> bytes:
    """What the child process answers: a packed content, or the problems."""
    path = Path(request["path"])
    try:
        return pack(READERS.get(request["reader"]).read(path, unpack(bytes.fromhex(request["reading"]))))
    except InputError as error:
        return pack(error.problems)
    except AsrsimError as error:
        return pack((Problem(str(error), code="damaged"),))
    except MemoryError:
        return pack((Problem("cannot be read: it needs too much memory", code="too-large"),))
    except Exception as error:  # on damaged files libraries let errors of many kinds through
        said = " ".join(str(error).split())[:200]
        return pack(
            (Problem(f"cannot be read as {request['reader']}: {type(error).__name__} {said}".rstrip(), code="damaged"),)
        )


def _check_unpacked(path: Path) -> None:
    """A bound on what an archive may unpack to, before it is unpacked: a few kB may stand for all memory."""
    packed = path.stat().st_size
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(one.file_size for one in archive.infolist())
    except (zipfile.BadZipFile, ValueError) as error:
        raise RecordingError(f"cannot be unpacked: {error}", file=path, code="damaged") from None
    if size > max(LEAST, RATIO * packed):
        bound = f"at most {LEAST / 2**20:.0f} MiB or {RATIO} times the file are unpacked"
        raise RecordingError(
            f"would unpack to {size / 2**20:.0f} MiB, from {packed / 2**20:.3g}; {bound}", file=path, code="too-large",
            hint="If you trust it, unpack it by its own tools first, or export it as CSV",
        )  # fmt: skip


_CLASSES = {one.__name__: one for one in (Content, RawTable, RawColumn, Problem, Reading, TimeKeys, ColumnMap, Unit)}


def pack(value: Any) -> bytes:
    """Data of these classes as bytes that hold no code: a line of JSON, and behind it NumPy's arrays."""
    arrays: dict[str, Any] = {}

    def plain(one: Any) -> Any:
        if isinstance(one, np.ndarray):
            arrays[str(len(arrays))] = one
            return {"array": str(len(arrays) - 1)}
        if is_dataclass(one):
            return {
                "class": type(one).__name__,
                "fields": {field.name: plain(getattr(one, field.name)) for field in fields(one)},
            }
        if isinstance(one, tuple | list):
            return [plain(item) for item in one]
        if isinstance(one, dict):
            return {"table": {key: plain(item) for key, item in one.items()}}
        return {"path": str(one)} if isinstance(one, Path) else one

    head = json.dumps(plain(value)).encode()
    stream = BytesIO()
    np.savez(stream, **arrays)
    return head + b"\n" + stream.getvalue()


def unpack(data: bytes) -> Any:
    """The reverse of :func:`pack`; lists come back as tuples."""
    head, _, rest = data.partition(b"\n")
    arrays = np.load(BytesIO(rest), allow_pickle=False)

    def built(one: Any) -> Any:
        if isinstance(one, list):
            return tuple(built(item) for item in one)
        if not isinstance(one, dict):
            return one
        if "class" in one:
            return _CLASSES[one["class"]](**{name: built(item) for name, item in one["fields"].items()})
        if "array" in one:
            return arrays[one["array"]]
        return Path(one["path"]) if "path" in one else {key: built(item) for key, item in one["table"].items()}

    return built(json.loads(head))
