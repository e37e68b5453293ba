"""Pictures of a study: results over one or two keys, distributions, what moves them, and bands of kept signals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.plots.output import save_figure, styled
from asrsim.samples import Array
from asrsim.sweeps.sensitivity import influences, numeric_keys
from asrsim.sweeps.show import varying
from asrsim.sweeps.table import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 6
"""Results in a picture: others by name."""
SHARE = 0.1
"""Of the runs, that have a result which is drawn unasked before others."""
CELL = 4.4, 3.1
"""inches of a panel."""
LINES = 8
"""Lines in a panel, at most."""
POINTS = 40
"""Points of a line that are drawn as such."""


def draw_sweep(table: Table, *, results: Sequence[str] = (), formats: Sequence[str] = ("png",)) -> list[Path]:
    """Write the study's pictures into its folder; results: see :func:`chosen_results`. Raises OutputError, InputError."""
    chosen = chosen_results(table, results)
    paths: list[Path] = []
    with styled(mathematics=False):
        for name, figure in figures(table, chosen).items():
            paths += save_figure(figure, table.folder, name, formats)
    return paths


def chosen_results(table: Table, results: Sequence[str]) -> list[str]:
    """Columns to be drawn: those named, or the first that differ. Raises InputError for unknown ones, and those of no run."""
    for name in results:
        if name not in table.results:
            known = tuple(table.results)
            problem = Problem("is no result of this study", key=name, hint=did_you_mean(name, known), code="result")
            raise InputError(problem)
        if table.quantiles(name) is None:
            raise InputError("no run has a value of it", key=name, code="result")
    # What hardly any run has comes last.
    often = [name for name in varying(table) if np.isfinite(table[name]).mean() >= SHARE]
    return list(results) or [*often, *(name for name in varying(table) if name not in often)][:MOST]


def figures(table: Table, results: Sequence[str]) -> dict[str, Figure]:
    """Name -> figure; call it inside :func:`asrsim.plots.output.styled`."""
    found: dict[str, Any] = {}
    if results and numeric_keys(table):
        found["results"] = _panels(table, results, _over_keys)
        moved = [name for name in results if influences(table, name)]
        if moved and len(numeric_keys(table)) > 1:
            found["sensitivity"] = _panels(table, moved, _tornado)
    if results and table.manifest["drawn"]:
        found["distributions"] = _panels(table, results, _distribution)
    signals = [name for name in table.columns if name.startswith("signal:")]
    if signals:
        found["signals"] = _panels(table, signals, _band)
    return found


