"""Interactive plots of a page: panels, colours and line styles of the pictures, with recorded curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from asrsim.plots import style
from asrsim.plots.curves import REFERENCE, RunCurves, joint_info
from asrsim.plots.decimate import Envelope
from asrsim.plots.figures import describe, joint_names
from asrsim.plots.panels import ENERGY_PANELS, JOINT_PANELS, PANELS, content
from asrsim.plots.world import body_panels
from asrsim.report.series import pack
from asrsim.samples import Array

DASHES: tuple[list[float], ...] = ([], [7, 3], [9, 3, 2, 3], [2, 3], [12, 3, 2, 3, 2, 3], [4, 2])
"""Dash patterns in pixels, one per quantity, for pages with several runs."""

QUANTITIES: tuple[str, ...] = tuple(
    dict.fromkeys(
        name
        for key in (*JOINT_PANELS, *ENERGY_PANELS)
        for several in (False, True)
        for name in PANELS[key].of_any(several=several)
    )
)
"""All panels that a page may contain for a joint."""


Recorded = Mapping[tuple[str, str, int], tuple[Array, Array]]
"""Times and values of the recordings, by (joint, quantity, index of the run)."""


def joint_sections(runs: Sequence[RunCurves], recorded: Recorded, time: Array) -> list[dict[str, Any]]:
    """Section of each joint: name, actuator, and plots with packed series. time: times (count,) of the page, s."""
    sections = []
    for joint in joint_names(runs):
        info = joint_info(runs, joint)
        plots = []
        for key in (*JOINT_PANELS, *ENERGY_PANELS):
            panel = PANELS[key]
            drawn = content(panel, runs, joint)
            if not drawn:
                continue
            units = dict.fromkeys(style.unit(name, info) for name, _, _ in drawn)
            series = []
            plain = [name for name in dict.fromkeys(name for name, _, _ in drawn) if not name.startswith("reference")]
            for name, number, curve in drawn:
                # A reference that is equal in all runs belongs to no single run.
                shared = name.startswith("reference") and sum(q == name for q, _, _ in drawn) == 1
                dash = DASHES[plain.index(name) % len(DASHES)] if len(runs) > 1 and name in plain else []
                owner = None if shared or len(runs) == 1 else number
                unit, words = style.unit(name, info), style.name(name)
                series.append(_series(words, name, unit, owner, curve.values, dash))
                if (joint, name, number) in recorded:
                    when, values = recorded[joint, name, number]
                    on_grid = np.interp(time, when, values, left=np.nan, right=np.nan)
                    series.append(_series(f"{words}, recorded", "experiment", unit, owner, on_grid, dash))
            plots.append({"title": panel.words, "unit": " or ".join(filter(None, units)), "series": series})
        sections.append({"joint": joint, "actuator": describe(info), "plots": plots})
    return sections


def object_plots(runs: Sequence[RunCurves], time: Array) -> list[dict[str, Any]]:
    """Plots of displacement and contact force of the world's objects. time: times (count,) of the page, s."""
    plots = []
    for body in dict.fromkeys(name for run in runs for name in run.bodies):
        for panel in body_panels(body):
            plain = [key for key in panel.entries if not key.startswith("goal")]
            series = []
            for number, run in enumerate(runs):
                for key, name in panel.entries.items():
                    curve = run.bodies.get(body, {}).get(key)
                    if curve is None or (key not in plain and number):  # all variants have the same goal
                        continue
                    values = np.interp(time, curve.time, curve.values, right=np.nan)
                    if len(curve.time) > len(time):
                        values = _envelope(time, curve.time, curve.values)
                    dash = DASHES[plain.index(key)] if len(runs) > 1 and key in plain else []
                    owner, colour = (number if len(runs) > 1 else None, key) if key in plain else (None, REFERENCE)
                    series.append(_series(name, colour, panel.unit, owner, values, dash))
            plots.append({"title": f"{body}: {panel.words}", "unit": panel.unit, "series": series})
    return plots


def _series(label: str, quantity: str, unit: str, run: int | None, values: Array, dash: list[float]) -> dict[str, Any]:
    """Series of a plot for the page. run: number of the run that the colour marks; None: the colour marks the quantity."""
    recorded = quantity == "experiment"
    colour = style.EXPERIMENT if recorded else style.colour(quantity)
    if run is not None:
        colour = style.variant_colour(run)
        colour = style.darker(colour) if recorded else colour
    return {
        "label": label,
        "colour": colour,
        "dash": dash,
        "width": 3 if quantity.startswith("reference") else 1 if recorded else 1.5,
        "unit": unit,
        "run": run,
        **pack(values),
    }


def _envelope(grid: Array, time: Array, values: Array) -> Array:
    """Smallest and largest value of a curve in every interval of the grid."""
    step = grid[1] - grid[0]
    start = float(grid[0] - 0.5 * step)
    envelope = Envelope(start=start, end=start + step * len(grid), bins=len(grid) // 2)
    envelope.add(time, values[:, None])
    return envelope.pairs(0)
