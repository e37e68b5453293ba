"""What a struct of MATLAB says of the vectors in it: how it calls itself, units, names of a matrix' columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

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


def has_time(item: Mapping[str, Any]) -> bool:
    """Whether a struct has a time of its own."""
    return any(str(key).lower() in TIME_NAMES and np.size(value) > 1 for key, value in item.items())


def unit_of(content: Mapping[str, Any], name: str) -> str:
    """The unit that a struct states of one of its vectors, in brackets: in `unit`, `units.q1`, or a timeseries' DataInfo."""
    if name.lower() in TIME_NAMES:
        return ""
    info = content.get("DataInfo")
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
