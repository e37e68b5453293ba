"""Simulation and experiment in one picture: on top of each other with the difference below, or side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from asrsim.plots import style
from asrsim.plots.curves import REFERENCE, RunCurves
from asrsim.plots.figures import PER_PAGE, Page, describe, figure_title, new_figure, shorten
from asrsim.plots.legends import legend, variants
from asrsim.plots.pairing import Pair, RunComparison
from asrsim.plots.panels import frame
from asrsim.plots.world import Curve
from asrsim.samples import JointInfo

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LAYOUTS = ("overlay", "side", "both")
QUANTITIES_PER_PAGE = 3
_BESIDE_REFERENCE = ("link_position", "equilibrium_position")
_FIRST = ("link_position", "equilibrium_position", "deflection", "stiffness", "motor_1_position", "motor_2_position")


def comparison_pages(
    runs: Sequence[RunCurves], compared: Sequence[RunComparison], *, layout: str = "overlay", references: bool = False
) -> Iterator[Page]:
    """All pages. runs: the curves of the runs, in the order of `compared`; references: recorded references get rows too."""
    if layout in ("overlay", "both"):
        yield from _overlay_pages(runs, compared, references)
    if layout in ("side", "both"):
        yield from _side_pages(runs, compared)


def _overlay_pages(runs: Sequence[RunCurves], compared: Sequence[RunComparison], references: bool) -> Iterator[Page]:
    keys = dict.fromkeys(key for one in compared for key in one.pairs)
    quantities = sorted(dict.fromkeys(q for _, q in keys), key=lambda q: _FIRST.index(q) if q in _FIRST else len(_FIRST))
    if not references:
        quantities = [q for q in quantities if not q.startswith("reference")] or quantities
    joints = [j for j in dict.fromkeys(j for j, _ in keys) if any((j, q) in keys for q in quantities)]
    pages = [
        (joints[a : a + PER_PAGE], quantities[b : b + QUANTITIES_PER_PAGE])
        for a in range(0, len(joints), PER_PAGE)
        for b in range(0, len(quantities), QUANTITIES_PER_PAGE)
    ]
    pages = [(js, [q for q in qs if any((j, q) in keys for j in js)]) for js, qs in pages]
    pages = [(js, qs) for js, qs in pages if qs]
    for number, (members, names) in enumerate(pages, 1):
        figure = overlay_figure(runs, compared, members, names, part=(number, len(pages)))
        yield Page(name="comparison" if len(pages) == 1 else f"comparison_{number}", figure=figure)


def overlay_figure(
    runs: Sequence[RunCurves],
    compared: Sequence[RunComparison],
    joints: Sequence[str],
    quantities: Sequence[str],
    *,
    part: tuple[int, int] = (1, 1),
) -> Figure:
    """For every joint (column) and quantity: simulation over experiment, and their difference below."""
    wide = style.COLUMN_WIDTH * (1.6 if len(joints) == 1 else 1.0)
    figure = new_figure(wide * len(joints) + style.LEGEND_WIDTH + 0.3, 2.9 * len(quantities) + 0.9)
    ratios = [ratio for _ in quantities for ratio in (2.1, 1.0)]
    axes = figure.subplots(2 * len(quantities), len(joints), squeeze=False, sharex="col", gridspec_kw={"height_ratios": ratios})
    for c, joint in enumerate(joints):
        info = _info(runs, joint)
        for r, quantity in enumerate(quantities):
            draw_overlay(axes[2 * r, c], runs, compared, joint, quantity)
            draw_difference(axes[2 * r + 1, c], runs, compared, joint, quantity)
        axes[0, c].set_title(f"{shorten(joint, 40)}\n{describe(info) if info else ''}", loc="left")
        axes[-1, c].set_xlabel("time (s)")
    banded = max((pair.count for one in compared for pair in one.pairs.values()), default=1)
    for r, quantity in enumerate(quantities):
        reference = [REFERENCE] if quantity in _BESIDE_REFERENCE and _has_reference(runs, joints) else []
        words = {quantity: f"simulation {style.symbol(quantity)}"}
        legend(axes[2 * r, -1], [quantity, *reference], words=words, extra=_experiment_handles(banded))
    figure.align_ylabels()
    figure_title(figure, runs, "simulation and experiment", part)
    variants(figure, [one.label for one in compared])
    return figure


def draw_overlay(axes: Axes, runs: Sequence[RunCurves], compared: Sequence[RunComparison], joint: str, quantity: str) -> None:
    """Simulations (colour, variants by line style) under experiments (thin, black; several as a band) on the given axes."""
    drawn: list[Curve] = []
    shared = len({one.recordings for one in compared}) == 1
    for number, (run, one) in enumerate(zip(runs, compared, strict=True)):
        pair = one.pairs.get((joint, quantity))
        if pair is None:
            continue
        line = style.line_style(number)
        if not (shared and number):
            drawn += _experiment(axes, pair, "-" if shared else line, f"{joint}.{quantity}.experiment.{number}")
        reference = run.get(joint, REFERENCE)
        if number == 0 and reference is not None and quantity in _BESIDE_REFERENCE:
            axes.plot(reference.time, reference.values, color=style.colour(REFERENCE), linewidth=2.6, zorder=1.4)
            drawn.append(_within(reference, pair.simulation))
        axes.plot(
            pair.simulation.time, pair.simulation.values, color=style.colour(quantity), linestyle=line, zorder=2.3,
            linewidth=1.9,
            gid=f"{joint}.{quantity}.simulation.{number}",
        )  # fmt: skip
        drawn.append(pair.simulation)
    frame(axes, drawn)
    axes.set_ylabel(style.axis_label(style.name(quantity), style.unit(quantity, _info(runs, joint))))


def draw_difference(
    axes: Axes, runs: Sequence[RunCurves], compared: Sequence[RunComparison], joint: str, quantity: str
) -> None:
    """Simulation minus experiment on the given axes."""
    drawn = []
    for number, one in enumerate(compared):
        pair = one.pairs.get((joint, quantity))
        if pair is None:
            continue
        axes.plot(
            pair.difference.time, pair.difference.values, color=style.tint(style.colour(quantity), number),
            linestyle=style.line_style(number), linewidth=0.9, gid=f"{joint}.{quantity}.difference.{number}",
        )  # fmt: skip
        drawn.append(pair.difference)
    axes.axhline(0.0, color=style.GREY, linewidth=0.6, zorder=1.0)
    limits = axes.get_xlim()
    frame(axes, drawn)
    axes.set_xlim(limits)
    axes.set_ylabel(f"difference\n({style.unit(quantity, _info(runs, joint)) or '-'})")


def _within(curve: Curve, other: Curve) -> Curve:
    """The part of a curve in the other's time."""
    inside = (curve.time >= other.time[0]) & (curve.time <= other.time[-1])
    return Curve(time=curve.time[inside], values=curve.values[inside])


