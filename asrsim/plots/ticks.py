"""Figure class and tick labels of asrsim. Imports Matplotlib: import this module only where pictures are drawn."""

from __future__ import annotations

import math
from io import BytesIO
from itertools import pairwise

from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

SMALL, LARGE = 1e-3, 1e5
"""If the largest number on an axis lies outside this range, all its numbers are written with powers of ten."""


class Plain(ScalarFormatter):
    """Tick formatter that writes the power of ten at each number: a common power would cover the panel's title."""

    def __init__(self) -> None:
        super().__init__(useOffset=False)
        self.set_scientific(False)

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Label of the tick at `x`."""
        if not isinstance(self.axis, Axis):
            return str(super().__call__(x, pos))
        largest = max(abs(end) for end in self.axis.get_view_interval())
        if SMALL <= largest < LARGE:
            return str(super().__call__(x, pos))
        # All ticks share one power and have as many digits as are needed to distinguish them, instead of 8e-05 beside 0.0001.
        power = math.floor(math.log10(largest)) if largest else 0
        step = min((abs(b - a) for a, b in pairwise(self.axis.get_majorticklocs())), default=largest) or largest
        digits = max(0, power - math.floor(math.log10(step) + 1e-9)) if step else 0
        return str(self.fix_minus(f"{x / 10.0**power:.{digits}f}e{power}" if x else "0"))


class AggFigure(Figure):
    """Figure with the Agg canvas, independent of pyplot, that displays itself in a notebook."""

    def __init__(self, width: float, height: float) -> None:
        """Create an empty figure; width and height in inches."""
        super().__init__(figsize=(width, height))
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        stream = BytesIO()
        self.savefig(stream, format="png")
        return stream.getvalue()
