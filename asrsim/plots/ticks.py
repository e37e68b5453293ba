"""Numbers along an axis."""

from __future__ import annotations

import math
from itertools import pairwise

from matplotlib.axis import Axis
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
        # As many digits as tell one tick from the next.
        step = min((abs(b - a) for a, b in pairwise(self.axis.get_majorticklocs())), default=largest) or largest
        return str(self.fix_minus(f"{x:.{max(3, math.ceil(math.log10(max(largest / step, 1.0))) + 1)}g}"))
