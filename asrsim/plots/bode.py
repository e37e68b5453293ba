"""Bode plots of simulation and experiment on the same axes, with their coherence."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from asrsim.metrics.frequency import CONFIDENCE
from asrsim.plots import style
from asrsim.plots.figures import PER_PAGE, FigurePage, joint_title
from asrsim.plots.layout import PanelGrid, set_title
from asrsim.plots.responses import OUTPUT, Response
from asrsim.samples import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TRUSTED = 0.5
"""Coherence below which a curve is dotted and has no confidence band."""
DOUBTFUL = (0, (1.0, 1.2))
"""Dash pattern of a curve where the coherence is low."""
NARROWEST = 3.0, 20.0
"""Smallest ranges of the gain axis (dB) and the phase axis (degrees), so that negligible differences look small."""


def bode_pages(found: Sequence[Response], *, title: str) -> Iterator[FigurePage]:
    """Pages with gain, phase and coherence in rows and joints in columns."""
    joints = list(dict.fromkeys(one.joint.name for one in found))
    pages = [joints[a : a + PER_PAGE] for a in range(0, len(joints), PER_PAGE)]
    for number, members in enumerate(pages, 1):
        suffix = "" if len(pages) == 1 else f" · page {number} of {len(pages)}"
        figure = bode_figure([one for one in found if one.joint.name in members], title=title + suffix)
        yield FigurePage(name="bode" if len(pages) == 1 else f"bode_{number}", figure=figure)


def pair_in_words(given: str | None, output: str | None) -> str:
    """Input and output of a frequency response in words, for a title."""
    output, given = (style.in_words(text) for text in (output or OUTPUT, given or "its reference"))
    return f"from {given} to {output}"


def bode_figure(found: Sequence[Response], *, title: str = "") -> Figure:
    """Bode plot of several responses. Each simulation has its own colour; curves of experiments are thin and dark."""
    from matplotlib.lines import Line2D

    joints = {one.joint.name: one.joint for one in found}
    labels = list(dict.fromkeys(one.label for one in found))
    moving = [one for one in found if one.response.moves]
    wide = style.COLUMN_WIDTH * (1.4 if len(joints) == 1 else 1.0)
    grid = PanelGrid(columns=len(joints), heights=[2.1, 1.7, 0.9], width=wide, right=1.75)
    figure, axes = grid.figure([], sharex="col")
    several = len(labels) > 1
    for c, (name, info) in enumerate(joints.items()):
        mine = [one for one in moving if one.joint.name == name]
        draw_bode(axes[0, c], axes[1, c], axes[2, c], mine, several=several)
        axes[0, c].set_title(joint_title(info), loc="left")
        axes[-1, c].set_xlabel("frequency (Hz)")
    handles: list[Any] = []
    for one in {(r.variant, r.experiment): r for r in found}.values():
        text = f"{'experiment' if one.experiment else 'simulation'}\n{style.plain(one.label)}"
        text += "" if one.response.moves else "\n(does not move)"
        look: dict[str, Any] = {"color": _colour(one, several=several), "linewidth": 0.9 if one.experiment else 1.6}
        handles.append(Line2D([], [], label=text, **look))
    if any((one.response.coherence < TRUSTED).any() for one in moving):
        look = {"color": style.GREY, "linewidth": 0.9, "linestyle": DOUBTFUL}
        handles.append(Line2D([], [], label=f"coherence\nbelow {TRUSTED:g}", **look))
    if any(one.response.resonance for one in moving):
        handles.append(Line2D([], [], marker="o", ms=3.5, linestyle="", color=style.GREY, label="resonance"))
    axes[0, -1].legend(handles=handles, loc="upper left", bbox_to_anchor=(1.02, 1.0), labelspacing=0.8)
    if any((one.response.coherence >= TRUSTED).any() for one in moving):
        axes[1, -1].text(
            1.02,
            1.0,
            f"shaded: {CONFIDENCE:.0%}\nconfidence",
            transform=axes[1, -1].transAxes,
            va="top",
            fontsize=8,
            color=style.GREY,
        )
    if title:
        set_title(figure, title)
    return figure


def draw_bode(gain: Axes, phase: Axes, coherence: Axes, found: Sequence[Response], *, several: bool) -> None:
    """Draw gain (dB), phase and coherence of one joint's responses on the given axes, with confidence bands."""
    levels: list[Array] = []
    angles: list[Array] = []
    for one in found:
        result = one.response
        look: dict[str, Any] = {"color": _colour(one, several=several), "linewidth": 0.9 if one.experiment else style.WIDTH}
        level, low, high = _decibels(one)
        trusted = result.coherence >= TRUSTED
        kind = "experiment" if one.experiment else "simulation"
        gid = f"{one.joint.name}.{kind}.{one.variant}"
        if len(result.frequency) == 1:
            # Draw a marker, since a line through a single point is invisible.
            look |= {"marker": "o", "markersize": 4.0}
        for ax, values, margin in (
            (gain, level, (low, high)),
            (phase, result.phase, (result.phase - result.phase_margin, result.phase + result.phase_margin)),
        ):
            below, above = margin
            ax.fill_between(result.frequency, below, above, color=look["color"], alpha=0.2, linewidth=0, where=trusted.tolist())
            # Draw the line over the whole frequency range. It is dotted at frequencies at which the input explains little of
            # the output.
            ax.plot(result.frequency, np.where(trusted, values, np.nan), gid=gid, **look)
            if not trusted.all():
                ax.plot(result.frequency, values, **{**look, "linewidth": 0.9, "linestyle": DOUBTFUL}, zorder=1.9)
        coherence.plot(result.frequency, result.coherence, color=look["color"], linewidth=0.9)
        levels.append(_shown(level, trusted, NARROWEST[0]))
        angles.append(_shown(result.phase, trusted, NARROWEST[1]))
        if result.resonance is not None:
            gain.plot(result.resonance[0], 20 * math.log10(result.resonance[1]), "o", ms=3.5, color=look["color"], zorder=4)
    for ax, parts, least in ((gain, levels, NARROWEST[0]), (phase, angles, NARROWEST[1])):
        known = np.concatenate(parts) if parts else np.empty(0)
        if len(known):
            edge = max(0.1 * float(np.ptp(known)), 0.5 * (least - float(np.ptp(known))))
            ax.set_ylim(float(known.min()) - edge, float(known.max()) + edge)
    gain.set_xscale("log")
    if found:
        label_frequencies(gain, min(one.response.band[0] for one in found), max(one.response.band[1] for one in found))
    unit = found[0].unit if found else ""
    gain.set_ylabel(f"gain\n(dB re {unit})" if unit else "gain (dB)")
    phase.set_ylabel("phase (°)")
    coherence.set_ylim(0.0, 1.05)
    coherence.set_ylabel("coherence")


