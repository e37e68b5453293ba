"""Reads named arrays from MATLAB, HDF5, NumPy, Parquet and Feather files. Vectors of equal length in a struct form a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import Problem, RecordingError, listed
from asrsim.extras import library
from asrsim.recordings.data import Content, RawColumn, RawTable
from asrsim.recordings.reading import Reading
from asrsim.recordings.times import is_time

_OBJECTS = ("MatlabOpaque", "MatlabFunction", "MatlabObject")
"""SciPy's classes for MATLAB objects, whose contents SciPy cannot read."""
Leaf = tuple[str, list[RawColumn]]
"""Path of a struct, and the columns of a variable in this struct. A vector has one column, and a matrix has several."""


def read_matlab(path: Path, reading: Reading) -> Content:
    """Content of a MATLAB file, read by SciPy (up to version 7) or h5py (from version 7.3)."""
    with path.open("rb") as stream:
        start = stream.read(520)
    if start.startswith(b"\x89HDF") or start[512:516] == b"\x89HDF":
        with library("h5py", "hdf5").File(path) as file:
            # Leave out groups whose names begin with #, since MATLAB stores the contents of objects in them.
            return of_tree({name: file[name] for name in file if not name.startswith("#")}, [], reading)
    from scipy.io import loadmat

    found = loadmat(path, simplify_cells=True)
    return of_tree({name: value for name, value in found.items() if not name.startswith("__")}, [], reading)


def read_numpy(path: Path, reading: Reading) -> Content:
    """Content of a NumPy file: named arrays."""
    loaded = np.load(path)
    arrays = {path.stem: loaded} if isinstance(loaded, np.ndarray) else loaded
    findings: list[Problem] = []
    found: dict[str, Any] = {}
    for name in arrays:
        try:
            found[name] = arrays[name]
        except ValueError as error:  # NumPy refuses to read Python objects, since unpickling would run code from the file
            findings.append(Problem(f"is not read: {error}", key=name, code="objects"))
    return of_tree(found, findings, reading)


def read_arrow(path: Path, reading: Reading) -> Content:
    """Content of a Parquet or Feather file: columns of numbers and of dates."""
    library("pyarrow", "sweep")
    from pyarrow import feather, parquet

    with path.open("rb") as stream:
        table = (parquet.read_table if stream.read(4) == b"PAR1" else feather.read_table)(path)
    columns = {name: column.to_numpy() for name, column in zip(table.column_names, table.columns, strict=True)}
    if len(columns) < len(table.column_names):
        raise RecordingError("several columns have one name", choices=tuple(table.column_names), code="repeated-header")
    numbers = {name: values for name, values in columns.items() if values.dtype != object}
    unread = listed([name for name in columns if name not in numbers], 8)
    note = Problem("text, lists and records are not read", key=unread, code="text-column")
    return of_tree(numbers, [note] if unread else [], reading)


def of_tree(tree: Mapping[str, Any], findings: list[Problem], reading: Reading) -> Content:
    """Content made of named arrays and structs of arrays. Raises RecordingError if no array is a series."""
    tables = tuple(_tables([*_leaves(tree, "", findings)], {*reading.time.columns}))
    if not tables:
        raise RecordingError(
            findings
            or Problem(
                "contains no series of numbers",
                code="no-numbers",
                hint="Expected vectors of time and signals, also in a struct, or as columns of a matrix",
            )
        )
    return Content(tables=tables, findings=tuple(findings))


def _leaves(tree: Mapping[str, Any], struct: str, findings: list[Problem]) -> Iterator[Leaf]:
    """Vectors and matrices of a struct and of its nested structs. struct: path of the struct, with a point at its end."""
    for name, value in tree.items():
        cells = isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.dtype == object and value.ndim)
        items = (
            [(f"{struct}{name}[{i}]", item) for i, item in enumerate(np.ravel(value))] if cells else [(struct + name, value)]
        )
        for path, item in items:
            dataset = type(item).__name__ == "Dataset"
            if isinstance(item, Mapping):  # a struct, or a group of an HDF5 file
                yield from _leaves(item, f"{path}.", findings)
            elif type(item).__name__ in _OBJECTS or (dataset and item.dtype.kind not in "fiub"):
                message = "is a MATLAB object (timeseries, table, function), which cannot be read"
                hint = "Save its parts, for example s.time = ts.Time; s.data = ts.Data"
                findings.append(Problem(message, key=path, code="mat-object", hint=hint))
            # MATLAB writes the arrays of an HDF5 file transposed.
            elif columns := _columns(path, np.transpose(item) if dataset else item):
                yield struct, columns


def _tables(leaves: Sequence[Leaf], stated: set[str]) -> Iterator[RawTable]:
    """Tables of the variables. All variables of a struct with the same length form a table. The table also gets the time
    vectors of this length from the struct and its parents.

    stated: names of the time columns that the user states.
    """
    groups: dict[tuple[str, int], list[RawColumn]] = {}
    for struct, columns in leaves:
        groups.setdefault((struct, len(columns[0].values)), []).extend(columns)
    vectors = [(struct, columns[0]) for struct, columns in leaves if len(columns) == 1]
    times = [(struct, one) for struct, one in vectors if is_time(one.name.rpartition(".")[2]) or one.name in stated]
    for (struct, length), group in groups.items():
        clock = [one for around, one in times if struct.startswith(around) and len(one.values) == length]
        if signals := [one for one in group if one not in clock]:
            yield RawTable(columns=(*clock, *signals))


def _columns(name: str, value: Any) -> list[RawColumn]:
    """Columns of a vector or matrix; no columns for other values. The longer dimension of a matrix is the time."""
    array = np.squeeze(np.asarray(value))
    zero = None
    if array.dtype.kind == "M" and array.ndim == 1 and len(array):
        zero = int(array[0].astype("M8[ns]").astype(np.int64))
        array = array - array[0]
    if array.dtype.kind == "m":
        array = array / np.timedelta64(1, "s")
    if array.dtype.kind not in "fiub" or array.ndim not in (1, 2) or len(array) < 2:
        return []
    array = array.astype(float)
    if array.ndim == 1:
        return [RawColumn(name=name, values=array, zero=zero)]
    array = np.ascontiguousarray(array if array.shape[0] >= array.shape[1] else array.T)
    return [RawColumn(name=f"{name}_{i + 1}", values=array[:, i]) for i in range(array.shape[1])]
