"""Numbers along an axis."""

from __future__ import annotations

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
        largest = max(abs(end) for end in self.axis.get_view_interval()) if self.axis is not None else 1.0
        return str(super().__call__(x, pos) if SMALL <= largest < LARGE else self.fix_minus(f"{x:.3g}"))