def _panels(table: Table, names: Sequence[str], draw: Any) -> Figure:
    from matplotlib.figure import Figure
    from matplotlib.ticker import ScalarFormatter

    from asrsim.plots.ticks import Plain

    columns = min(len(names), 2)
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(CELL[0] * columns + 1.0, CELL[1] * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    every = len(varying(table))
    left = f" · {len(names)} of {every} results (others: --result)" if len(names) == MOST < every else ""
    figure.suptitle(f"{table.manifest['name']}{left}", x=0.01, ha="left")
    for axis, name in zip(axes, names, strict=False):
        # Points and bars are not cut in half by the edge of a panel.
        axis.margins(0.03, 0.06)
        draw(table, name, axis)
        if isinstance(axis.xaxis.get_major_formatter(), ScalarFormatter):
            # Few long numbers side by side.
            axis.locator_params(axis="x", nbins=5)
            axis.xaxis.set_major_formatter(Plain())
        if isinstance(axis.yaxis.get_major_formatter(), ScalarFormatter):
            axis.yaxis.set_major_formatter(Plain())
    for axis in axes[len(names) :]:
        axis.remove()
    # What is the same in all panels is said once, beneath them.
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(
            handles, labels, loc="outside lower center", ncols=min(len(labels), 4), fontsize="x-small", markerscale=1.5
        )
    return figure


def _label(table: Table, name: str) -> str:
    """A key's, result's or signal's name with its unit."""
    unit = table.unit(name).replace("N m", "N·m").removeprefix("1")
    return f"{name.removeprefix('signal:')} ({unit})" if unit else name.removeprefix("signal:")


def _over_keys(table: Table, result: str, axes: Axes) -> None:
    """Lines over the key with most values; points where keys are drawn."""
    listed = [group[0] for group in table.manifest["listed"] if group[0] in numeric_keys(table)]
    moved = influences(table, result)
    if table.manifest["drawn"] or not listed:
        key = moved[0].key if moved else numeric_keys(table)[0]
        shown = np.linspace(0, len(table) - 1, min(len(table), 5000)).astype(int)
        variants = table["variant"].astype(str)[shown]
        for variant in dict.fromkeys(variants.tolist()):
            mine = shown[variants == variant]
            axes.plot(table[key][mine], table[result][mine], ".", markersize=3, alpha=0.5, label=variant)
        _whole_width(table, key, axes)
        axes.set(xlabel=_label(table, key), ylabel=_label(table, result))
        return
    listed.sort(key=lambda key: -len(np.unique(table[key])))
    over, others = listed[0], listed[1:]
    several = len(table.manifest["variants"]) > 1
    labels = [
        ", ".join(
            ([str(variant)] if several else []) + [f"{'.'.join(key.split('.')[-2:])} = {table[key][i]:.4g}" for key in others]
        )
        for i, variant in enumerate(table["variant"])
    ]
    names = list(dict.fromkeys(labels))
    _whole_width(table, over, axes)
    # Values in their order have colours in theirs.
    from matplotlib import colormaps

    shades = colormaps["viridis"](np.linspace(0.0, 0.85, min(len(names), LINES)))
    for name, shade in zip(names[:LINES], shades, strict=True):
        mine = np.array([label == name for label in labels])
        order = np.argsort(table[over][mine], kind="stable")
        # A lonely value between undefined ones is a point; a hundred points are no thick line.
        size = 6.0 if len(order) <= POINTS else 2.5
        axes.plot(table[over][mine][order], table[result][mine][order], ".-", color=shade, label=name, markersize=size)
    if len(names) > LINES:
        axes.plot([], [], " ", label=f"{LINES} of {len(names)} lines")
    axes.set(xlabel=_label(table, over), ylabel=_label(table, result))


def _whole_width(table: Table, key: str, axes: Axes) -> None:
    """All of a key, also where a result is undefined."""
    low, high = float(table[key].min()), float(table[key].max())
    if high > low:
        axes.set_xlim(low - 0.03 * (high - low), high + 0.03 * (high - low))


def _distribution(table: Table, result: str, axes: Axes) -> None:
    from matplotlib.ticker import MaxNLocator

    values = table[result]
    there = values[np.isfinite(values)]
    axes.hist(there, bins=min(60, max(8, round(len(there) ** 0.5))), color="C1", edgecolor="white", linewidth=0.5)
    for share, style, label in ((0.5, "-", "median"), (0.05, ":", "5 and 95 %"), (0.95, ":", None)):
        axes.axvline(float(np.quantile(there, share)), color="black", linewidth=0.8, linestyle=style, label=label)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    lacking = len(values) - len(there)
    axes.set(xlabel=_label(table, result), ylabel="runs" + (f" ({lacking} without)" if lacking else ""))


def _tornado(table: Table, result: str, axes: Axes) -> None:
    found = influences(table, result)[:10][::-1]
    middle = float(np.nanmean(table[result]))
    # One above the other: where both ends of a key move a result the same way, neither hides the other.
    places = np.arange(len(found))
    for up, end, label in ((0.15, "low", "key in its lowest fifth"), (-0.15, "high", "in its highest")):
        moved = [getattr(one, end) - middle for one in found]
        axes.barh(places + up, moved, left=middle, height=0.3, color=f"C{int(up > 0.0)}", label=label)
    labels = [f"{one.key}\n{one.sobol}" if one.sobol else one.key for one in found]
    axes.set_yticks(range(len(found)), labels, fontsize="x-small")
    axes.axvline(middle, color="black", linewidth=0.8)
    axes.set(xlabel=f"mean of {_label(table, result)}")


def _band(table: Table, name: str, axes: Axes) -> None:
    """Median, and bands that hold 50 and 90 % of the runs, of each variant."""
    variants, rate = table.manifest["variants"], float(table.manifest["rate"])
    for number, variant in enumerate(variants):
        mine = table["variant"].astype(str) == variant
        _variant_band(table[name][mine], rate, axes, f"C{number}", variant if len(variants) > 1 else "")
    axes.margins(x=0.0)
    axes.set(xlabel="time (s)", ylabel=_label(table, name))


def _variant_band(signals: Any, rate: float, axes: Axes, colour: str, variant: str) -> None:
    runs = [np.asarray(values) for values in signals if values is not None and len(values)]
    longest = max((len(run) for run in runs), default=0)
    rows: Array = np.full((len(runs), longest), np.nan)
    for row, values in zip(rows, runs, strict=True):
        row[: len(values)] = values
    time = np.arange(longest) / rate
    if longest:
        low, quarter, middle, upper, high = np.nanquantile(rows, (0.05, 0.25, 0.5, 0.75, 0.95), axis=0)
        axes.fill_between(time, low, high, alpha=0.2, color=colour, label=None if variant else "90 %")
        axes.fill_between(time, quarter, upper, alpha=0.35, color=colour, label=None if variant else "50 %")
        axes.plot(time, middle, color=colour, label=f"{variant}: median, 50 and 90 %" if variant else "median")
