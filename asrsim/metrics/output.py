"""Writes metrics as `metrics.csv` and reads them."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from asrsim.outfile import write_text


@dataclass(frozen=True, kw_only=True)
class MetricRow:
    """Value of one measure with its source."""

    source: str
    """Source of the series: a log, a recording, or both."""
    joint: str
    quantity: str
    measure: str
    value: float
    """Value; NaN if undefined."""
    unit: str = ""


METRICS = "metrics.csv"
"""Name of the file of metrics."""
_FIELDS = ("source", "joint", "quantity", "measure", "value", "unit")


def write_metrics(path: Path, rows: Sequence[MetricRow]) -> None:
    """Write the rows as CSV with a header; undefined numbers are empty. Raises OutputError."""
    stream = io.StringIO()
    writer = csv.writer(stream)
    writer.writerow(_FIELDS)
    for row in rows:
        value = repr(row.value) if math.isfinite(row.value) else ""
        writer.writerow((row.source, row.joint, row.quantity, row.measure, value, row.unit))
    write_text(path, stream.getvalue(), "metrics")


def read_metrics(path: Path) -> list[MetricRow]:
    """Rows of a file written by `write_metrics`. Raises OSError, and ValueError if the file has another structure."""
    reader = csv.reader(path.read_text(encoding="utf-8").splitlines(), strict=True)
    try:
        if tuple(next(reader, ())) != _FIELDS:
            raise ValueError(f"{path.name} has other columns than {', '.join(_FIELDS)}")
        return [
            MetricRow(source=source, joint=joint, quantity=quantity, measure=measure, value=float(value or "nan"), unit=unit)
            for source, joint, quantity, measure, value, unit in reader
        ]
    except csv.Error as error:
        raise ValueError(f"{path.name}: {error}") from None
