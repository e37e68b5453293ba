"""Pictures of data sheets: the numbers as a table above the curves, on one page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim.datasheet.data import Sheet
from asrsim.datasheet.rows import compared_rows, number_rows
from asrsim.plots import style
from asrsim.plots.charts import chart_figure
from asrsim.plots.output import save_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from asrsim.plots.chart import Chart

HEIGHT = 2.0
"""Height of a row of charts in inches."""
LINE, LETTER, SIZE = 0.175, 0.066, 8.0
"""LINE: height of a line of the table, inch; LETTER: width of a letter, inch; SIZE: font size, pt."""
LEFT, TOP, GAP = 0.12, 0.42, 0.25
"""Space in inches. LEFT: left of the table; TOP: above the table; GAP: between its columns."""


def save_sheet(path: Path, sheet: Sheet) -> list[Path]:
    """Write the picture of a sheet in the format of the suffix, and return the file. Raises OutputError."""
    heads, rows = number_rows(sheet)
    return _save(path, heads, rows, sheet.rows, title=f"{sheet.title}: {sheet.origin}")


def save_comparison(path: Path, sheets: Sequence[Sheet], charts: Sequence[Sequence[Chart]]) -> list[Path]:
    """Write the picture of several sheets side by side, and return the file. Raises OutputError."""
    heads, rows = compared_rows(sheets)
    return _save(path, heads, rows, charts, title="Softest (solid) and stiffest (dashed) setting")


def _save(
    path: Path, heads: Sequence[str], rows: Sequence[Sequence[str]], charts: Sequence[Sequence[Chart]], *, title: str
) -> list[Path]:
    with styled(mathematics=False):
        figure = chart_figure(charts, title=title, height=HEIGHT)
        _head(figure, heads, rows)
        return save_figure(figure, path.parent, path.stem, [path.suffix[1:]])


def _head(figure: Figure, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Make room above the charts of a figure, and write a table there."""
    columns = [*zip(heads, *rows, strict=True)]
    starts = [LEFT]
    for column in columns:
        starts.append(starts[-1] + LETTER * max(map(len, column)) + GAP)
    before, wide = figure.get_figheight(), max(figure.get_figwidth(), starts[-1])
    high = before + LINE * (len(rows) + 1)
    scale, across = before / high, figure.get_figwidth() / wide
    places = [(axes, axes.get_position()) for axes in figure.axes]
    figure.set_size_inches(wide, high)
    for axes, place in places:
        axes.set_position((place.x0 * across, place.y0 * scale, place.width * across, place.height * scale))
    for text in figure.texts:
        x, y = text.get_position()
        text.set_position((x * across, 1.0 - (1.0 - y) * scale))
    for start, column in zip(starts, columns, strict=False):
        for i, text in enumerate(column):
            y = 1.0 - (TOP + LINE * i) / high
            figure.text(start / wide, y, text, fontsize=SIZE, va="top", color=style.GREY if i == 0 else style.BLACK)
