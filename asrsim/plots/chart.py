"""Charts: curves and shaded areas as plain data, which a figure (`asrsim.plots.charts`) or a page (`asrsim.report`) draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from asrsim.plots import style
from asrsim.samples import Array

Kind = Literal["line", "points", "both"]


@dataclass(frozen=True, kw_only=True)
class Line:
    """Curve of a chart. NaN marks a gap."""

    label: str
    """Name in the legend. Lines with the same label in one row of charts share an entry; an empty label has no entry."""
    x: Array
    y: Array
    colour: str
    width: float = style.WIDTH
    """Width, pt."""
    dash: int = 0
    """Number of the line style, as in `style.LINE_STYLES`."""
    kind: Kind = "line"
    opacity: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Shade:
    """Shaded area between two curves."""

    label: str
    x: Array
    low: Array
    high: Array
    colour: str
    opacity: float = 0.2
    where: NDArray[np.bool_] | None = None
    """Points (n,) between which the area is shaded; None: everywhere."""


@dataclass(frozen=True, kw_only=True)
class Chart:
    """Axes with curves over a common quantity."""

    words: str
    """Quantity of the vertical axis, in words."""
    unit: str = ""
    head: str = ""
    """Title above the axes, such as the name of the joint to which the charts of a row belong."""
    across: str = "time"
    across_unit: str = "s"
    lines: Sequence[Line] = ()
    bands: Sequence[Shade] = ()
    logarithmic: str = ""
    """Logarithmic axes: `x`, `y` or `xy`."""
    span: tuple[float, float] | None = None
    """Range of the vertical axis; None: the range of the curves."""
    reach: tuple[float, float] | None = None
    """Range of the horizontal axis; None: the range of the curves."""
    note: str = ""
    """Text that is written into the axes, such as a number."""
    places: Sequence[str] = ()
    """Tick labels at the values 0, 1, ... of the vertical axis, from the top; empty: the ticks show numbers."""
    mark: float | None = None
    """Value of the horizontal axis that a vertical line marks."""

    @property
    def empty(self) -> bool:
        """Whether the chart has nothing to show."""
        return not any(np.isfinite(line.y).any() for line in self.lines)