def _shown(values: Array, trusted: NDArray[np.bool_], least: float) -> Array:
    """Values that determine the limits of the axis. Values with low coherence are clipped to a range around the values with
    high coherence."""
    if trusted.all() or not trusted.any():
        return values
    low, high = float(values[trusted].min()), float(values[trusted].max())
    room = max(high - low, 2.0 * least)
    return np.clip(values, low - room, high + room)


def label_frequencies(axes: Axes, start: float, end: float) -> None:
    """Label the frequency axis at 1, 2, 5, 10 Hz and so on; a narrow range of frequencies gets evenly spaced labels. A single
    frequency is centred.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

    single = end <= start
    axes.set_xlim(*((0.5 * start, 2.0 * end) if single else (start, end)))
    narrow = end < 5.0 * start
    axes.xaxis.set_major_locator(MaxNLocator(5) if narrow else LogLocator(10.0, subs=(1.0, 2.0, 5.0), numticks=10))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:.4g}"))
    if single:
        axes.set_xticks([start])


def _decibels(one: Response) -> tuple[Array, Array, Array]:
    """Gain, and lower and upper edge of the gain's confidence band, dB."""
    result = one.response
    floor = 1e-6 * max(float(result.gain.max()), 1e-12)
    level, low, high = (20 * np.log10(np.maximum(g, floor)) for g in (result.gain, result.gain_low, result.gain_high))
    return level, low, high


def _colour(one: Response, *, several: bool) -> str:
    mine = style.variant_colour(one.variant) if several else style.colour(OUTPUT)
    if one.experiment:
        return style.darker(mine) if several else style.EXPERIMENT
    return mine
