"""What a struct of MATLAB says of the vectors in it: how it calls itself, units, names of a matrix' columns."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from asrsim.recordings.time_columns import named_clock

TIME_NAMES = {"time", "t", "timestamp", "timestamps", "stamp", "stamps", "tout", "tvec", "times", "zeit"}
"""How vectors of times are called."""
_COLUMNS = ("colheaders", "header", "headers", "names", "labels", "columns")
"""Where the names of a matrix' columns stand beside it, as importdata puts them."""


def label_of(item: Mapping[str, Any]) -> str:
    """What a struct calls itself."""
    for key in ("label", "name", "Name", "blockName"):
        if isinstance(item.get(key), str) and item[key]:
            return str(item[key]).rpartition("/")[2]
    return ""


def captured(content: Mapping[str, Any]) -> list[tuple[Any, dict[str, Any]]]:
    """What dSPACE captured: of each of its rates the times in X, and the signals in Y by what tells their paths apart."""
    clocks, signals = _structs(content.get("X")), _structs(content.get("Y"))
    if not clocks or not signals:
        return []
    paths = [re.sub(r"/(?:In|Out)\d*$", "", str(one.get("Name", "")).replace('"', "")).split("/") for one in signals]
    while len(paths) > 1 and all(len(path) > 1 for path in paths) and len({path[0] for path in paths}) == 1:
        paths = [path[1:] for path in paths]
    tables: list[tuple[Any, dict[str, Any]]] = [(clock["Data"], {}) for clock in clocks]
    for path, signal in zip(paths, signals, strict=True):
        rate = signal.get("XIndex", 1)
        place = int(rate) - 1 if isinstance(rate, int) and 0 < rate <= len(tables) else 0
        tables[place][1]["/".join(path) + unit_of(signal, "Data")] = signal["Data"]
    return tables


def _structs(value: Any) -> list[Mapping[str, Any]]:
    """A struct, or those of an array, if each holds data."""
    found = [value] if isinstance(value, Mapping) else [*value] if isinstance(value, list | np.ndarray) else []
    return found if all(isinstance(one, Mapping) and "Data" in one for one in found) else []


def has_time(item: Mapping[str, Any]) -> bool:
    """Whether a struct has a time of its own."""
    return any(str(key).lower() in TIME_NAMES and np.size(value) > 1 for key, value in item.items())


def unit_of(content: Mapping[str, Any], name: str) -> str:
    """The unit that a struct states of one of its vectors, in brackets: in `unit`, `units.q1`, or a timeseries' DataInfo."""
    if name.lower() in TIME_NAMES:
        return ""
    info = content.get("DataInfo")
    table = content.get("Properties")  # of a table
    if isinstance(table, Mapping):
        told = zip(np.ravel(table.get("VariableNames", [])), np.ravel(table.get("VariableUnits", [])), strict=False)
        return next((f" [{unit}]" for one, unit in told if str(one) == name and unit), "")
    for place in (content, info if isinstance(info, Mapping) else {}):
        for key in ("unit", "units", "Unit", "Units"):
            stated = place.get(key)
            stated = stated.get(name) if isinstance(stated, Mapping) else stated
            if isinstance(stated, str) and stated:
                return f" [{stated}]"
    return ""


def column_names(content: Mapping[str, Any]) -> list[str]:
    """Names that stand beside a matrix for its columns, with their units where these stand there, too; none without."""
    for key in _COLUMNS:
        value = content.get(key)
        if isinstance(value, list | np.ndarray) and len(value) and all(isinstance(one, str) for one in np.ravel(value)):
            units = np.ravel(content.get("units", content.get("unit", [])))
            names = [str(one).strip() for one in np.ravel(value)]
            return [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)] if len(units) == len(names) else names
    return []


def base_of(name: str, length: int, clocks: Mapping[str, int]) -> tuple[str | None, bool]:
    """The clock of a vector: of its length; of several, the one named after it, or that shares most of its ending, else the
    first; and whether that is certain."""
    fitting = [clock for clock, size in clocks.items() if size == length]
    plain = re.sub(r"_\d+$", "", name)
    if (named := named_clock(name, fitting)) is not None:
        return named, True
    shares = {clock: (_shared(clock, plain), clock.lower() in TIME_NAMES) for clock in fitting}
    best = max(fitting, key=lambda clock: shares[clock], default=None)
    return best, best is None or len(fitting) < 2 or any(shares[best])


def _shared(a: str, b: str) -> int:
    """Letters at the end of both names that are the same."""
    pairs = zip(reversed(a), reversed(b), strict=False)
    return next((i for i, (x, y) in enumerate(pairs) if x != y), min(len(a), len(b)))
