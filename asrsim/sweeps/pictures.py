"""Pictures of a study: results plotted over the varied keys, and influences of the keys."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from asrsim.plots import style
from asrsim.plots.chart import Chart, Line
from asrsim.plots.charts import save_charts
from asrsim.sweeps.sensitivity import influences, numeric_keys
from asrsim.sweeps.show import chosen_results, varying
from asrsim.sweeps.table import Table

MOST = 6
"""Largest number of results in a picture. Each result has one chart."""
LINES = 8
"""Largest number of lines in a chart."""
POINTS = 5000
"""Largest number of runs that a chart shows as points."""
KEYS = 10
"""Largest number of keys in a chart of influences."""


def draw_sweep(table: Table, *, results: Sequence[str] = ()) -> list[Path]:
    """Write pictures of the named results (default: the first results that vary) into the study's folder, and return the files.
    Raises OutputError, InputError.
    """
    chosen = chosen_results(table, results, MOST)
    title = study_title(table, chosen)
    return [
        path
        for name, charts in study_charts(table, chosen).items()
        for path in save_charts(table.folder / f"{name}.png", in_rows(charts), title=title, width=3.9, height=2.1)
    ]


def in_rows(charts: Sequence[Chart]) -> list[Sequence[Chart]]:
    """Rows of two charts each."""
    return [charts[first : first + 2] for first in range(0, len(charts), 2)]


def study_title(table: Table, results: Sequence[str]) -> str:
    """Title of the pictures: name of the study, and number of its results that the pictures show."""
    every = len(varying(table))
    left = f" · {len(results)} of {every} results (others: --result)" if len(results) == MOST < every else ""
    return f"{table.study.name}{left}"


def study_charts(table: Table, results: Sequence[str]) -> dict[str, list[Chart]]:
    """Charts by picture: results over the keys, and influences of the keys if the study has them."""
    keys = numeric_keys(table)
    kinds: dict[str, tuple[Sequence[str], Callable[[Table, str], Chart]]] = {
        "results": (results if keys else (), over_key),
        "sensitivity": ([name for name in results if influences(table, name)] if len(keys) > 1 else (), influence_chart),
    }
    return {name: [draw(table, one) for one in names] for name, (names, draw) in kinds.items() if names}


def unit_of(table: Table, name: str) -> str:
    """Unit of a key or result, as the pictures show it."""
    return table.unit(name).removeprefix("1")


def in_words(table: Table, result: str) -> str:
    """Result in words; the measured value of a claim as the joint, quantity and measure of the claim."""
    return table.claim(result) or style.in_words(result)


def over_key(table: Table, result: str) -> Chart:
    """Chart of a result over a key: lines over the grid axis with the most values, or points over the most influential drawn
    key.
    """
    numeric, variants = numeric_keys(table), table["variant"].astype(str)
    grid = [axis.keys[0] for axis, _ in table.study.listed if axis.keys[0] in numeric]
    drawn = bool(table.study.groups) or not grid
    if drawn:
        moved = influences(table, result)
        key = moved[0].key if moved else numeric[0]
        labels = variants
    else:
        key, *others = sorted(grid, key=lambda name: -len(np.unique(table[name])))
        parts = [[_fixed(table, name, number) for number in table[name]] for name in others]
        several = [variants] if len(table.study.variants) > 1 or not parts else []
        labels = np.array(["\n".join(words) for words in zip(*several, *parts, strict=True)])
    names = list(dict.fromkeys(labels.tolist()))
    lines = []
    for number, name in enumerate(names[:LINES]):
        mine = np.flatnonzero(labels == name)
        mine = mine[:: 1 + len(mine) // POINTS]
        mine = mine[np.argsort(table[key][mine], kind="stable")]
        lines.append(
            Line(
                label=name,
                x=table[key][mine],
                y=table[result][mine],
                colour=style.variant_colour(number),
                kind="points" if drawn else "both",
                opacity=0.5 if drawn else 1.0,
            )
        )
    if len(names) > LINES:
        lines.append(Line(label=f"({LINES} of {len(names)} lines)", x=np.empty(0), y=np.empty(0), colour="none"))
    # Give all charts over this key the same axis. It also covers values of the key for which no run has the result.
    low, high = float(table[key].min()), float(table[key].max())
    room = 0.03 * (high - low)
    return Chart(
        words=in_words(table, result),
        unit=unit_of(table, result),
        across=style.in_words(key),
        across_unit=unit_of(table, key),
        lines=lines,
        reach=(low - room, high + room),
    )


def _fixed(table: Table, key: str, number: float) -> str:
    return f"{style.in_words(key)}\n= {number:.4g} {unit_of(table, key)}".rstrip()


def influence_chart(table: Table, result: str) -> Chart:
    """Chart of the mean of a result over the runs in the lowest and in the highest fifth of each key."""
    found = influences(table, result)[:KEYS]
    places = np.arange(float(len(found)))
    ends = {"key in its\nlowest fifth": ("low", style.BLUE), "key in its\nhighest fifth": ("high", style.VERMILION)}
    lines = [
        Line(label=label, x=np.array([getattr(one, end) for one in found]), y=places, colour=colour, kind="points")
        for label, (end, colour) in ends.items()
    ]
    joined = [
        Line(label="", x=np.array([one.low, one.high]), y=np.full(2, place), colour=style.LIGHT, width=1.6)
        for one, place in zip(found, places, strict=True)
    ]
    names = [f"{style.in_words(one.key)}\n{one.sobol}" if one.sobol else style.in_words(one.key) for one in found]
    return Chart(
        words="",
        across=f"mean {in_words(table, result)}",
        across_unit=unit_of(table, result),
        lines=[*joined, *lines],
        places=names,
        mark=float(np.nanmean(table[result])),
    )
