"""Data of a page's interactive plots. They have the panels, colours and line styles of the pictures, and recorded curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from asrsim.plots import style
from asrsim.plots.curves import RunCurves, joint_info
from asrsim.plots.figures import body_names, describe, joint_names
from asrsim.plots.panels import BODY_PANELS, content, energy_panels, joint_panels
from asrsim.report.charts import DASHES
from asrsim.report.series import pack
from asrsim.samples import Array

RecordedCurves = Mapping[tuple[str, str, int], tuple[Array, Array]]
"""Times and values of the recordings, by (joint, quantity, index of the run)."""


def page_quantities() -> tuple[str, ...]:
    """All quantities that a page may contain for a joint."""
    panels = (*joint_panels(), *energy_panels())
    return tuple(dict.fromkeys(name for panel in panels for several in (False, True) for name in panel.of_any(several=several)))


def joint_sections(runs: Sequence[RunCurves], recorded: RecordedCurves, time: Array) -> list[dict[str, Any]]:
    """Section of each joint and body: its name, its actuator, and its plots with packed series. time: times (count,) at which
    the series have values, s.
    """
    sections = []
    panels = (*joint_panels(), *energy_panels(), *BODY_PANELS)
    for joint in (*joint_names(runs), *body_names(runs)):
        info = joint_info(runs, joint)
        plots = []
        for panel in panels:
            drawn = content(panel, runs, joint)
            if not drawn:
                continue
            units = dict.fromkeys(style.unit(name, info) for name, _, _ in drawn)
            series = []
            styles = style.styles_of_equal_colours(panel.of_any(several=len(runs) > 1))
            plain = [name for name in dict.fromkeys(name for name, _, _ in drawn) if not name.startswith("reference")]
            for name, number, curve in drawn:
                # Draw a reference that is equal in all runs only once, and without the colour of a run.
                shared = name.startswith("reference") and sum(q == name for q, _, _ in drawn) == 1
                dash = (
                    DASHES[plain.index(name) % len(DASHES)]
                    if len(runs) > 1 and name in plain
                    else DASHES[style.LINE_STYLES.index(styles[name])]
                )
                owner = None if shared or len(runs) == 1 else number
                unit, words = style.unit(name, info), style.name(name)
                series.append(_series(words, name, unit, owner, curve.values, dash))
                if (joint, name, number) in recorded:
                    when, values = recorded[joint, name, number]
                    on_grid = np.interp(time, when, values, left=np.nan, right=np.nan)
                    series.append(_series(f"{words}, recorded", "experiment", unit, owner, on_grid, dash))
            plots.append({"title": panel.words, "unit": " or ".join(filter(None, units)), "series": series})
        sections.append({"name": joint, "words": describe(info), "plots": plots})
    return sections


def _series(label: str, quantity: str, unit: str, run: int | None, values: Array, dash: list[float]) -> dict[str, Any]:
    """Series of a plot for the page. run: index of the run, which gives the colour; None: the quantity gives the colour."""
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
