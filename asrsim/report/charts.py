"""Converts charts (`asrsim.plots.chart`) to data for the plots of a page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from asrsim.plots.chart import Chart, Line, Shade
from asrsim.report.series import pack
from asrsim.samples import Array

DASHES: tuple[list[float], ...] = ([], [7, 3], [9, 3, 2, 3], [2, 3], [12, 3, 2, 3, 2, 3], [4, 2])
"""Dash patterns by the number of the line style: lengths of dashes and gaps, pixels."""
PIXELS = 1.2
"""Width of a line on a page, in pixels for each pt of the line's width in a picture."""


def page_data(groups: Iterable[tuple[str, Sequence[Chart]]]) -> dict[str, Any]:
    """Data of a page for groups of charts, each with its name. Charts without data are left out."""
    plots = [(name, [plot_data(chart) for chart in charts if not chart.empty]) for name, charts in groups]
    return {"runs": [], "groups": [{"name": name, "plots": shown} for name, shown in plots]}


def plot_data(chart: Chart) -> dict[str, Any]:
    """Chart as data of a plot, whose curves all have values at the same points."""
    across = _common([*chart.lines, *chart.bands], scattered=any(line.kind == "points" for line in chart.lines))
    by_x = "x" in chart.logarithmic
    series = [_series(line, across, logarithmic="y" in chart.logarithmic) for line in chart.lines]
    return {
        "title": f"{chart.head}: {chart.words}" if chart.head else chart.words,
        "unit": chart.unit,
        "across": chart.across,
        "acrossUnit": chart.across_unit,
        "note": chart.note,
        "logarithmic": chart.logarithmic,
        "span": list(chart.span) if chart.span is not None else None,
        "x": {"count": len(across), "log": by_x, **pack(np.log10(across) if by_x else across)},
        "series": series,
        "bands": [_band(band, across) for band in chart.bands],
    }


def _common(parts: Sequence[Line | Shade], *, scattered: bool) -> Array:
    """Points (n,) on the horizontal axis at which any curve or shaded area has a value, ascending. scattered: whether every
    point of every curve is kept, including equal points; if not, each point occurs once.
    """
    known = [part.x for part in parts if len(part.x)]
    distinct = known if scattered else {id(part): part for part in known}.values()
    together = np.concatenate([*distinct])
    return np.sort(together, kind="stable") if scattered else np.unique(together)


def _at(across: Array, x: Array, y: Array, *, scattered: bool = False) -> Array:
    """Values (n,) at the points `across` of a curve with the points `x` and values `y`. They are NaN outside of the curve; for
    scattered points, also between the curve's points.
    """
    if scattered:
        values = np.full(len(across), np.nan)
        # If several points of the curve have equal x, assign them in their order to the points in `across` with this x.
        order = np.argsort(x, kind="stable")
        first = np.searchsorted(across, x[order])
        again = np.arange(len(x)) - np.searchsorted(x[order], x[order])
        values[first + again] = y[order]
        return values
    if len(across) == len(x) and np.array_equal(across, x):
        return y
    return np.interp(across, x, y, left=np.nan, right=np.nan)


def _series(line: Line, across: Array, *, logarithmic: bool) -> dict[str, Any]:
    values = _at(across, line.x, line.y, scattered=line.kind == "points")
    if logarithmic:
        values = np.where(values > 0.0, values, np.nan)
        values = np.log10(values)
    return {
        "label": line.label,
        "colour": _colour(line.colour, line.opacity),
        "dash": DASHES[line.dash % len(DASHES)],
        "width": round(PIXELS * line.width, 2),
        "unit": "",
        "run": None,
        "kind": line.kind,
        "log": logarithmic,
        **pack(values),
    }


def _band(band: Shade, across: Array) -> dict[str, Any]:
    low, high = (_at(across, band.x, edge) for edge in (band.low, band.high))
    if band.where is not None:
        inside = _at(across, band.x, band.where.astype(float)) > 0.5
        low, high = np.where(inside, low, np.nan), np.where(inside, high, np.nan)
    return {"label": band.label, "colour": _colour(band.colour, band.opacity), "low": pack(low), "high": pack(high)}


def _colour(colour: str, opacity: float) -> str:
    return colour if opacity >= 1.0 or not colour.startswith("#") else f"{colour}{round(255 * opacity):02x}"
