"""Metrics as text tables with one line per series and one column per measure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from asrsim.metrics import MetricRow
from asrsim.quantities import shown
from asrsim.tables import TableColumn, from_rows

_NOTHING = 1e-12
"""Largest difference between two numbers that count as equal. Such a difference is a rounding error."""


def metric_tables(rows: Sequence[MetricRow]) -> list[list[TableColumn]]:
    """Tables of the relevant metrics; series with the same measures share a table. `-` marks an undefined number."""
    series: dict[tuple[str, str, str], dict[str, str]] = {}
    for row in worth_saying(rows):
        series.setdefault((row.source, row.joint, row.quantity), {})[row.measure] = _cell(row)
    tables: dict[tuple[str, ...], list[tuple[str, ...]]] = {}
    for key, cells in series.items():
        tables.setdefault(tuple(cells), []).append((*key, *cells.values()))
    heads = "of", "joint", "quantity"
    return [from_rows((*heads, *names), lines, right=range(3, 3 + len(names))) for names, lines in tables.items()]


def worth_saying(rows: Sequence[MetricRow]) -> list[MetricRow]:
    """Metrics that a table shows. In a comparison, references that are equal in run and recording are left out. Measures of a
    step response are left out if neither motion settles."""
    from asrsim.metrics.measures import STEP_MEASURES

    same = {
        (row.joint, row.quantity)
        for row in rows
        if row.quantity.startswith("reference") and row.measure == "nrmse" and not row.value > 0.01
    }
    compared = {(row.joint, row.quantity) for row in rows if row.measure == "nrmse"}
    restless = compared - {(row.joint, row.quantity) for row in rows if row.measure == "settling" and math.isfinite(row.value)}
    return [
        row
        for row in rows
        if (row.joint, row.quantity) not in same
        and (row.measure not in STEP_MEASURES or (row.joint, row.quantity) not in restless)
    ]


def _cell(row: MetricRow) -> str:
    if not math.isfinite(row.value):
        return "-"
    value = row.value if abs(row.value) > _NOTHING else 0.0
    return shown(value, row.unit, 4)
