"""Registry of file readers, one for each format. Users add readers by entry points in the group `asrsim.recordings`."""

from __future__ import annotations

import json
import pickle
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, is_dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.confined.run import ConfinedError, run_confined
from asrsim.document.file import DOCUMENTS, lfs_pointer
from asrsim.errors import InputError, Problem, RecordingError, similar_file
from asrsim.quantities import DERIVED, QUANTITIES
from asrsim.recordings.arrays import read_arrow, read_matlab, read_numpy
from asrsim.recordings.bags import read_bag
from asrsim.recordings.data import Content, RawColumn, RawTable
from asrsim.recordings.folders import FOLDER, joined
from asrsim.recordings.joint_names import name_columns
from asrsim.recordings.reading import Reading
from asrsim.recordings.sheets import read_excel, read_json
from asrsim.recordings.text import read_text
from asrsim.registry import Registry, result_fault

SECONDS, RATE = 60.0, 1e6
"""Time limit for reading a file of a binary format. It is SECONDS s of wall-clock time, and a further second for each RATE
bytes of the file.
"""
MEMORY, RATIO = 2**30, 32
"""Memory limit for reading a file of a binary format. It is MEMORY bytes, and RATIO further bytes for each byte of the file.
The code of the libraries alone takes half of MEMORY.
"""


@dataclass(frozen=True, kw_only=True)
class Reader:
    """Reader of a file format."""

    suffixes: tuple[str, ...]
    read: Callable[[Path, Reading], Content]
    """Function that reads a file. It raises RecordingError for a known problem. Any other error is reported as a damaged
    file.
    """
    magic: tuple[bytes, ...] = ()
    """First bytes that identify the format. They have precedence over the ending of the file's name."""
    confined: bool = True
    """Whether the file is read in a child process with limits on time and memory. asrsim reads text and JSON without a child
    process.
    """

    def __post_init__(self) -> None:
        if not (isinstance(self.suffixes, tuple) and all(map(_is_suffix, self.suffixes))):
            valid = "must be a tuple of endings in lower case with their point, such as ('.lab',)"
            raise InputError(valid, key="suffixes", value=self.suffixes, code="reader")
        if not (isinstance(self.magic, tuple) and all(isinstance(one, bytes) for one in self.magic)):
            raise InputError("must be a tuple of bytes, such as (b'LAB1',)", key="magic", value=self.magic, code="reader")


def _is_suffix(ending: object) -> bool:
    """Whether this is a valid ending of file names. It must begin with a point and be in lower case, since endings are compared
    in lower case.
    """
    return isinstance(ending, str) and ending[:1] == "." and len(ending) > 1 and ending == ending.lower()


_CLASSES = {one.__name__: one for one in (Content, RawTable, RawColumn, Problem)}
"""Classes that the answer of the child process may contain, by name."""
OWN_READER = "A reader of your own needs --plugin FILE"
"""Hint for a file that no reader of asrsim can read."""
READERS: Registry[Reader] = Registry("file format", "asrsim.recordings", instance=Reader)
_OURS = {
    "text": Reader(suffixes=(".csv", ".tsv", ".txt", ".dat", ".log", ".asc"), read=read_text, confined=False),
    "json": Reader(suffixes=(".json", ".jsonl", ".ndjson"), read=read_json, magic=(b'{"', b"[{"), confined=False),
    "excel": Reader(suffixes=(".xlsx", ".xlsm", ".xls", ".ods"), read=read_excel, magic=(b"\xd0\xcf\x11\xe0",)),
    "matlab": Reader(suffixes=(".mat", ".h5", ".hdf5"), read=read_matlab, magic=(b"MATLAB ", b"\x89HDF")),
    "numpy": Reader(suffixes=(".npz", ".npy"), read=read_numpy, magic=(b"\x93NUMPY",)),
    "arrow": Reader(suffixes=(".parquet", ".feather"), read=read_arrow, magic=(b"PAR1", b"ARROW1")),
    "bag": Reader(suffixes=(".mcap", ".bag", ".db3"), read=read_bag, magic=(b"\x89MCAP0", b"#ROSBAG")),
}
"""Readers of asrsim, by name. All other readers belong to users."""
for _name, _reader in _OURS.items():
    READERS.own(_name, _reader)


