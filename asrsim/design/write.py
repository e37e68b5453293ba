"""Files of a design: the motion as CSV, a scenario that plays it, a picture; and the table of the predicted intervals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from asrsim.design.run import WANTED, Design
from asrsim.design.search import DESIGN
from asrsim.outfile import csv_text, write_text
from asrsim.plots.output import save_figure, styled
from asrsim.scenario.starter import relocated

MARK = "# asrsim design: references of an experiment"


def write_design(found: Design, path: Path, *, plot: bool = True) -> list[Path]:
    """Write CSV, scenario and picture into one folder, and return their paths. Raises OutputError."""
    import yaml

    time = found.step * np.arange(found.found.motion.shape[1])
    headings = ["time [s]", *(one.heading for one in found.references)]
    text = f"{MARK}\n{csv_text(headings, np.column_stack([time, found.found.motion.T]))}"
    write_text(path, text, "designed motion")
    scenario = path.with_suffix(".yaml")
    text = yaml.safe_dump(_scenario(found, path, scenario), sort_keys=False, allow_unicode=True)
    write_text(scenario, f"# Plays the experiment that `asrsim design` found.\n{text}", "designed scenario")
    return [path, scenario, *(_draw(found, time, path) if plot else [])]


def _scenario(found: Design, motion: Path, path: Path) -> dict[str, Any]:
    data = relocated(found.scenario, path.parent.absolute())
    references, parameters = data.get("references") or {}, data.get("parameters") or {}
    for one in found.references:
        references.setdefault(one.joint, {})[one.name] = {"playback": {"file": motion.name, "column": one.heading}}
    for key, value in found.gains.items():
        joint, _, name = key.rpartition(".")
        parameters.setdefault(joint, {})[name] = value
    return {**data, "duration": found.seconds, "references": references, **({"parameters": parameters} if parameters else {})}


def columns(found: Design) -> list[tuple[str, list[str], bool]]:
    """Columns of the table of intervals: heading, a cell for each parameter, and whether the cells are right-aligned."""
    cells = [("parameter", list(found.keys), False)]
    for name, halves in found.intervals.items():
        cells.append(("promised" if name == DESIGN else name, [f"± {100.0 * half:.2g} %" for half in halves], True))
    return [*cells, (f"time for {100.0 * WANTED:g} %", [f"{seconds:.3g} s" for seconds in found.needed], True)]


def _draw(found: Design, time: Any, path: Path) -> list[Path]:
    with styled(mathematics=False):
        from matplotlib.figure import Figure

        panels = len(found.references) + 1
        figure = Figure(figsize=(9.0, 1.8 * panels + 1.0), layout="constrained")
        *axes, last = figure.subplots(panels)
        for axis, one, values in zip(axes, found.references, found.found.motion, strict=True):
            axis.plot(time, values, linewidth=1.0)
            axis.hlines((one.low, one.high), 0.0, time[-1], color="0.6", linestyle="--", linewidth=0.8)
            axis.set(xlabel="time [s]", ylabel=f"{one.joint}\n{one.name} [{one.unit}]")
        for name, halves in found.intervals.items():
            last.semilogy(range(len(halves)), 100.0 * halves, "o", label=name, markersize=5)
        last.set_xticks(range(len(found.keys)), found.keys, rotation=20, ha="right", fontsize="x-small")
        last.yaxis.set_major_formatter("{x:g}")
        last.set(ylabel="95 % interval [± %]", xlim=(-0.5, len(found.keys) - 0.5))
        last.legend(fontsize="x-small")
        return save_figure(figure, path.parent, path.stem, ("png",))