def _experiment(axes: Axes, pair: Pair, line: Any, gid: str) -> list[Curve]:
    curves = [pair.recording]
    if pair.low is not None and pair.high is not None:
        axes.fill_between(pair.low.time, pair.low.values, pair.high.values, color=style.EXPERIMENT, alpha=0.18, linewidth=0)
        curves += [pair.low, pair.high]
    axes.plot(
        pair.recording.time, pair.recording.values, color=style.EXPERIMENT, linestyle=line, linewidth=0.8, zorder=2.5, gid=gid
    )
    return curves


def _experiment_handles(count: int) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if count < 2:
        return [Line2D([], [], color=style.EXPERIMENT, linewidth=1.2, label="experiment")]
    return [
        Line2D([], [], color=style.EXPERIMENT, linewidth=1.2, label=f"experiment,\nmean of {count} runs"),
        Patch(color=style.EXPERIMENT, alpha=0.18, linewidth=0, label="their range"),
    ]


_SIDE_GROUPS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("position", ("motor_1_position", "motor_2_position", "equilibrium_position", "link_position")),
    ("torque", ("external_torque", "link_torque")),
    ("motor torque", ("elastic_torque_1", "elastic_torque_2", "motor_1_torque", "motor_2_torque")),
    ("velocity", ("motor_1_velocity", "motor_2_velocity", "link_velocity")),
    ("deflection", ("deflection",)),
    ("stiffness", ("stiffness",)),
)


