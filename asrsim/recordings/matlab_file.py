"""The content of a MATLAB file, read by SciPy in a process of its own: damaged files crash its reader."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.confined import ConfinedError, run_confined

_SECONDS = 60.0
"""Of wall clock for a MATLAB file."""
_MOST = 512 * 2**20
"""Bytes of all its arrays."""


class Opaque:
    """Stands for a MATLAB object, whose format is not documented."""


def read_matlab(path: Path) -> dict[str, Any]:
    """Variables by name. Raises NotImplementedError for version 7.3, ValueError for other damage."""
    request = {"path": str(path.resolve()), "most": _MOST}
    try:
        found = run_confined(Path(__file__).with_name("matlab_child.py"), request, seconds=_SECONDS)
    except ConfinedError as error:
        raise ValueError(f"SciPy {error}") from None
    line, _, data = found.partition(b"\n")
    answer = json.loads(line)
    if answer.get("kind") == "NotImplementedError":
        raise NotImplementedError
    if "error" in answer:
        raise ValueError(answer["error"])
    return dict(_value(answer["content"], BytesIO(data)))


def _value(tree: Sequence[Any], data: BytesIO) -> Any:
    """What :func:`asrsim.recordings.matlab_child.tree_of` took apart."""
    kind, *content = tree
    if kind == "struct":
        return {name: _value(item, data) for name, item in content[0]}
    if kind == "text":
        return content[0]
    if kind == "numbers":
        name, shape = content
        array = np.frombuffer(data.read(np.dtype(name).itemsize * math.prod(shape)), dtype=name).reshape(shape)
        return array if shape else array[()].item()
    if kind == "cells":
        shape, items = content
        cells = np.empty(len(items), dtype=object)
        for i, item in enumerate(items):
            cells[i] = _value(item, data)
        return cells.reshape(shape)
    return Opaque() if kind == "object" else None
