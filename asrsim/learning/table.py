"""Inputs and desired motions as CSV files that a scenario's `playback` and `against` take."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from asrsim.outfile import csv_text, make_folder, write_text
from asrsim.samples import Array


def write_inputs(path: Path, time: Array, columns: Sequence[str], values: Array, *, comment: str = "") -> None:
    """Write `time` (n,) in s and `values` (n, columns) in rad, or in the unit that a column's name ends with.

    Numbers are written so that reading gives the same bits. Raises OutputError where the file cannot be written.
    """
    comments = "".join(f"# {line}\n" for line in comment.splitlines())
    headings = ["time [s]", *(name if name.endswith("]") else f"{name} [rad]" for name in columns)]
    make_folder(path.parent)
    write_text(path, comments + csv_text(headings, np.column_stack([time, values])), "learned input")