def content_of(path: Path, reading: Reading) -> Content:
    """Content of the file, read by the reader of its format. Raises RecordingError."""
    try:
        name = format_of(path)
        if name == FOLDER:
            endings = {suffix for kind in READERS for suffix in READERS.get(kind).suffixes}
            return joined(path, lambda file: content_of(file, reading), endings)
        reader = READERS.get(name)
        found = _confined(name, path, reading) if reader.confined else checked(name, reader.read(path, reading), reading)
        return replace(found, format=name)
    except (OSError, UnicodeError) as error:
        raise RecordingError(f"cannot be read: {error}", code="no-file") from None


def format_of(path: Path) -> str:
    """Name of the reader of a file. A user's reader is preferred, by the ending of the file's name or by the first bytes of the
    file. Otherwise it is a reader of asrsim, by the first bytes or else by the ending. The reader of text reads all other
    files. Raises RecordingError.
    """
    if not path.exists():
        raise RecordingError("there is no such file", hint=similar_file(path), code="no-file")
    if path.is_dir():
        return "bag" if (path / "metadata.yaml").is_file() else FOLDER
    with path.open("rb") as stream:
        start = stream.read(512)
    if not start:
        raise RecordingError("the file is empty", code="empty", hint="Expected a header and rows of numbers")
    if (pointer := lfs_pointer(start, "recording")) is not None:
        raise RecordingError([pointer])
    readers = {name: READERS.get(name) for name in READERS}
    # Also compare the first bytes without blanks, since JSON may have blanks before and between its first characters.
    heads = start, b"".join(start.split())
    for name in sorted(readers, key=_OURS.__contains__):
        reader = readers[name]
        named = name not in _OURS and path.suffix.lower() in reader.suffixes
        if named or any(head.startswith(reader.magic) for head in heads):
            return name
    by_suffix = next((name for name, reader in readers.items() if path.suffix.lower() in reader.suffixes), "text")
    # Read text with any ending as text. For example, MATLAB's `save -ascii` writes text to .mat files.
    text = readers[by_suffix].confined and start.isascii() and b"\0" not in start
    return "text" if text else by_suffix


def with_reader_hint(problem: Problem, path: Path) -> Problem:
    """The problem of a file. If no reader is known for the file's ending, it gets a hint that users can add readers."""
    known = {suffix for name in READERS for suffix in READERS.get(name).suffixes}
    if path.suffix.lower() in ("", *known, *DOCUMENTS) or not path.is_file():
        return problem
    before = f"{problem.hint}{'' if problem.hint.endswith('?') else '.'} " if problem.hint else ""
    return problem if OWN_READER in before else replace(problem, hint=f"{before}{OWN_READER}")


def _confined(name: str, path: Path, reading: Reading) -> Content:
    """Content of a file, read in a child process, since a damaged file may crash a library or make it request all memory."""
    # The request is trusted, so it may contain a pickle. The answer is plain data, since it depends on a file that may have
    # been crafted to run code.
    request = {
        "root": str(Path(__file__).parents[2]),
        "reader": name,
        "path": str(path.resolve()),
        "reading": pickle.dumps(reading).hex(),
        "plugin": READERS.file_of(name),
    }
    size = sum(file.stat().st_size for file in ([path, *path.iterdir()] if path.is_dir() else [path]))
    limits = {"seconds": round(SECONDS + size / RATE), "memory": MEMORY + RATIO * size}
    try:
        return unpack(run_confined(Path(__file__).with_name("reader_child.py"), request, **limits))
    except ConfinedError as error:
        raise RecordingError(f"cannot be read: its reader {error}", code="damaged") from None


def answer_of(request: dict[str, str]) -> bytes:
    """Answer of the child process: the content or the problems, packed."""
    answer: Content | Sequence[Problem]
    try:
        reading = pickle.loads(bytes.fromhex(request["reading"]))
        if request["plugin"]:
            from asrsim.plugins import load_plugin_file

            load_plugin_file(request["plugin"])
        elif request["reader"] not in READERS:
            message = f"the reader '{request['reader']}' was added by the running program, and cannot run in a separate process"
            hint = "Add it in a file given to --plugin or to asrsim.plugins.load_plugin_file, or give it confined=False"
            raise RecordingError(message, hint=hint, code="own-reader")
        answer = checked(request["reader"], READERS.get(request["reader"]).read(Path(request["path"]), reading), reading)
    except InputError as error:
        answer = error.problems
    except MemoryError:
        message = "needs far more memory than a recording of its size"
        answer = [Problem(message, hint="If the file is not damaged, record it in shorter parts", code="memory")]
    except Exception as error:  # for damaged files, libraries raise errors of many types
        said = " ".join(str(error).split())[:200]
        message = f"cannot be read as {request['reader']}: {type(error).__name__} {said}".rstrip()
        answer = [Problem(message + _place_in_plugin(request["reader"], request["plugin"], error), code="damaged")]
    return pack(answer)


