"""Files of a design: the motion as CSV, a scenario that plays it, and a picture. Also makes the table of the predicted
intervals.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from asrsim.designs.run import WANTED, Design
from asrsim.designs.search import DESIGN
from asrsim.outfile import csv_text, write_text
from asrsim.plots import style
from asrsim.plots.chart import Chart, Line
from asrsim.plots.charts import save_charts
from asrsim.samples import Array
from asrsim.scenario.relocate import relocated
from asrsim.tables import TableColumn

MARK = "# asrsim design: references of an experiment"
LIMITS = "range of the reference"


def write_design(found: Design, path: Path, *, plot: bool = True) -> list[Path]:
    """Write the CSV file, the scenario and the picture to one folder, and return their paths. path: path of the CSV file.
    Raises OutputError.
    """
    import yaml

    time = found.step * np.arange(found.found.motion.shape[1])
    headings = ["time [s]", *(one.heading for one in found.references)]
    text = f"{MARK}\n{csv_text(headings, np.column_stack([time, found.found.motion.T]))}"
    write_text(path, text, "designed motion")
    scenario = path.with_suffix(".yaml")
    text = yaml.safe_dump(_scenario(found, path, scenario), sort_keys=False, allow_unicode=True)
    write_text(scenario, f"# Plays the experiment that `asrsim design` found.\n{text}", "designed scenario")
    title = f"{found.scenario.name} · designed experiment of {found.seconds:g} s"
    pictures = save_charts(path.with_suffix(".png"), charts(found), title=title, width=6.0) if plot else []
    return [path, scenario, *pictures]


def _scenario(found: Design, motion: Path, path: Path) -> dict[str, Any]:
    data = relocated(found.scenario, path.parent.absolute())
    references, parameters = data.get("references") or {}, data.get("parameters") or {}
    for one in found.references:
        references.setdefault(one.joint, {})[one.name] = {"playback": {"file": motion.name, "column": one.heading}}
    for key, value in found.gains.items():
        joint, _, name = key.rpartition(".")
        parameters.setdefault(joint, {})[name] = value
    return {**data, "duration": found.seconds, "references": references, **({"parameters": parameters} if parameters else {})}


def interval_columns(found: Design) -> list[TableColumn]:
    """Table of the predicted intervals, with a row for each parameter."""
    cells = [TableColumn("parameter", list(found.keys))]
    for name, halves in found.intervals.items():
        cells.append(
            TableColumn("predicted" if name == DESIGN else name, [f"± {100.0 * half:.2g} %" for half in halves], right=True)
        )
    return [*cells, TableColumn(f"time for {100.0 * WANTED:g} %", [f"{seconds:.3g} s" for seconds in found.needed], right=True)]


def charts(found: Design) -> list[list[Chart]]:
    """Rows of charts. A chart for each reference shows its motion and its range. The last chart shows the predicted interval of
    each parameter for each motion.
    """
    time: Array = found.step * np.arange(float(found.found.motion.shape[1]))
    ends = time[[0, -1]]
    rows = []
    for one, values in zip(found.references, found.found.motion, strict=True):
        limits = [
            Line(label=LIMITS, x=ends, y=np.full(2, edge), colour=style.colour("limit"), width=0.9, dash=1)
            for edge in (one.low, one.high)
        ]
        motion = Line(label="designed motion", x=time, y=values, colour=style.BLUE)
        words = one.name.replace("_", " ")
        rows.append([Chart(head=one.joint, words=words, unit=one.unit, lines=[*limits, motion])])
    intervals = [
        Line(label=name, x=100.0 * halves, y=np.arange(float(len(halves))), colour=style.variant_colour(n), kind="points")
        for n, (name, halves) in enumerate(found.intervals.items())
    ]
    names = [style.in_words(key) for key in found.keys]
    across = "half width of the 95 % interval"
    chart = Chart(words="", across=across, across_unit="%", lines=intervals, places=names, logarithmic="x")
    rows.append([chart])
    return rows
