"""Inputs and desired motions as CSV files that a scenario's `playback` and `against` take."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from asrsim.outfile import make_folder, write_text
from asrsim.samples import Array


def write_inputs(path: Path, time: Array, columns: Sequence[str], values: Array, *, comment: str = "") -> None:
    """Write `time` (n,) in s and `values` (n, columns) in rad, or in the unit that a column's name ends with.

    Numbers are written so that reading gives the same bits. Raises OutputError where the file cannot be written.
    """
    file = io.StringIO()
    for line in comment.splitlines():
        file.write(f"# {line}\n")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["time [s]", *(name if name.endswith("]") else f"{name} [rad]" for name in columns)])
    # repr of a float is the shortest text that reads back as the same float.
    writer.writerows([repr(float(cell)) for cell in row] for row in np.column_stack([time, values]))
    make_folder(path.parent)
    write_text(path, file.getvalue(), "learned input")
