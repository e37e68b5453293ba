"""What of a curve is in view: limits of axes that no single sample flattens, and envelopes of what is too fast for a line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.plots import style
from asrsim.plots.world import Curve
from asrsim.samples import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BRIEF = 0.005
"""Share of the time for which something may last that is cut off, if it flattens all the rest."""
FLATTENED = 4.0
"""Times the rest's range from which on it does."""
WINDOW = 7.0
"""Pixels of an envelope's window."""
DENSE = 4
"""Samples a pixel from which on there may be an envelope: a curve of fewer samples is a line."""
BLOCK = 10.0
"""Times that a curve crosses the range of three windows from which on it is drawn as an envelope: 4 pixels a period."""
HOLD = 0.85
"""Share of these down to which it stays one: a chirp does not go to and fro between both."""
THIN = 0.012
"""Share of the range below which a line of usual width covers an envelope: noise of an encoder at rest."""


@dataclass(frozen=True, kw_only=True)
class Split:
    """A curve as it is drawn."""

    line: Curve
    """Where a line shows it; NaN elsewhere."""
    low: Curve | None = None
    """Lower edge of the envelope, NaN where a line shows it; None where nothing is too fast."""
    high: Curve | None = None


def split(curve: Curve, start: float, end: float, pixels: float) -> Split:
    """What a panel so many pixels wide, from `start` to `end` (s), shows of a curve as a line and what as an envelope.

    An oscillation too fast for the pixels would be a solid block.
    """
    inside = np.flatnonzero((curve.time >= start) & (curve.time <= end) & np.isfinite(curve.values))
    count = int(pixels / WINDOW)
    if count < 4 or len(inside) < DENSE * pixels:
        return Split(line=curve)
    time, values = curve.time[inside], curve.values[inside]
    window = np.minimum(((time - start) / (end - start) * count).astype(int), count - 1)
    way: Array = np.bincount(window, np.abs(np.diff(values, prepend=values[0])), minlength=count).astype(np.float64)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, window, values)
    np.maximum.at(high, window, values)
    size = _widened(high) + _widened(-low)
    way = np.convolve(way, np.ones(3), "same")
    way[[0, -1]] *= 1.5  # of two windows only
    seen = size > THIN * float(np.ptp(values))
    fast = seen & (way > BLOCK * size)
    # One window alone is no stretch.
    fast &= _beside(fast, -1, False) | _beside(fast, 1, False)
    fast = _grown(fast, seen & (way > HOLD * BLOCK * size))
    if not fast.any():
        return Split(line=curve)
    shown = np.array(curve.values)
    shown[inside[fast[window]]] = np.nan
    edges = start + np.arange(count + 1) * (end - start) / count
    points = [(np.nan, np.nan, np.nan)]
    for w in np.flatnonzero(fast).tolist():
        if not fast[w - 1] or w == 0:
            points.append((edges[w], low[w], high[w]))
        points.append((0.5 * (edges[w] + edges[w + 1]), low[w], high[w]))
        if w + 1 == count or not fast[w + 1]:
            points += [(edges[w + 1], low[w], high[w]), (edges[w + 1], np.nan, np.nan)]
    when, below, above = np.array(points).T
    return Split(
        line=Curve(time=curve.time, values=shown), low=Curve(time=when, values=below), high=Curve(time=when, values=above)
    )


def _widened(high: Array) -> Array:
    """The largest of each window and of the windows beside it."""
    return np.asarray(np.maximum(np.maximum(_beside(high, -1, -np.inf), _beside(high, 1, -np.inf)), high))


def _grown(core: Any, around: Any) -> Any:
    """The stretches of `around` that hold some of `core`."""
    stretch = np.cumsum(np.diff(around.astype(int), prepend=0) != 0)
    return core | (around & np.isin(stretch, stretch[core]))


def _beside(values: Any, step: int, fill: Any) -> Any:
    """The values of the windows before (-1) or behind (1)."""
    moved = np.full_like(values, fill)
    if step < 0:
        moved[1:] = values[:-1]
    else:
        moved[:-1] = values[1:]
    return moved


