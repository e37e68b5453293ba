"""Reads MATLAB files up to version 7: vectors beside a time, structs, and what Simulink saves (time and signals)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import Problem, RecordingError
from asrsim.recordings.data import Raw, RawSeries
from asrsim.recordings.mapping import ColumnMap
from asrsim.recordings.names import tokens_of
from asrsim.recordings.timebase import clean_time, scale_time
from asrsim.recordings.units import split_header
from asrsim.samples import Array

_TIME_NAMES = {"time", "t", "timestamp", "stamp", "tout", "zeit"}


def read_mat(path: Path, maps: Sequence[ColumnMap], rate: float | None) -> Raw:
    """All series of a .mat file. Raises RecordingError for version 7.3, opaque objects only, or no time."""
    from scipy.io import loadmat

    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise RecordingError(
            Problem(message="is a MATLAB 7.3 file, which needs HDF5 and is not read here", file=path, code="mat-7.3",
                    hint="Save it in MATLAB with save('file.mat', 'name', '-v7')")
        ) from None  # fmt: skip
    except Exception as error:  # on damaged files scipy lets errors of many kinds through
        raise RecordingError(Problem(message=f"cannot be read as a MATLAB file: {error}", file=path, code="bad-mat")) from None
    findings: list[Problem] = []
    series: list[RawSeries] = []
    epoch: float | None = None
    for prefix, table in _tables(
        {key: value for key, value in content.items() if not key.startswith("__")}, "", findings, path
    ):
        chosen = _time_of(table, prefix, maps)
        if chosen is None and rate is None:
            if len(table) > 0:
                findings.append(
                    Problem(message=f"no time among {', '.join(table)}; these are not read", file=path, key=prefix or None,
                            code="no-time", hint="Name the time with --map NAME=time or give --rate")
                )  # fmt: skip
            continue
        if chosen is None:
            length = max(len(values) for values in table.values())
            time, keep = np.arange(length) / float(rate or 1.0), np.ones(length, dtype=bool)
        else:
            unit = split_header(chosen)[1]
            given = next((one.unit.factor for one in maps if one.role == "time" and one.unit is not None), None)
            factor = given if given is not None else unit.factor if unit is not None and unit.si == "s" else None
            time, start, found = scale_time(table[chosen], factor, path=path, name=prefix + chosen)
            epoch = epoch if epoch is not None else start
            keep, more = clean_time(time, None, path=path, name=prefix + chosen)
            findings += [*found, *more]
        kept = time[keep]
        for name, values in table.items():
            if name == chosen:
                continue
            if len(values) != len(time):
                findings.append(
                    Problem(message=f"has {len(values)} samples, its time has {len(time)}; it is not read", file=path,
                            key=prefix + name, code="length")
                )  # fmt: skip
                continue
            series.append(RawSeries(name=prefix + name, time=kept, values=values[keep]))
    if not series:
        raise RecordingError(
            findings
            or Problem(message="holds no series of numbers", file=path, code="no-numbers",
                       hint="Expected vectors with a time beside them, a struct with both, or a matrix with time in column 1")
        )  # fmt: skip
    return Raw(format="mat", series=tuple(series), findings=tuple(findings), epoch=epoch)


def _tables(
    content: Mapping[str, Any], prefix: str, findings: list[Problem], path: Path
) -> Iterator[tuple[str, dict[str, Array]]]:
    """Groups of vectors that share a struct (the file itself is one), with the group's prefix."""
    table: dict[str, Array] = {}
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from _tables(value, f"{prefix}{name}.", findings, path)
        elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
            for i, item in enumerate(value):
                if isinstance(item, Mapping):
                    # Simulink: signals(i).values belongs to the time one level up.
                    label = _label(item) or f"{name}[{i}]"
                    nested = item.get("values", item.get("data", item.get("Data")))
                    if nested is not None:
                        _add(table, label, nested)
                    else:
                        yield from _tables(
                            item, f"{prefix}{name}.{label}." if _label(item) else f"{prefix}{name}[{i}].", findings, path
                        )
        elif type(value).__name__ in ("MatlabOpaque", "MatlabFunction"):
            findings.append(
                Problem(message="is a MATLAB object (timeseries, table), which the file format does not document; not read",
                        file=path, key=prefix + name, code="mat-object",
                        hint="Save its parts, for example s.time = ts.Time; s.data = ts.Data")
            )  # fmt: skip
        else:
            # A timeseries saved as a struct: the data carry its name.
            _add(table, _label(content) or name if name in ("Data", "data") else name, value)
    if prefix.endswith("signals.") and "values" in table:
        return
    nested = content.get("signals")
    if isinstance(nested, Mapping) and "values" in nested:
        _add(table, str(nested.get("label") or "signals"), nested["values"])
    columns = {name: values for name, values in table.items() if len(values) > 1}
    if columns:
        yield prefix, columns


def _label(item: Mapping[str, Any]) -> str:
    """What a struct calls itself."""
    for key in ("label", "name", "Name", "blockName"):
        if isinstance(item.get(key), str) and item[key]:
            return str(item[key]).rpartition("/")[2]
    return ""


def _add(table: dict[str, Array], name: str, value: Any) -> None:
    """A vector under its name; a matrix as one column each (the long side is time)."""
    array = np.asarray(value)
    if array.dtype.kind not in "fiub" or array.ndim == 0:
        return
    array = np.squeeze(array.astype(float))
    if array.ndim == 1:
        table[name] = array
    elif array.ndim == 2:
        array = array if array.shape[0] >= array.shape[1] else array.T
        for i in range(array.shape[1]):
            table[f"{name}_{i + 1}"] = array[:, i]


def _time_of(table: Mapping[str, Array], prefix: str, maps: Sequence[ColumnMap]) -> str | None:
    """The vector that holds time: the mapped one, one named so, or the first column of a matrix if it rises evenly."""
    for one in maps:
        if one.role == "time":
            for name in table:
                if one.column in (name, prefix + name):
                    return name
    for name in table:
        words = [word for word in tokens_of(split_header(name)[0]) if not word.isdigit()]
        if words and words[-1] in _TIME_NAMES:
            return name
    for name, values in table.items():
        steps = np.diff(values)
        if name.endswith("_1") and len(steps) > 2 and np.all(steps > 0) and np.ptp(steps) < 2 * np.median(steps):
            return name
    return None
