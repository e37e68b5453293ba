"""Reads MATLAB files up to version 7, and numpy's .npz and .npy: vectors beside a time, structs, what Simulink saves."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError, listed
from asrsim.recordings.condense import condense
from asrsim.recordings.data import Raw, RawSeries
from asrsim.recordings.foreign import from_hdf5
from asrsim.recordings.mapping import ColumnMap
from asrsim.recordings.matlab_file import Opaque, read_matlab
from asrsim.recordings.matlab_struct import TIME_NAMES, base_of, captured, column_names, has_time, label_of, unit_of
from asrsim.recordings.names import VOCABULARY, tokens_of
from asrsim.recordings.stamps import parts_of
from asrsim.recordings.time_columns import TIME_WORDS, told_rate
from asrsim.recordings.timebase import clean_time, scale_time, suspect_time
from asrsim.recordings.units import split_header
from asrsim.recordings.unpacked import check_archive
from asrsim.samples import Array

_REASONS = 3
"""Reasons that are given for a file of which nothing can be read."""


def read_mat(path: Path, maps: Sequence[ColumnMap], rate: float | None) -> Raw:
    """All series of a .mat, .npz or .npy file. Raises RecordingError for version 7.3, opaque objects only, or no time."""
    findings: list[Problem] = []
    try:
        content = _numpy(path, findings) if path.suffix.lower() in (".npz", ".npy") else read_matlab(path)
    except RecordingError:
        raise
    except NotImplementedError:
        raise RecordingError(
            "is a MATLAB 7.3 file, which needs HDF5 and is not read here", file=path, code="mat-7.3",
            hint=f"In MATLAB: save('file.mat', '-v7'). {from_hdf5(path)}",
        ) from None  # fmt: skip
    except Exception as error:  # on damaged files scipy lets errors of many kinds through
        kind = "a MATLAB file" if path.suffix.lower() == ".mat" else "arrays of numbers by numpy"
        raise RecordingError(f"cannot be read as {kind}: {error}", file=path, code="bad-mat") from None
    series: list[RawSeries] = []
    epoch: float | None = None
    plain = {key: value for key, value in content.items() if not key.startswith("__")}
    for prefix, table in _tables(plain, "", findings, path):
        clocks = _times_of(table, prefix, maps)
        if not any(one.role == "time" for one in maps):
            table, clocks = _behind_the_time(table, clocks)
        if not clocks and rate is None:
            said = "\n".join(f"{key} = {value}" for key, value in plain.items() if isinstance(value, int | float))
            findings.append(
                Problem(f"no time among {listed(table, 8)}; these are not read", file=path, key=prefix.rstrip(".") or None,
                        code="no-time", hint=told_rate(said) or "Name the time with --map NAME=time or give --rate")
            )  # fmt: skip
            continue
        bases: dict[str, tuple[Array, NDArray[np.bool_], Array]] = {}
        if not clocks:
            length = max(len(values) for values in table.values())
            even = np.arange(length) / float(rate or 1.0)
            bases[""] = (even, np.ones(length, dtype=bool), even)
        for name in clocks:
            try:
                time, keep, start = _clock(table[name], prefix + name, maps, path, findings)
            except RecordingError as error:
                if not prefix and len(clocks) == 1:
                    raise
                findings += error.problems
                continue
            epoch = epoch if epoch is not None else start
            bases[name] = (time, keep, time[keep])
        others: dict[int, list[str]] = {}
        unsure: dict[str, list[str]] = {}
        for name, values in table.items():
            if name in clocks:
                continue
            base, sure = base_of(name, len(values), {clock: len(time) for clock, (time, _, _) in bases.items()})
            if base is None:
                others.setdefault(len(values), []).append(prefix + name)
                continue
            same = (np.array_equal(bases[base][0], time) for time, _, _ in bases.values() if len(time) == len(values))
            if not sure and not all(same):
                unsure.setdefault(base, []).append(prefix + name)
            series.append(RawSeries(name=prefix + name, time=bases[base][2], values=values[bases[base][1]]))
        findings += [
            Problem(f"of which time these are is unclear; '{prefix}{base}' is used", file=path, key=listed(named, 8),
                    choices=tuple(prefix + clock for clock in bases), code="second-time-base",
                    hint=f"Name the time after them, or say it with --map '{prefix}{base}=time'")
            for base, named in unsure.items()
        ]  # fmt: skip
        lengths = ", ".join(str(len(time)) for time, _, _ in bases.values())
        findings += [
            Problem(f"{'has' if len(names) == 1 else 'have'} {count} samples, no time has ({lengths}); not read",
                    file=path, key=listed(names, 8), code="length")
            for count, names in others.items()
        ]  # fmt: skip
    if not series:
        raise RecordingError(
            condense(findings)[:_REASONS]
            or Problem("holds no series of numbers", file=path, code="no-numbers",
                       hint="Expected vectors with a time beside them, a struct with both, or a matrix with time in column 1")
        )  # fmt: skip
    return Raw(format="mat", series=tuple(series), findings=tuple(findings), epoch=epoch, names=tuple(plain))


def _behind_the_time(table: dict[str, Array], clocks: Sequence[str]) -> tuple[dict[str, Array], list[str]]:
    """Of a matrix of joints whose first column is the time (Simulink's To File), the second is the first joint's: `q_1`."""
    told = {word for word in VOCABULARY if len(word) > 1 or word == "q"}  # of M or A nothing is known
    stems = [clock[:-2] for clock in clocks if clock.endswith("_1") and told & set(tokens_of(clock[:-2]))]
    names = {f"{stem}_{i + 1}": f"{stem}_{i}" if i else f"{stem}.time" for stem in stems for i in range(len(table))}
    return {names.get(name, name): values for name, values in table.items()}, [names.get(clock, clock) for clock in clocks]


def _numpy(path: Path, findings: list[Problem]) -> dict[str, Any]:
    """Arrays by name; structured ones as the tables that they are."""
    if zipfile.is_zipfile(path):
        check_archive(path)
    loaded = np.load(path)
    if isinstance(loaded, np.ndarray):
        return _fields(loaded) if loaded.dtype.names else {path.stem: loaded}
    found: dict[str, Any] = {}
    with loaded as arrays:
        for name in arrays.files:
            try:
                array = arrays[name]
            except ValueError as error:
                if "pickle" not in str(error):
                    raise
                # To read objects of Python would run what they hold.
                findings.append(Problem("holds objects of Python, which are not read", file=path, key=name, code="objects"))
                continue
            found[name] = _fields(array) if array.dtype.names else array
    return found


def _fields(array: NDArray[Any]) -> dict[str, Any]:
    return {field: array[field] for field in array.dtype.names or ()}


def _tables(
    content: Mapping[str, Any], prefix: str, findings: list[Problem], path: Path, above: Mapping[str, Array] | None = None
) -> Iterator[tuple[str, dict[str, Array]]]:
    """Groups of vectors that share a struct (the file itself is one), with the group's prefix.

    above: times of the structs around it, which serve one that has none.
    """
    table: dict[str, Array] = {}
    times = dict(above or {})
    for name, value in content.items():
        if name.lower() in TIME_NAMES:
            _add(times, name, value)
    for clock, signals in (capture := captured(content)):
        columns: dict[str, Array] = {}
        _add(columns, "time", clock)
        for name, value in signals.items():
            _add(columns, name, value)
        yield prefix, columns
    if capture:
        return
    for name, value in content.items():
        if isinstance(value, Opaque):
            # Before all others: such a value is an array of objects, too.
            findings.append(
                Problem("is a MATLAB object (timeseries, table, function), whose format is not documented; not read",
                        file=path, key=prefix + name, code="mat-object",
                        hint="Save its parts, for example s.time = ts.Time; s.data = ts.Data")
            )  # fmt: skip
        elif isinstance(value, Mapping):
            # A signal of a Simulink dataset: its name stands beside its values.
            own = label_of(content) if name in ("Values", "values") else ""
            inner = f"{own}." if own and not prefix.endswith(f"{own}.") else ""
            yield from _tables(value, f"{prefix}{inner}{name}.", findings, path, times)
        elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
            for i, item in enumerate(np.asarray(value, dtype=object).ravel() if isinstance(value, np.ndarray) else value):
                if isinstance(item, np.ndarray):
                    _add(table, f"{name}_{i + 1}", item)  # a cell array of vectors
                elif isinstance(item, Mapping):
                    # Simulink: signals(i).values belongs to the time one level up.
                    label = label_of(item) or f"{name}_{i + 1}"
                    nested = item.get("values", item.get("data", item.get("Data")))
                    if nested is not None and not has_time(item):
                        _add(table, label, nested)
                    else:
                        inner = f"{name}.{label}" if label_of(item) else f"{name}[{i}]"
                        yield from _tables(item, f"{prefix}{inner}.", findings, path, times)
        else:
            # A timeseries saved as a struct: the data carry its name.
            own = label_of(content) if name in ("Data", "data") and not prefix.endswith(f"{label_of(content)}.") else ""
            _add(table, f"{own or name}{unit_of(content, name)}", value, column_names(content))
    if prefix.endswith("signals.") and "values" in content:
        return  # they belong to the time one level up, which adds them
    nested = content.get("signals")
    if isinstance(nested, Mapping) and "values" in nested:
        # Without a label the variable's own name tells more than the block's, if it tells anything.
        own = "values" if VOCABULARY & set(tokens_of(prefix)) else label_of(content) or "signals"
        _add(table, label_of(nested) or own, nested["values"])
    columns = {name: values for name, values in table.items() if len(values) > 1}
    _merge_seconds(columns)
    if not any(name.lower() in TIME_NAMES for name in columns):
        lengths = {len(values) for values in columns.values()}
        columns = {name: values for name, values in times.items() if len(values) in lengths} | columns
    if columns:
        yield prefix, columns


def _merge_seconds(columns: dict[str, Array]) -> None:
    """A ROS stamp in two vectors as one time, from its first whole second."""
    names = list(columns)
    if (parts := parts_of(names)) is not None and len(columns[names[parts[0]]]) == len(columns[names[parts[1]]]):
        i, j, unit = parts
        seconds = columns.pop(names[i])
        columns["time"] = seconds - seconds[0] + columns.pop(names[j]) * unit


def _add(table: dict[str, Array], name: str, value: Any, names: Sequence[str] = ()) -> None:
    """A vector under its name; a matrix as one column each (the long side is time), under `names` where they are as many."""
    array = np.asarray(value)
    if array.dtype.kind == "c" and not np.any(array.imag):
        array = array.real
    if array.dtype.kind == "M" and array.ndim == 1 and len(array):  # numpy's dates, from the first
        array = (array - array[0]) / np.timedelta64(1, "s")
    if array.dtype.kind not in "fiub" or array.ndim == 0:
        return
    array = np.squeeze(array.astype(float))
    if array.ndim == 1:
        table[name] = array
    elif array.ndim == 2:
        array = array if array.shape[0] >= array.shape[1] else array.T
        for i in range(array.shape[1]):
            table[names[i] if len(names) == array.shape[1] else f"{name}_{i + 1}"] = array[:, i]


def _clock(
    values: Array, name: str, maps: Sequence[ColumnMap], path: Path, findings: list[Problem]
) -> tuple[Array, NDArray[np.bool_], float | None]:
    """A time in s, the samples of it to keep, and the Unix time of its zero."""
    unit = split_header(name)[1]
    given = next((one.unit.factor for one in maps if one.role == "time" and one.unit is not None), None)
    factor = unit.factor if unit is not None and unit.si == "s" else None
    time, start, found = scale_time(values, factor if given is None else given, path=path, name=name)
    suspected = suspect_time(values, factor, path=path, name=name) if factor is not None and given is None else []
    keep, more = clean_time(time, None, path=path, name=name)
    findings += [*found, *suspected, *more]
    return time, keep, start


def _times_of(table: Mapping[str, Array], prefix: str, maps: Sequence[ColumnMap]) -> list[str]:
    """The vectors that hold time: the mapped one, those named so (`t`, and `tsim` beside an `xsim`), or the first column of a
    matrix if it rises evenly."""
    for one in maps:
        if one.role == "time":
            found = [name for name in table if one.column in (name, prefix + name)]
            if found:
                return found[:1]
    # t_q beside q1, t_state beside t_cmd: but T_1 is a torque.
    called = [name for name in table if name.startswith("t") and tokens_of(name)[:1] in (["t"], ["time"])]
    rising = [name for name in called if np.all(np.diff(table[name]) > 0)]
    named = [name for name in table if name in rising or _is_time(name, table)]
    # epoch_ms, Datum: whatever else a table's time may be called.
    named = named or [
        name for name in table if TIME_WORDS & set(tokens_of(split_header(name)[0])) and np.all(np.diff(table[name]) > 0)
    ]
    if named:
        return named
    for name, values in table.items():
        steps = np.diff(values)
        if name.endswith("_1") and len(steps) > 2 and np.all(steps > 0) and np.ptp(steps) < 2 * np.median(steps):
            return [name]
    return []


def _is_time(name: str, table: Mapping[str, Array]) -> bool:
    words = [word for word in tokens_of(split_header(name)[0]) if not word.isdecimal()]
    if words and words[-1] in TIME_NAMES:
        return True
    if words and words[0] in ("t", "time") and len(words) > 1 and set(words) & VOCABULARY <= {"t"}:
        return bool(np.all(np.diff(table[name]) > 0))
    # tsim beside xsim: a time of that length that rises.
    suffix = name[1:]
    if not name.startswith("t") or len(suffix) < 2 or not np.all(np.diff(table[name]) > 0):
        return False
    return any(other != name and re.fullmatch(rf"\w{{1,2}}{re.escape(suffix)}(_\d+)?", other) for other in table)
