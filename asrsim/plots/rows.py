"""Metrics as text tables with one line per series and one column per measure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from asrsim.metrics import MetricRow
from asrsim.quantities import shown

_NOTHING = 1e-12
"""Differences up to this size are rounding errors between equal numbers."""


@dataclass(frozen=True, kw_only=True)
class MetricTable:
    """Table of series that have the same measures."""

    measures: tuple[str, ...]
    lines: tuple[tuple[tuple[str, str, str], tuple[str, ...]], ...]
    """Rows of the table, each as (source, joint, quantity) and the texts of the measures."""


def metric_tables(rows: Sequence[MetricRow]) -> list[MetricTable]:
    """Tables of the relevant metrics; `-` marks an undefined number."""
    series: dict[tuple[str, str, str], dict[str, str]] = {}
    for row in worth_saying(rows):
        series.setdefault((row.source, row.joint, row.quantity), {})[row.measure] = _cell(row)
    tables: dict[tuple[str, ...], list[tuple[tuple[str, str, str], tuple[str, ...]]]] = {}
    for key, cells in series.items():
        tables.setdefault(tuple(cells), []).append((key, tuple(cells.values())))
    return [MetricTable(measures=measures, lines=tuple(lines)) for measures, lines in tables.items()]


def worth_saying(rows: Sequence[MetricRow]) -> list[MetricRow]:
    """Metrics without references that are equal in run and recording, and without step measures of unsettled motions."""
    from asrsim.metrics.measures import STEP_MEASURES

    same = {
        (row.joint, row.quantity)
        for row in rows
        if row.quantity.startswith("reference") and row.measure == "nrmse" and not row.value > 0.01
    }
    settled = {(row.joint, row.quantity) for row in rows if row.measure == "settling" and math.isfinite(row.value)}
    return [
        row
        for row in rows
        if (row.joint, row.quantity) not in same and (row.measure not in STEP_MEASURES or (row.joint, row.quantity) in settled)
    ]


def _cell(row: MetricRow) -> str:
    if not math.isfinite(row.value):
        return "-"
    value = row.value if abs(row.value) > _NOTHING else 0.0
    return shown(value, row.unit, 4)
