"""Pictures of a study: results plotted over the varied keys, and influences of the keys."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.plots.output import save_figure, styled
from asrsim.sweeps.sensitivity import influences, numeric_keys
from asrsim.sweeps.show import chosen_results, varying
from asrsim.sweeps.table import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 6
"""Largest number of results in a picture."""
CELL = 4.4, 3.1
"""Width and height of a panel, inch."""
LINES = 8
"""Largest number of lines in a panel."""
POINTS = 5000
"""Largest number of runs drawn as points."""


def draw_sweep(table: Table, *, results: Sequence[str] = ()) -> list[Path]:
    """Write pictures of the named results (default: the first that vary) into the study's folder, and return the files.
    Raises OutputError, InputError.
    """
    chosen = chosen_results(table, results, MOST)
    with styled(mathematics=False):
        return [
            path for name, figure in figures(table, chosen).items() for path in save_figure(figure, table.folder, name, ["png"])
        ]


def figures(table: Table, results: Sequence[str]) -> dict[str, Figure]:
    """Figures by name; call this function inside `asrsim.plots.output.styled`."""
    keys = numeric_keys(table)
    panels: dict[str, tuple[Sequence[str], Callable[[Table, str, Axes], None]]] = {
        "results": (results if keys else (), _over_key),
        "sensitivity": ([name for name in results if influences(table, name)] if len(keys) > 1 else (), _tornado),
    }
    return {name: _panels(table, names, draw) for name, (names, draw) in panels.items() if names}


def _panels(table: Table, names: Sequence[str], draw: Callable[[Table, str, Axes], None]) -> Figure:
    from matplotlib.figure import Figure
    from matplotlib.ticker import ScalarFormatter

    from asrsim.plots.ticks import TICKS

    columns = min(len(names), 2)
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(CELL[0] * columns + 1.0, CELL[1] * rows), layout="constrained")
    every = len(varying(table))
    left = f" · {len(names)} of {every} results (others: --result)" if len(names) == MOST < every else ""
    figure.suptitle(f"{table.study.name}{left}", x=0.01, ha="left")
    for place, name in enumerate(names, start=1):
        axes = figure.add_subplot(rows, columns, place)
        axes.margins(0.03, 0.06)
        draw(table, name, axes)
        # Limit the number of tick labels, so that long labels do not overlap.
        axes.locator_params(axis="x", nbins=5)
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(axis.get_major_formatter(), ScalarFormatter):
                axis.set_major_formatter(TICKS)
    # All panels share one legend.
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4), fontsize="x-small")
    return figure


def _label(table: Table, name: str) -> str:
    """Name and unit of a key or result."""
    unit = table.unit(name).replace("N m", "N·m").removeprefix("1")
    return f"{name} ({unit})" if unit else name


def _over_key(table: Table, result: str, axes: Axes) -> None:
    """Plot a result over a key: lines over the grid axis with most values, or points over the most influential drawn key."""
    from matplotlib import colormaps

    numeric, variants = numeric_keys(table), table["variant"].astype(str)
    grid = [axis.keys[0] for axis, _ in table.study.listed if axis.keys[0] in numeric]
    style: dict[str, Any]
    if table.study.groups or not grid:
        moved = influences(table, result)
        key = moved[0].key if moved else numeric[0]
        labels, style = variants, {"linestyle": "none", "markersize": 3, "alpha": 0.5}
    else:
        key, *others = sorted(grid, key=lambda name: -len(np.unique(table[name])))
        parts = [[f"{'.'.join(name.split('.')[-2:])} = {number:.4g}" for number in table[name]] for name in others]
        several = [variants] if len(table.study.variants) > 1 or not parts else []
        labels = np.array([", ".join(words) for words in zip(*several, *parts, strict=True)])
        style = {"linestyle": "-"}
    names = list(dict.fromkeys(labels.tolist()))
    shades = colormaps["viridis"](np.linspace(0.0, 0.85, min(len(names), LINES)))
    for name, shade in zip(names[:LINES], shades, strict=True):
        mine = np.flatnonzero(labels == name)
        mine = mine[:: 1 + len(mine) // POINTS]
        mine = mine[np.argsort(table[key][mine], kind="stable")]
        axes.plot(table[key][mine], table[result][mine], marker=".", color=shade, label=name, **style)
    if len(names) > LINES:
        axes.plot([], [], " ", label=f"{LINES} of {len(names)} lines")
    # Show all values of the key, including those where the result is undefined.
    low, high = float(table[key].min()), float(table[key].max())
    axes.set_xlim(low - 0.03 * (high - low), high + 0.03 * (high - low))
    axes.set(xlabel=_label(table, key), ylabel=_label(table, result))


def _tornado(table: Table, result: str, axes: Axes) -> None:
    """Draw the mean of the result over the runs in the lowest and in the highest fifth of each key."""
    found = influences(table, result)[:10][::-1]
    middle = float(np.nanmean(table[result]))
    places = np.arange(len(found))
    for up, end, label in ((0.15, "low", "key in its lowest fifth"), (-0.15, "high", "in its highest")):
        moved = [getattr(one, end) - middle for one in found]
        axes.barh(places + up, moved, left=middle, height=0.3, color=f"C{int(up > 0.0)}", label=label)
    axes.set_yticks(places, [f"{one.key}\n{one.sobol}" if one.sobol else one.key for one in found], fontsize="x-small")
    axes.axvline(middle, color="black", linewidth=0.8)
    axes.set(xlabel=f"mean of {_label(table, result)}")
