"""Draws curves on axes, and sets axis limits that a single outlier does not dominate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.plots import style
from asrsim.plots.decimate import Curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BRIEF = 0.005
"""Longest duration of a peak that is cut off, as a fraction of the duration of the curve."""
PREFIXES = (("µ", 1e-6), ("m", 1e-3))
"""Prefixes of smaller units with their factors, the smallest factor first."""
SMALL = 5.0
"""Largest value, in the smaller unit, up to which an axis is labelled in the smaller unit."""
SMALLER = ("m", "rad", "N", "N m", "J")
"""Units that may get a prefix."""
FLATTENED = 4.0
"""Ratio of the range of all values to the range without a peak, above which the peak is cut off."""


def draw_curve(
    axes: Axes, curve: Curve, *, gid: str, colour: str, linestyle: Any = "-", reference: bool = False, **more: Any
) -> None:
    """Draw a line; a reference is wide and lies under the other lines. gid: name of the line in an SVG file."""
    look = {"linewidth": 2.6 if reference else style.WIDTH, "zorder": 1.5 if reference else 2.0, **more}
    axes.plot(curve.time, curve.values, color=colour, linestyle=linestyle, gid=gid, **look)


def show_time(axes: Axes, curves: Sequence[Curve]) -> None:
    """Scale the time axis to show all curves."""
    times = [(curve.time[0], curve.time[-1]) for curve in curves if len(curve.time)]
    if not times:
        return
    start, end = min(t[0] for t in times), max(t[1] for t in times)
    if end > start:
        # If rounding of a lag moves the start slightly off 0, set it to 0; otherwise the axis would lose its label 0.
        axes.set_xlim(0.0 if abs(start) < 1e-4 * (end - start) else start, end)


def show_values(
    axes: Axes, curves: Sequence[Curve], *, limits: Sequence[Curve] = (), brief: bool, still: float = 1e-12
) -> None:
    """Scale the axis of values to all curves and to the limits that the curves approach.

    The range is never narrower than `still` or than rounding errors. brief: whether a peak is cut off that lasts for a moment
    and would flatten the other values; an arrow at the edge marks this peak and states its value.
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


def label_values(axes: Axes, words: str, unit: str) -> None:
    """Label the axis of values, after the range of the axis is set. If the range is a few thousandths or millionths of the
    unit, the label has a smaller unit, such as 0.075 mm in place of 7.5e-05 m."""
    size = max(map(abs, axes.get_ylim()))
    prefix, scale = next(((sign, scale) for sign, scale in PREFIXES if size < SMALL * scale), ("", 1.0))
    if unit not in SMALLER or not prefix:
        axes.set_ylabel(style.axis_label(words, unit))
        return
    axes.set_ylabel(style.axis_label(words, prefix + unit))
    # Write nine digits. With all digits, a rounding error would appear, as in 0.30000000000000004.
    axes.yaxis.set_major_formatter(lambda value, place: f"{value / scale:.9g}".replace("-", "\N{MINUS SIGN}"))


def _core(curves: Sequence[Curve]) -> tuple[float, float] | None:
    """Range that contains the curves except for brief peaks; None if the range is empty."""
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
        (share, 0.985 if above else 0.015),
        xycoords="axes fraction",
        ha="right" if late else "left",
        va="top" if above else "bottom",
        fontsize=7,
        color=style.BLACK,
        zorder=5,
        bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.75},
    )
