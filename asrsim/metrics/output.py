"""Writes metrics as `metrics.json` and CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from asrsim.outfile import write_json, write_text
from asrsim.plain import finite_or_none


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


_FIELDS = ("source", "joint", "quantity", "measure", "value", "unit")


def write_metrics_json(path: Path, rows: Sequence[MetricRow]) -> None:
    """Write `metrics.json`, a list of rows; undefined numbers are null. Raises OutputError."""
    data = [{**row.__dict__, "value": finite_or_none(row.value)} for row in rows]
    write_json(path, {"metrics": data})


def write_metrics_csv(path: Path, rows: Sequence[MetricRow]) -> None:
    """Write the rows as CSV with a header; undefined numbers are empty. Raises OutputError."""
    stream = io.StringIO()
    writer = csv.writer(stream)
    writer.writerow(_FIELDS)
    for row in rows:
        value = repr(row.value) if math.isfinite(row.value) else ""
        writer.writerow((row.source, row.joint, row.quantity, row.measure, value, row.unit))
    write_text(path, stream.getvalue(), "metrics")
