"""Where panels stand on a page, in inches: known beforehand, so that no layout has to be solved for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from asrsim.plots import style
from asrsim.plots.legends import variant_rows, variants

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEFT, GAP_X, GAP_Y, BOTTOM = 0.95, 0.98, 0.17, 0.44
"""inch: for labels left of the panels and between them, between rows, and below the lowest."""
HEAD, TITLE = 0.34, 0.46
"""inch: the figure's title; a column's title of two lines."""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Panels in rows and columns."""

    columns: int
    heights: Sequence[float]
    """inch, of each row."""
    width: float = style.COLUMN_WIDTH
    """inch, of a column without its labels."""
    gap_y: float = GAP_Y
    title: float = TITLE
    """inch above the panels, for the columns' titles."""
    right: float = style.LEGEND_WIDTH
    """inch, for the legends."""
    gap_x: float = GAP_X

    def figure(self, labels: Sequence[str], **more: Any) -> tuple[Figure, Any]:
        """The figure and its axes (rows, columns), with the legend of variants below."""
        from asrsim.plots.ticks import Picture, Plain

        width = LEFT + self.columns * self.width + (self.columns - 1) * self.gap_x + self.right
        foot = BOTTOM + (0.12 + 0.18 * -(-len(labels) // variant_rows(labels, width)) if len(labels) > 1 else 0.0)
        inner = sum(self.heights) + (len(self.heights) - 1) * self.gap_y
        height = HEAD + self.title + inner + foot
        figure = Picture(width, height)
        mean = sum(self.heights) / len(self.heights)
        axes = figure.subplots(
            len(self.heights), self.columns, squeeze=False, **more,
            gridspec_kw={
                "height_ratios": list(self.heights), "hspace": self.gap_y / mean, "wspace": self.gap_x / self.width,
                "left": LEFT / width, "right": 1 - self.right / width, "bottom": foot / height,
                "top": 1 - (HEAD + self.title) / height,
            },
        )  # fmt: skip
        for ax in axes.flat:
            # Ticks' labels are as wide as they are: labels of axes stand in one line all the same.
            ax.yaxis.set_label_coords(-0.57 / self.width, 0.5)
            ax.yaxis.set_major_formatter(Plain())
        variants(figure, labels)
        return figure, axes


def set_title(figure: Figure, text: str) -> None:
    """The figure's title, one line at the top left."""
    figure.suptitle(text, fontsize=10.5, x=0.12 / figure.get_figwidth(), y=1 - 0.12 / figure.get_figheight(), ha="left",
                    va="top", color=style.BLACK)  # fmt: skip
