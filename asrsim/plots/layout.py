"""Positions of the panels on a page, in inches. The positions are computed in advance, so that Matplotlib's layout solver is
not needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from asrsim.plots import style
from asrsim.plots.legends import variant_columns, variants

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEFT, GAP_X, GAP_Y, BOTTOM = 0.95, 0.98, 0.17, 0.44
"""Space for labels, inch. LEFT: left of the panels; GAP_X: between columns; GAP_Y: between rows; BOTTOM: below the lowest
row."""
HEAD, TITLE = 0.34, 0.46
"""HEAD: height of the figure's title, inch; TITLE: height of a column's title with two lines, inch."""


@dataclass(frozen=True, kw_only=True)
class PanelGrid:
    """Panels in rows and columns, with their sizes."""

    columns: int
    heights: Sequence[float]
    """Height of each row, inch."""
    width: float = style.COLUMN_WIDTH
    """Width of a column without its labels, inch."""
    gap_y: float = GAP_Y
    title: float = TITLE
    """Height of the columns' titles above the panels, inch."""
    right: float = style.LEGEND_WIDTH
    """Width of the legends at the right, inch."""
    gap_x: float = GAP_X
    left: float = LEFT
    """Space for the labels left of the first column, inch."""

    def figure(self, labels: Sequence[str], **more: Any) -> tuple[Figure, Any]:
        """Figure with the legend of variants at the bottom, and the axes (rows, columns) of the figure."""
        from asrsim.plots.ticks import TICKS, AggFigure

        width = self.left + self.columns * self.width + (self.columns - 1) * self.gap_x + self.right
        foot = BOTTOM + (0.12 + 0.18 * -(-len(labels) // variant_columns(labels, width)) if len(labels) > 1 else 0.0)
        inner = sum(self.heights) + (len(self.heights) - 1) * self.gap_y
        height = HEAD + self.title + inner + foot
        figure = AggFigure(width, height)
        mean = sum(self.heights) / len(self.heights)
        axes = figure.subplots(
            len(self.heights),
            self.columns,
            squeeze=False,
            **more,
            gridspec_kw={
                "height_ratios": list(self.heights),
                "hspace": self.gap_y / mean,
                "wspace": self.gap_x / self.width,
                "left": self.left / width,
                "right": 1 - self.right / width,
                "bottom": foot / height,
                "top": 1 - (HEAD + self.title) / height,
            },
        )
        for ax in axes.flat:
            # Fix the position of axis labels, which would otherwise depend on the width of the tick labels.
            ax.yaxis.set_label_coords(-0.62 / self.width, 0.5)
            ax.yaxis.set_major_formatter(TICKS)
        variants(figure, labels)
        return figure, axes


def set_title(figure: Figure, text: str) -> None:
    """Write the figure's title in one line at the top left."""
    figure.suptitle(
        text,
        fontsize=10.5,
        x=0.12 / figure.get_figwidth(),
        y=1 - 0.12 / figure.get_figheight(),
        ha="left",
        va="top",
        color=style.BLACK,
    )
