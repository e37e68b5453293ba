"""Curves on axes, and limits of the axes that no single sample flattens."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.plots import style
from asrsim.plots.world import Curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BRIEF = 0.005
"""Share of the time for which something may last that is cut off, if it flattens all the rest."""
FLATTENED = 4.0
"""Times the rest's range from which on it does."""


def draw_curve(axes: Axes, curve: Curve, *, gid: str, colour: str, linestyle: Any = "-", **more: Any) -> None:
    """A line; gid: its name in an SVG file."""
    axes.plot(curve.time, curve.values, color=colour, linestyle=linestyle, gid=gid, **more)


def show_time(axes: Axes, curves: Sequence[Curve]) -> None:
    """Scale the time axis to hold all curves."""
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
