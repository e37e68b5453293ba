"""Figure class and tick labels of asrsim. Imports Matplotlib: import this module only where pictures are drawn."""

from __future__ import annotations

from io import BytesIO

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

TICKS = "{x:.9g}"
"""Format of tick labels. It writes the power of ten at each number, since a common power would cover the panel's title. It has
nine digits, since an axis may show a change by a millionth (`asrsim.plots.view`): with fewer digits, several ticks would have
the same label."""


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
