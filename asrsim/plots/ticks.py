"""Figures of ours, and the numbers along their axes; imports Matplotlib, so it is imported where pictures are drawn."""

from __future__ import annotations

import math
from io import BytesIO
from itertools import pairwise

from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

SMALL, LARGE = 1e-3, 1e5
"""Where the largest number is beyond them, all are written with powers of ten."""


class Plain(ScalarFormatter):
    """Matplotlib's own, but a power of ten stands at each number: above the axis it would lie over the panel's title."""

    def __init__(self) -> None:
        super().__init__(useOffset=False)
        self.set_scientific(False)

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The label of a tick."""
        if not isinstance(self.axis, Axis):
            return str(super().__call__(x, pos))
        largest = max(abs(end) for end in self.axis.get_view_interval())
        if SMALL <= largest < LARGE:
            return str(super().__call__(x, pos))
        # One power for all ticks, and as many digits as tell one from the next: 8e-05 beside 0.0001 are two ways of writing.
        power = math.floor(math.log10(largest)) if largest else 0
        step = min((abs(b - a) for a, b in pairwise(self.axis.get_majorticklocs())), default=largest) or largest
        digits = max(0, power - math.floor(math.log10(step) + 1e-9)) if step else 0
        return str(self.fix_minus(f"{x / 10.0**power:.{digits}f}e{power:+03d}" if x else "0"))


class Picture(Figure):
    """A figure with the Agg canvas, which pyplot does not know, and which shows itself in a notebook."""

    def __init__(self, width: float, height: float) -> None:
        """width, height: inch."""
        super().__init__(figsize=(width, height))
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        stream = BytesIO()
        self.savefig(stream, format="png")
        return stream.getvalue()
