"""Metrics for people and for programs: a table, `metrics.json`, CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim import __version__
from asrsim.outfile import write_text

if TYPE_CHECKING:
    from rich.table import Table


@dataclass(frozen=True, kw_only=True)
class MetricRow:
    """One number."""

    source: str
    """What was measured: a log, a recording, or both."""
    joint: str
    quantity: str
    measure: str
    value: float
    """NaN where undefined."""
    unit: str = ""


_FIELDS = ("source", "joint", "quantity", "measure", "value", "unit")


def metrics_table(rows: Sequence[MetricRow], *, title: str = "Metrics") -> Table:
    """A table for the terminal: one line a joint and quantity, one column a measure; "-" where undefined."""
    from rich.table import Table

    measures = tuple(dict.fromkeys((row.measure, row.unit) for row in rows))
    names = tuple(dict.fromkeys(measure for measure, _ in measures))
    table = Table(title=title)
    for heading in ("source", "joint", "quantity", "unit"):
        table.add_column(heading)
    for name in names:
        table.add_column(name, justify="right")
    groups = dict.fromkeys((row.source, row.joint, row.quantity) for row in rows)
    for source, joint, quantity in groups:
        mine = {row.measure: row for row in rows if (row.source, row.joint, row.quantity) == (source, joint, quantity)}
        cells = [_cell(mine.get(name)) for name in names]
        unit = next((mine[name].unit for name in ("rmse", "steady_state", "maximum") if name in mine), "")
        table.add_row(source, joint, quantity, unit, *cells)
    return table


def _cell(row: MetricRow | None) -> str:
    if row is None or math.isnan(row.value):
        return "-"
    return f"{row.value:.4g}" + (f" {row.unit}" if row.unit in ("s", "Hz") else "")


def write_metrics_json(path: Path, rows: Sequence[MetricRow]) -> None:
    """Writes `metrics.json`: a list of rows; undefined numbers are null. Raises OutputError."""
    data = [{**row.__dict__, "value": row.value if math.isfinite(row.value) else None} for row in rows]
    write_text(path, json.dumps({"generator": f"asrsim {__version__}", "metrics": data}, indent=2) + "\n", "json")


def write_metrics_csv(path: Path, rows: Sequence[MetricRow]) -> None:
    """Writes the rows as CSV with a header; undefined numbers are empty. Raises OutputError."""
    stream = io.StringIO()
    writer = csv.writer(stream)
    writer.writerow(_FIELDS)
    for row in rows:
        value = repr(row.value) if math.isfinite(row.value) else ""
        writer.writerow((row.source, row.joint, row.quantity, row.measure, value, row.unit))
    write_text(path, stream.getvalue(), "metrics")