def _side_pages(runs: Sequence[RunCurves], compared: Sequence[RunComparison]) -> Iterator[Page]:
    keys = dict.fromkeys(key for one in compared for key in one.pairs)
    for words, group in _SIDE_GROUPS:
        joints = [j for j in dict.fromkeys(j for j, _ in keys) if any((j, q) in keys for q in group)]
        pages = [joints[a : a + 4] for a in range(0, len(joints), 4)]
        for number, members in enumerate(pages, 1):
            figure = side_figure(runs, compared, members, group, words=words, part=(number, len(pages)))
            name = f"side_by_side_{words.replace(' ', '_')}"
            yield Page(name=name if len(pages) == 1 else f"{name}_{number}", figure=figure)


def side_figure(
    runs: Sequence[RunCurves],
    compared: Sequence[RunComparison],
    joints: Sequence[str],
    quantities: Sequence[str],
    *,
    words: str,
    part: tuple[int, int] = (1, 1),
) -> Figure:
    """Experiment at the left, simulation at the right with the same axes, one row a joint; as the paper's figures."""
    figure = new_figure(2 * style.COLUMN_WIDTH + style.LEGEND_WIDTH, 1.9 * len(joints) + 1.0)
    axes = figure.subplots(len(joints), 2, squeeze=False, sharex=True, sharey="row")
    shown: dict[str, None] = {}
    for r, joint in enumerate(joints):
        drawn: list[Curve] = []
        info = _info(runs, joint)
        for number, (run, one) in enumerate(zip(runs, compared, strict=True)):
            reference = run.get(joint, REFERENCE)
            if words == "position" and reference is not None and number == 0:
                for ax in axes[r]:
                    ax.plot(reference.time, reference.values, color=style.colour(REFERENCE), linewidth=2.6, zorder=1.4)
                shown[REFERENCE] = None
            for quantity in quantities:
                pair = one.pairs.get((joint, quantity))
                if pair is None:
                    continue
                for ax, curve in ((axes[r, 0], pair.recording), (axes[r, 1], pair.simulation)):
                    line = style.line_style(number)
                    ax.plot(curve.time, curve.values, color=style.colour(quantity), linestyle=line)
                    drawn.append(curve)
                if pair.low is not None and pair.high is not None:
                    axes[r, 0].fill_between(
                        pair.low.time, pair.low.values, pair.high.values, color=style.colour(quantity), alpha=0.2, linewidth=0
                    )
                    drawn += [pair.low, pair.high]
                shown[quantity] = None
        frame(axes[r, 0], drawn)
        unit = style.unit(quantities[-1], info)
        axes[r, 0].set_ylabel(f"{shorten(joint, 22)}\n{style.axis_label(words, unit)}")
    axes[0, 0].set_title("A  experiment", loc="left")
    axes[0, 1].set_title("B  simulation", loc="left")
    for ax in axes[-1]:
        ax.set_xlabel("time (s)")
    legend(axes[0, -1], [name for name in (REFERENCE, *quantities) if name in shown])
    figure_title(figure, runs, words, part)
    variants(figure, [one.label for one in compared])
    return figure


def _has_reference(runs: Sequence[RunCurves], joints: Sequence[str]) -> bool:
    return any(run.get(joint, REFERENCE) is not None for run in runs for joint in joints)


def _info(runs: Sequence[RunCurves], joint: str) -> JointInfo | None:
    return next((info for run in runs for info in run.joints if info.name == joint), None)
