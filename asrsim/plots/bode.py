"""Bode plots: the link's response to its reference, of simulation and experiment together, with coherence."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.plots import style
from asrsim.plots.figures import PER_PAGE, Page, describe, new_figure, shorten
from asrsim.plots.responses import OUTPUT, Response
from asrsim.samples import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TRUSTED = 0.5
"""Coherence below which a point is drawn faint and does not set the limits of the axes."""


def bode_pages(found: Sequence[Response], *, title: str) -> Iterator[Page]:
    """Gain, phase and coherence; joints in columns."""
    joints = list(dict.fromkeys(one.joint.name for one in found))
    pages = [joints[a : a + PER_PAGE] for a in range(0, len(joints), PER_PAGE)]
    for number, members in enumerate(pages, 1):
        suffix = "" if len(pages) == 1 else f" · page {number} of {len(pages)}"
        figure = bode_figure([one for one in found if one.joint.name in members], title=title + suffix)
        yield Page(name="bode" if len(pages) == 1 else f"bode_{number}", figure=figure)


def bode_figure(found: Sequence[Response], *, title: str = "") -> Figure:
    """A Bode plot of responses: colour for the simulation, black for experiments, variants by line style."""
    from matplotlib.lines import Line2D

    joints = {one.joint.name: one.joint for one in found}
    wide = style.COLUMN_WIDTH * (1.4 if len(joints) == 1 else 1.0)
    figure = new_figure(wide * len(joints) + style.LEGEND_WIDTH + 0.4, 5.6)
    axes = figure.subplots(3, len(joints), squeeze=False, sharex="col", gridspec_kw={"height_ratios": [1.6, 1.3, 0.8]})
    for c, (name, info) in enumerate(joints.items()):
        draw_bode(axes[0, c], axes[1, c], axes[2, c], [one for one in found if one.joint.name == name])
        axes[0, c].set_title(f"{shorten(name, 40)}\n{describe(info)}", loc="left")
    handles: list[Any] = []
    for one in {(r.variant, r.experiment): r for r in found}.values():
        text = f"{'experiment' if one.experiment else 'simulation'}\n{style.plain(one.label)}"
        handles.append(Line2D([], [], color=_colour(one), linestyle=style.line_style(one.variant), linewidth=1.6, label=text))
    axes[0, -1].legend(handles=handles, loc="upper left", bbox_to_anchor=(1.02, 1.0), labelspacing=0.8)
    confidence = found[0].response.confidence if found else 0.95
    axes[1, -1].text(
        1.02, 1.0, f"shaded: {confidence:.0%}\nconfidence", transform=axes[1, -1].transAxes, va="top", fontsize=8,
        color=style.GREY,
    )  # fmt: skip
    figure.align_ylabels()
    if title:
        figure.suptitle(title, fontsize=10.5, x=0.01, ha="left", color=style.BLACK)
    return figure


def draw_bode(gain: Axes, phase: Axes, coherence: Axes, found: Sequence[Response]) -> None:
    """Gain (dB), phase and coherence of one joint's responses on the given axes, with confidence bands."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    levels: list[Array] = []
    angles: list[Array] = []
    for one in found:
        result = one.response
        colour, line = _colour(one), style.line_style(one.variant)
        floor = 1e-6 * max(float(result.gain.max()), 1e-12)
        level = 20 * np.log10(np.maximum(result.gain, floor))
        low, high = (20 * np.log10(np.maximum(edge, floor)) for edge in (result.gain_low, result.gain_high))
        trusted = result.coherence >= TRUSTED
        kind = "experiment" if one.experiment else "simulation"
        gid = f"{one.joint.name}.{kind}.{one.variant}"
        for ax, values, margin in (
            (gain, level, (low, high)),
            (phase, result.phase, (result.phase - result.phase_margin, result.phase + result.phase_margin)),
        ):
            below, above = margin
            ax.fill_between(result.frequency, below, above, color=colour, alpha=0.15, linewidth=0, where=trusted.tolist())
            ax.plot(result.frequency, np.where(trusted, values, np.nan), color=colour, linestyle=line, gid=gid)
            ax.plot(result.frequency, np.where(trusted, np.nan, values), color=colour, linewidth=0.6, alpha=0.35)
        coherence.plot(result.frequency, result.coherence, color=colour, linestyle=line, linewidth=0.9)
        levels.append(level[trusted])
        angles.append(result.phase[trusted])
        if result.resonance is not None:
            gain.plot(result.resonance[0], 20 * math.log10(result.resonance[1]), "o", ms=3.5, color=colour, zorder=4)
    for ax, parts in ((gain, levels), (phase, angles)):
        known = np.concatenate(parts) if parts else np.empty(0)
        if len(known):
            edge = 0.1 * max(float(np.ptp(known)), 1.0)
            ax.set_ylim(float(known.min()) - edge, float(known.max()) + edge)
    gain.set_xscale("log")
    start, end = min(one.response.band[0] for one in found), max(one.response.band[1] for one in found)
    gain.set_xlim(start, end)
    # Less than two decades have too few powers of ten for labels.
    steps = (1.0, 2.0, 3.0, 4.0, 6.0) if end < 15 * start else (1.0, 2.0, 5.0) if end < 100 * start else (1.0,)
    coherence.xaxis.set_major_locator(LogLocator(subs=steps))
    coherence.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    coherence.xaxis.set_minor_formatter(NullFormatter())
    coherence.set_ylim(0.0, 1.05)
    unit = found[0].unit
    gain.set_ylabel(f"gain (dB re {unit})" if unit else "gain (dB)")
    phase.set_ylabel("phase (°)")
    coherence.set_ylabel("coherence")
    coherence.set_xlabel("frequency (Hz)")


def _colour(one: Response) -> str:
    return style.EXPERIMENT if one.experiment else style.colour(OUTPUT)
