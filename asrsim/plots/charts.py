"""Figures of charts: rows of axes with one legend for each row, in the style of all pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.plots import style
from asrsim.plots.chart import Chart
from asrsim.plots.layout import LEFT, PanelGrid, set_title
from asrsim.plots.output import save_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

HEIGHT = 1.5
"""Height of a row, inch."""
LETTER = 0.068
"""Width of a letter of a tick label, inch."""
MANY = 2e3
"""Ratio of the ends of a logarithmic axis beyond which only powers of ten are labelled, since labels at 2 and 5 would touch in
a low chart.
"""


def chart_figure(rows: Sequence[Sequence[Chart]], *, title: str = "", width: float = 4.6, height: float = HEIGHT) -> Figure:
    """Figure with a row of axes for each row of charts. Columns in which no chart has anything to show are left out.

    width: width of a column, inch; height: height of a row, inch. Charts of a column share the horizontal axis if it shows the
    same quantity.
    """
    columns = [column for column in zip_longest(*rows) if any(chart is not None and not chart.empty for chart in column)]
    rows = [*zip(*columns, strict=True)]
    below = {(r, c) for c, column in enumerate(columns) for r, one in enumerate(column[:-1]) if _alike(one, column[r + 1])}
    every = all((r, c) in below for r in range(len(rows) - 1) for c in range(len(columns)))
    headed = any(chart is not None and chart.head for row in rows[1:] for chart in row)
    left = max(LEFT + 0.2, LETTER * _longest(name for row in rows for one in row if one for name in one.places) + 0.3)
    right = max(style.LEGEND_WIDTH, LETTER * _longest(name for row in rows for name in _labels(row)) + 0.55)
    grid = PanelGrid(
        columns=len(columns),
        heights=[_height(row, height) for row in rows],
        width=width,
        title=0.24,
        gap_y=(0.2 if every else 0.55) + 0.18 * headed,
        left=left,
        gap_x=max(1.1, left + 0.15),
        right=right,
    )
    figure, axes = grid.figure([])
    for r, row in enumerate(rows):
        for c, chart in enumerate(row):
            ax = axes[r, c]
            if chart is None:
                ax.set_axis_off()  # hide the axes instead of removing them, since they may contain the legend of the row
                continue
            draw_chart(ax, chart)
            ax.yaxis.set_label_coords((0.38 - left) / width, 0.5)
            if (r, c) in below:
                ax.set_xlabel("")
                ax.tick_params(labelbottom=False)
        if r == 0 or [*_labels(row)] != [*_labels(rows[r - 1])]:
            _legend(axes[r, -1], row)
    for column in axes.T:
        for ax, other in pairwise(column):
            if ax.get_xscale() == "linear" and not ax.get_xlabel():
                other.sharex(ax)
    set_title(figure, title)
    return figure


def _longest(names: Iterable[str]) -> int:
    """Number of letters in the longest line of these names."""
    return max((len(line) for name in names for line in name.split("\n")), default=0)


def _height(row: Sequence[Chart | None], height: float) -> float:
    """Height of a row, inch; it grows with the number of lines in the labels `places` of its charts."""
    lines = sum(name.count("\n") + 1.6 for one in row[:1] if one for name in one.places)
    return max(height, 0.15 * lines) if lines else height


def save_charts(path: Path, rows: Sequence[Sequence[Chart]], *, title: str, **more: Any) -> list[Path]:
    """Write a figure of charts in the format of the suffix and return the file. Raises OutputError."""
    with styled(mathematics=False):
        return save_figure(chart_figure(rows, title=title, **more), path.parent, path.stem, [path.suffix[1:]])


def draw_chart(axes: Axes, chart: Chart) -> None:
    """Draw a chart on the given axes, without a legend."""
    from matplotlib.ticker import LogLocator

    axes.set_ylabel("" if chart.places else style.axis_label(chart.words, chart.unit))
    axes.set_xlabel(f"{chart.across} ({chart.across_unit})" if chart.across_unit else chart.across)
    if chart.head:
        axes.set_title(chart.head, loc="left", color=style.BLACK)
    if chart.empty:
        style.empty(axes)
        return
    for name, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        _scale(axes, axis, name, logarithmic=name in chart.logarithmic, counts=_counts(chart))
    for band in chart.bands:
        where = None if band.where is None else band.where.tolist()
        axes.fill_between(band.x, band.low, band.high, where=where, color=band.colour, alpha=band.opacity, linewidth=0.0)
    for line in chart.lines:
        marks = {"line": {}, "points": {"linestyle": "none", "marker": "o"}, "both": {"marker": "o"}}[line.kind]
        look = {"linestyle": style.line_style(line.dash), "markersize": 3.2, "linewidth": line.width, **marks}
        axes.plot(line.x, line.y, color=line.colour, alpha=line.opacity, label=line.label, **look)
    if chart.places:
        axes.set_yticks(range(len(chart.places)), chart.places)
        axes.set_ylim(len(chart.places) - 0.5, -0.5)
    if chart.mark is not None:
        axes.axvline(chart.mark, color=style.GREY, linewidth=0.8, zorder=1.0)
    if chart.span is not None:
        axes.set_ylim(*chart.span)
    if chart.reach is not None:
        axes.set_xlim(*chart.reach)
    elif chart.places:
        axes.margins(x=0.06)
    for name, axis, (low, high) in (("x", axes.xaxis, axes.get_xlim()), ("y", axes.yaxis, axes.get_ylim())):
        if name in chart.logarithmic and high > low * MANY:
            axis.set_major_locator(LogLocator(10.0, numticks=8))
    if chart.note:
        # Write the note above the axes, where it hides no curve.
        axes.text(1.0, 1.02, chart.note, transform=axes.transAxes, ha="right", va="bottom", fontsize=8, color=style.GREY)


def _counts(chart: Chart) -> bool:
    """Whether the horizontal axis counts something, such as iterations, so that it has whole numbers without a unit."""
    places = [np.asarray(line.x, dtype=float) for line in chart.lines]
    return not chart.across_unit and all(np.array_equal(x, np.round(x)) for x in places)


def _scale(axes: Axes, axis: Axis, name: str, *, logarithmic: bool, counts: bool) -> None:
    """Scale an axis, with few tick labels that are plain numbers. counts: whether the horizontal axis has whole numbers."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    from asrsim.plots.ticks import TICKS

    if logarithmic:
        axes.set(**{f"{name}scale": "log"})
        axis.set_major_locator(LogLocator(10.0, subs=(1.0, 2.0, 5.0), numticks=8))
        axis.set_minor_formatter(NullFormatter())
    elif name == "x":
        axis.set_major_locator(MaxNLocator(5, integer=counts, min_n_ticks=1 if counts else 2))
    axis.set_major_formatter(TICKS)


def _alike(one: Chart | None, other: Chart | None) -> bool:
    return one is not None and other is not None and one.across == other.across


def _labels(row: Sequence[Chart | None]) -> dict[str, Any]:
    """Handles of the legend of a row, by their labels."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    found: dict[str, Any] = {}
    for chart in row:
        for line in chart.lines if chart is not None and not chart.empty else ():
            marks = {} if line.kind == "line" else {"marker": "o", "markersize": 3.5}
            shape = "none" if line.kind == "points" else style.line_style(line.dash)
            look: dict[str, Any] = {"color": line.colour, "linewidth": max(line.width, 1.6), "linestyle": shape, **marks}
            found.setdefault(line.label, Line2D([], [], label=line.label, **look))
        for band in chart.bands if chart is not None and not chart.empty else ():
            found.setdefault(band.label, Patch(color=band.colour, alpha=max(band.opacity, 0.2), linewidth=0, label=band.label))
    found.pop("", None)
    return found


def _legend(axes: Axes, row: Sequence[Chart | None]) -> None:
    handles = _labels(row)
    if len(handles) > 1:
        axes.legend(handles=[*handles.values()], loc="upper left", bbox_to_anchor=(1.02, 1.0))
