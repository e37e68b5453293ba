"""Simulation and experiment on common axes, with their difference below."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.plots import style
from asrsim.plots.curves import REFERENCE, RunCurves, joint_info
from asrsim.plots.figures import PER_PAGE, FigurePage, figure_title, joint_title
from asrsim.plots.layout import PanelGrid
from asrsim.plots.legends import legend
from asrsim.plots.pairing import Pair, RunComparison
from asrsim.plots.view import draw_curve, label_values, show_time, show_values
from asrsim.quantities import each_motor, shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = 3
"""Largest number of runs for which the root mean square of the difference is written into the picture."""
_BESIDE_REFERENCE = ("link_position", "equilibrium_position")
_FIRST = ("link_position", "equilibrium_position", "deflection", "stiffness", *each_motor("motor_{}_position"))


def comparison_pages(runs: Sequence[RunCurves], compared: Sequence[RunComparison], *, references: bool) -> Iterator[FigurePage]:
    """All comparison pages. runs: curves in the order of `compared`; references: whether recorded references are also drawn."""
    keys = dict.fromkeys(key for one in compared for key in one.pairs)
    quantities = sorted(dict.fromkeys(q for _, q in keys), key=lambda q: _FIRST.index(q) if q in _FIRST else len(_FIRST))
    if not references:
        quantities = [q for q in quantities if not q.startswith("reference")] or quantities
    joints = [j for j in dict.fromkeys(j for j, _ in keys) if any((j, q) in keys for q in quantities)]
    pages = [
        (joints[a : a + PER_PAGE], quantities[b : b + PER_PAGE])
        for a in range(0, len(joints), PER_PAGE)
        for b in range(0, len(quantities), PER_PAGE)
    ]
    pages = [(js, [q for q in qs if any((j, q) in keys for j in js)]) for js, qs in pages]
    pages = [(js, qs) for js, qs in pages if qs]
    for number, (members, names) in enumerate(pages, 1):
        figure = overlay_figure(runs, compared, members, names, part=(number, len(pages)))
        yield FigurePage(name="comparison" if len(pages) == 1 else f"comparison_{number}", figure=figure)


def overlay_figure(
    runs: Sequence[RunCurves],
    compared: Sequence[RunComparison],
    joints: Sequence[str],
    quantities: Sequence[str],
    *,
    part: tuple[int, int] = (1, 1),
) -> Figure:
    """Figure with simulation and experiment for every joint (column) and quantity, and the difference of the two curves
    below."""
    wide = style.COLUMN_WIDTH * (1.6 if len(joints) == 1 else 0.9)
    heights = [height for _ in quantities for height in (1.75, 0.85)]
    grid = PanelGrid(columns=len(joints), heights=heights, width=wide, gap_y=0.25)
    figure, axes = grid.figure([one.label for one in compared], sharex="col")
    for c, joint in enumerate(joints):
        for r, quantity in enumerate(quantities):
            draw_overlay(axes[2 * r, c], runs, compared, joint, quantity)
            draw_difference(axes[2 * r + 1, c], runs, compared, joint, quantity)
        axes[0, c].set_title(joint_title(joint_info(runs, joint)), loc="left")
        axes[-1, c].set_xlabel("time (s)")
    banded = max((pair.count for one in compared for pair in one.pairs.values()), default=1)
    has_reference = any((joint, REFERENCE) in run.curves for run in runs for joint in joints)
    for r, quantity in enumerate(quantities):
        names = [quantity, *([REFERENCE] if has_reference and quantity in _BESIDE_REFERENCE else [])]
        words = {quantity: "simulation"}
        legend(axes[2 * r, -1], names, words=words, extra=_experiment_handles(banded), several=len(compared) > 1)
    figure_title(figure, runs, "simulation and experiment", part, more=_moved(compared))
    return figure


def draw_overlay(axes: Axes, runs: Sequence[RunCurves], compared: Sequence[RunComparison], joint: str, quantity: str) -> None:
    """Draw simulations in the variants' colours over thin dark curves of experiments. Several experiments give a shaded
    area."""
    found = [
        (n, run, one.pairs[joint, quantity])
        for n, (run, one) in enumerate(zip(runs, compared, strict=True))
        if (joint, quantity) in one.pairs
    ]
    shared = len({one.recordings for one in compared}) == 1
    drawn = [
        curve for _, _, pair in found for curve in (pair.simulation, pair.recording, pair.low, pair.high) if curve is not None
    ]
    show_time(axes, drawn)
    for number, run, pair in found:
        colour = style.variant_colour(number) if len(compared) > 1 else style.colour(quantity)
        if not (shared and number):
            ink = style.EXPERIMENT if shared else style.darker(colour)
            _experiment(axes, pair, ink, f"{joint}.{quantity}.experiment.{number}")
        reference = run.get(joint, REFERENCE)
        if number == 0 and reference is not None and quantity in _BESIDE_REFERENCE:
            draw_curve(axes, reference, colour=style.colour(REFERENCE), reference=True, gid=f"{joint}.{quantity}.reference")
            drawn.append(reference)
        draw_curve(
            axes, pair.simulation, colour=colour, zorder=2.3, linewidth=1.9, gid=f"{joint}.{quantity}.simulation.{number}"
        )
    unit = style.unit(quantity, joint_info(runs, joint))
    show_values(axes, drawn, brief="N" in unit)
    label_values(axes, style.name(quantity), unit)


def draw_difference(
    axes: Axes, runs: Sequence[RunCurves], compared: Sequence[RunComparison], joint: str, quantity: str
) -> None:
    """Draw simulation minus experiment on the given axes and write the root mean square of the difference into them."""
    unit = style.unit(quantity, joint_info(runs, joint))
    found = [(n, one.pairs[joint, quantity]) for n, one in enumerate(compared) if (joint, quantity) in one.pairs]
    for place, (number, pair) in enumerate(found):
        colour = style.variant_colour(number) if len(compared) > 1 else style.colour(quantity)
        draw_curve(axes, pair.difference, colour=colour, linewidth=0.9, gid=f"{joint}.{quantity}.difference.{number}")
        if math.isfinite(pair.rmse) and place < SHOWN:
            share = f" ({100 * pair.nrmse:.{0 if pair.nrmse >= 0.1 else 1}f} %)" if math.isfinite(pair.nrmse) else ""
            axes.text(
                1.0 - 0.3 * (min(len(found), SHOWN) - 1 - place),
                1.02,
                f"{'' if place else 'RMSE '}{shown(pair.rmse, unit)}{share}",
                transform=axes.transAxes,
                ha="right",
                va="bottom",
                fontsize=7.5,
                color=colour if len(compared) > 1 else style.GREY,
            )
    axes.axhline(0.0, color=style.GREY, linewidth=0.6, zorder=1.0)
    size = max((pair.difference.extent for _, pair in found), default=0.0)
    whole = max(
        (float(np.ptp(v)) for _, p in found if len(v := p.recording.values[np.isfinite(p.recording.values)])), default=0.0
    )
    if size > 1e-9 * whole:
        show_values(axes, [pair.difference for _, pair in found], brief="N" in unit)
    else:
        # Draw a negligible difference on the scale of the compared curves.
        axes.set_ylim(-0.1 * (whole or 1.0), 0.1 * (whole or 1.0))
    label_values(axes, "difference\n", unit or "-")


def _moved(compared: Sequence[RunComparison]) -> str:
    """Shifts of the recordings' clocks as text for the title."""
    lags = dict.fromkeys(a.said for one in compared for a in one.alignments.values() if abs(a.lag) > 1e-9)
    return f"recording {', '.join(list(lags)[:4])}" if lags else ""


def _experiment(axes: Axes, pair: Pair, ink: str, gid: str) -> None:
    if pair.low is not None and pair.high is not None:
        axes.fill_between(pair.low.time, pair.low.values, pair.high.values, color=ink, alpha=0.18, linewidth=0)
    draw_curve(axes, pair.recording, colour=ink, linewidth=0.8, zorder=2.5, gid=gid)


def _experiment_handles(count: int) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if count < 2:
        return [Line2D([], [], color=style.EXPERIMENT, linewidth=1.2, label="experiment")]
    return [
        Line2D([], [], color=style.EXPERIMENT, linewidth=1.2, label=f"experiment,\nmean of {count} runs"),
        Patch(color=style.EXPERIMENT, alpha=0.18, linewidth=0, label="their range"),
    ]
