"""Reads arrays by name: MATLAB's files, HDF5 and NumPy's. Vectors of one length in one struct are a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError, listed
from asrsim.extras import library
from asrsim.recordings.data import Content, RawColumn, RawTable
from asrsim.recordings.reading import Reading
from asrsim.recordings.times import is_time

_LABELS = ("label", "name", "Name", "blockName")
"""Fields in which a struct says what it is called, as Simulink's signals do."""
_MOST = 512 * 2**20
"""Bytes of all numbers of a file."""
Columns = dict[str, list[RawColumn]]
"""Name of a variable -> its columns: one of a vector, several of a matrix."""


def read_matlab(path: Path, reading: Reading) -> Content:
    """A MATLAB file: by SciPy up to version 7, by h5py from 7.3 on."""
    with path.open("rb") as stream:
        start = stream.read(520)
    if start.startswith(b"\x89HDF") or start[512:516] == b"\x89HDF":
        h5py = library("h5py", "hdf5")
        with h5py.File(path) as file:
            return _content("matlab", _of_group(h5py, file), [], reading)
    from scipy.io import loadmat

    found = loadmat(path, simplify_cells=True)
    return _content("matlab", {name: value for name, value in found.items() if not name.startswith("__")}, [], reading)


def read_numpy(path: Path, reading: Reading) -> Content:
    """Arrays by name; structured ones as the tables that they are."""
    findings: list[Problem] = []
    loaded = np.load(path)
    if isinstance(loaded, np.ndarray):
        return _content("numpy", _fields(loaded, path.stem), findings, reading)
    found: dict[str, Any] = {}
    with loaded as arrays:
        for name in arrays.files:
            try:
                found |= _fields(arrays[name], name)
            except ValueError as error:
                if "pickle" not in str(error):
                    raise
                # To read objects of Python would run what they hold.
                findings.append(Problem("holds objects of Python, which are not read", key=name, code="objects"))
    return _content("numpy", found, findings, reading)


def _fields(array: NDArray[Any], name: str) -> dict[str, Any]:
    names = array.dtype.names
    return {name: array} if names is None else {name: {field: array[field] for field in names}}


def _of_group(h5py: Any, group: Any) -> dict[str, Any]:
    """What an HDF5 group holds; MATLAB writes arrays with their axes turned round, and text as codes."""
    found: dict[str, Any] = {}
    for name, item in group.items():
        if name.startswith("#"):
            continue
        if isinstance(item, h5py.Group):
            found[name] = _of_group(h5py, item)
        elif item.dtype.kind in "fiub":
            text = item.attrs.get("MATLAB_class") == b"char"
            found[name] = "".join(map(chr, np.ravel(item[()]))) if text else np.asarray(item[()]).T
        else:
            found[name] = object()
    return found


def _content(form: str, tree: Mapping[str, Any], findings: list[Problem], reading: Reading) -> Content:
    tables = list(_tables(tree, "", {}, findings, {*reading.time.columns}))
    if sum(column.values.nbytes for table in tables for column in table.columns) > _MOST:
        raise RecordingError(f"its arrays take more than {_MOST / 2**20:.0f} MiB", code="too-large")
    if not tables:
        raise RecordingError(
            findings or Problem("holds no series of numbers", code="no-numbers",
                                hint="Expected vectors with a time beside them, a struct with both, or a matrix of them")
        )  # fmt: skip
    return Content(format=form, tables=tuple(tables), findings=tuple(findings))


def _tables(
    struct: Mapping[str, Any], prefix: str, above: Columns, findings: list[Problem], stated: set[str]
) -> Iterator[RawTable]:
    """Tables of a struct and of those in it. above: times of the structs around it; stated: names of the time."""
    columns: Columns = {}
    inner: list[tuple[str, Mapping[str, Any]]] = []
    for name, value in struct.items():
        if isinstance(value, Mapping):
            inner.append((f"{prefix}{name}.{_label(value, '')}", value))
        elif isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.dtype == object and value.ndim):
            for i, item in enumerate(np.ravel(np.asarray(value, dtype=object)) if isinstance(value, np.ndarray) else value):
                if isinstance(item, Mapping):
                    label = _label(item, f"[{i}].")
                    inner.append((f"{prefix}{name}{'' if label[0] == '[' else '.'}{label}", item))
                elif isinstance(item, np.ndarray):
                    columns |= _columns(f"{prefix}{name}[{i}]", item)
        elif type(value).__name__ in ("MatlabOpaque", "MatlabFunction", "MatlabObject", "object"):
            findings.append(
                Problem("is an object of MATLAB (timeseries, table, function), which is not read", key=prefix + name,
                        code="mat-object", hint="Save its parts, for example s.time = ts.Time; s.data = ts.Data")
            )  # fmt: skip
        else:
            columns |= _columns(f"{prefix}{name}", value)
    times = {
        name: own for name, own in columns.items() if len(own) == 1 and (is_time(name.rpartition(".")[2]) or name in stated)
    }
    times = {**{name: own for name, own in above.items() if name not in times}, **times}
    lengths = dict.fromkeys(len(own[0].values) for own in columns.values())
    for length in lengths:
        group = {name: own for name, own in columns.items() if len(own[0].values) == length}
        clock = {name: own for name, own in times.items() if len(own[0].values) == length}
        if clock:
            merged = {**clock, **group}
            if len(merged) > len(clock):
                yield RawTable(columns=tuple(column for own in merged.values() for column in own))
            continue
        matrices = [own for own in group.values() if len(own) > 1]
        vectors = tuple(column for own in group.values() if len(own) == 1 for column in own)
        yield from (RawTable(columns=tuple(own)) for own in matrices)
        if vectors and (times or matrices):
            names = listed([column.name for column in vectors], 8)
            counts = ", ".join(str(len(own[0].values)) for own in times.values()) or "none is there"
            findings.append(
                Problem(f"have {length} samples, and no time has as many ({counts}); not read", key=names, code="length",
                        hint="Name the time with --map NAME=time")
            )  # fmt: skip
        elif vectors:
            yield RawTable(columns=vectors)
    for path, item in inner:
        yield from _tables(item, path, times, findings, stated)


def _label(struct: Mapping[str, Any], otherwise: str) -> str:
    """What a struct calls itself, with a dot."""
    return next((f"{struct[key]}." for key in _LABELS if isinstance(struct.get(key), str) and struct[key]), otherwise)


def _columns(name: str, value: Any) -> Columns:
    """A vector under its name; a matrix as a column each, of which the long side is the time."""
    array = np.asarray(value)
    if array.dtype.kind == "c" and not np.any(array.imag):
        array = array.real
    zero = None
    if array.dtype.kind in "Mm" and array.ndim == 1 and len(array):
        zero = int(array[0].astype("M8[ns]").astype(np.int64)) if array.dtype.kind == "M" else None
        array = (array - (array[0] if array.dtype.kind == "M" else np.timedelta64(0))) / np.timedelta64(1, "s")
    if array.dtype.kind not in "fiub" or array.ndim == 0:
        return {}
    array = np.squeeze(array).astype(float)
    if array.ndim == 1 and len(array) > 1:
        return {name: [RawColumn(name=name, values=array, zero=zero)]}
    if array.ndim != 2:
        return {}
    array = np.ascontiguousarray(array if array.shape[0] >= array.shape[1] else array.T)
    return {name: [RawColumn(name=f"{name}_{i + 1}", values=array[:, i]) for i in range(array.shape[1])]}