def checked(name: str, found: Any, reading: Reading) -> Content:
    """Content that the reader with this name returned, with its numbers as arrays.

    The content must be a `Content` of tables. The columns of a table must have names, and equally many numbers; a column of
    joint names contains texts. Otherwise raises RecordingError with the file and line of the reader.
    """
    function = READERS.get(name).read

    def refuse(message: str) -> RecordingError:
        return RecordingError(result_fault(function, f"the reader '{name}' {message}").problems)

    if not isinstance(found, Content):
        raise refuse(f"must return asrsim.recordings.data.Content; it returns a value of type {type(found).__name__}")
    tables, known = [], (*QUANTITIES, *DERIVED)
    for table in found.tables:
        if not isinstance(table, RawTable):
            raise refuse(f"must return tables (asrsim.recordings.data.RawTable); one is of type {type(table).__name__}")
        for column in table.columns:
            if not isinstance(column, RawColumn) or not isinstance(column.name, str):
                raise refuse(f"must return columns (asrsim.recordings.data.RawColumn) with texts as names; one is {column!r}")
            if name not in _OURS and column.quantity and column.quantity not in known:
                raise RecordingError(
                    f"the reader '{name}' states a quantity of the column '{column.name}' that does not exist",
                    value=column.quantity, choices=known, meant=column.quantity, code="no-such-quantity",
                )  # fmt: skip
        columns, names = [], name_columns([column.name for column in table.columns])
        for number, column in enumerate(table.columns):
            values = np.asarray(column.values)
            texts = number in names or column.name == reading.joint
            if values.ndim != 1 or values.dtype.kind not in ("biufU" if texts else "biuf"):
                told = f"has the shape {values.shape} and the type {values.dtype}"
                raise refuse(f"must return a list of numbers for each column; '{column.name}' {told}")
            columns.append(replace(column, values=values))
        lengths = {column.name: len(column.values) for column in columns}
        if len(set(lengths.values())) > 1:
            told = ", ".join(f"'{column}' has {length}" for column, length in lengths.items())
            raise refuse(f"must return columns of equal length in a table: {told}")
        tables.append(replace(table, columns=tuple(columns)))
    return replace(found, tables=tuple(tables))


def _place_in_plugin(name: str, plugin: str, error: Exception) -> str:
    """File and line at which a user's reader raised an error, as text; empty for readers of asrsim."""
    lines = [one.lineno for one in traceback.extract_tb(error.__traceback__) if plugin and one.filename == plugin]
    code = getattr(READERS.get(name).read, "__code__", None) if plugin else None
    if not lines and code is not None:  # Python refused to call the reader, since it takes other arguments
        return f" ({plugin}:{code.co_firstlineno})"
    return f" ({plugin}:{lines[-1]})" if lines else ""


def pack(answer: Content | Sequence[Problem]) -> bytes:
    """Content or problems as bytes: JSON and NumPy arrays in one archive, which contains no executable code."""
    arrays: list[NDArray[Any]] = []

    def plain(one: Any) -> Any:
        if isinstance(one, np.ndarray):
            arrays.append(one)
            return {"array": f"arr_{len(arrays) - 1}"}
        return {type(one).__name__: vars(one)} if is_dataclass(one) else str(one)

    head = json.dumps(answer, default=plain)
    stream = BytesIO()
    np.savez(stream, *arrays, head=np.array(head))
    return stream.getvalue()


def unpack(data: bytes) -> Content:
    """Content from the bytes that `pack` returns. Raises RecordingError if the bytes contain problems."""
    arrays = np.load(BytesIO(data), allow_pickle=False)

    def built(found: dict[str, Any]) -> Any:
        name = next(iter(found), "")
        if name == "array":
            return arrays[found[name]]
        if name == "Problem":
            found[name]["choices"] = tuple(found[name]["choices"])
        return _CLASSES[name](**found[name]) if name in _CLASSES else found

    answer = json.loads(str(arrays["head"]), object_hook=built)
    if isinstance(answer, Content):
        return answer
    raise RecordingError(answer)