def draw_curve(axes: Axes, curve: Curve, *, gid: str, colour: str, linestyle: Any = "-", **more: Any) -> None:
    """A line, and where it would be a block, its envelope."""
    start, end = axes.get_xlim()
    pixels = float(axes.get_window_extent().width)
    parts = split(curve, start, end, pixels)
    axes.plot(parts.line.time, parts.line.values, color=colour, linestyle=linestyle, gid=gid, **more)
    if parts.low is not None and parts.high is not None:
        axes.fill_between(
            parts.low.time, parts.low.values, parts.high.values, facecolor=style.rgba(colour, 0.3),
            edgecolor=style.rgba(colour, 0.9), linewidth=0.7, gid=f"{gid}.envelope", zorder=more.get("zorder", 2.0) - 0.1,
        )  # fmt: skip


def show_time(axes: Axes, curves: Sequence[Curve]) -> None:
    """The axis of time: all of the curves. Comes first: how a curve is drawn depends on it."""
    times = [(curve.time[0], curve.time[-1]) for curve in curves if len(curve.time)]
    if not times:
        return
    start, end = min(t[0] for t in times), max(t[1] for t in times)
    if end > start:
        # A start that misses 0 by the rounding of a lag would take the 0 off the axis.
        axes.set_xlim(0.0 if abs(start) < 1e-4 * (end - start) else start, end)


def show_values(
    axes: Axes, curves: Sequence[Curve], *, limits: Sequence[Curve] = (), brief: bool, still: float = 1e-12
) -> None:
    """The axis of values: all of the curves, and the limits that they come near.

    Values that rest are not blown up to show their last digits, nor is what is smaller than `still`.
    brief: what lasts for a moment and flattens all the rest is cut off, with an arrow and its value at the edge.
    """
    finite = [curve.values[np.isfinite(curve.values)] for curve in curves]
    low = min((float(v.min()) for v in finite if len(v)), default=0.0)
    high = max((float(v.max()) for v in finite if len(v)), default=0.0)
    size = max(abs(low), abs(high))
    if high - low <= 1e-6 * size or size < still:
        half = 0.1 * (size if size >= still else 1.0)
        axes.set_ylim(low - half, high + half)
        return
    peaks: list[tuple[Curve, float]] = []
    if brief and (core := _core(curves)) is not None and high - low > FLATTENED * (core[1] - core[0]):
        margin = 0.25 * (core[1] - core[0])
        beyond = [high] * (high > core[1] + margin) + [low] * (low < core[0] - margin)
        peaks = [(next(c for c in curves if (c.values == extreme).any()), extreme) for extreme in beyond]
        low, high = max(low, core[0] - margin), min(high, core[1] + margin)
    for curve in limits:
        near = curve.values[np.isfinite(curve.values)]
        near = near[(near > low - 0.3 * (high - low)) & (near < high + 0.3 * (high - low))]
        if len(near):
            low, high = min(low, float(near.min())), max(high, float(near.max()))
    margin = 0.07 * (high - low)
    axes.set_ylim(low - margin, high + margin)
    for curve, value in peaks:
        _mark(axes, float(curve.time[np.flatnonzero(curve.values == value)[0]]), value, above=value > high)


def _core(curves: Sequence[Curve]) -> tuple[float, float] | None:
    """Between which values all curves are but for a moment; None where that is no range."""
    ranges = []
    for curve in curves:
        good = np.isfinite(curve.values)
        if good.sum() < 8:
            continue
        values, weights = curve.values[good], np.gradient(curve.time[good])
        order = np.argsort(values)
        share = np.cumsum(weights[order]) / weights.sum()
        ranges.append(np.interp([BRIEF / 2, 1 - BRIEF / 2], share, values[order]))
    if not ranges:
        return None
    low, high = float(min(r[0] for r in ranges)), float(max(r[1] for r in ranges))
    return (low, high) if high > low else None


def _mark(axes: Axes, time: float, value: float, *, above: bool) -> None:
    start, end = axes.get_xlim()
    share = (time - start) / (end - start)
    late = share > 0.7
    axes.annotate(
        f"{'▲' if above else '▼'} {value:.3g}" if not late else f"{value:.3g} {'▲' if above else '▼'}",
        (share, 0.985 if above else 0.015), xycoords="axes fraction", ha="right" if late else "left",
        va="top" if above else "bottom", fontsize=7, color=style.BLACK, zorder=5,
        bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.75},
    )  # fmt: skip
