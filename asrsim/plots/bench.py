"""Picture of a test bench: torques and positions of springs and motors under the prescribed motion."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from asrsim.plots import style
from asrsim.plots.decimate import decimate
from asrsim.plots.figures import PER_PAGE, shorten
from asrsim.plots.layout import Grid, set_title
from asrsim.plots.legends import legend
from asrsim.plots.output import save_figure, styled
from asrsim.plots.view import draw_curve, show_time, show_values
from asrsim.plots.world import Curve
from asrsim.samples import Array

ROWS = (
    ("position", "rad", ("position", "motor_1_position", "motor_2_position")),
    ("link torque", "N·m", ("link_torque",)),
    ("stiffness", "N·m/rad", ("stiffness",)),
)
"""Rows of the picture: label and unit of the vertical axis, and the columns of `asrsim.simulation.bench.OUTPUTS` drawn there.
"""
NAMES = {"position": "link_position"}
"""Column names of the bench that differ from the quantity names of the other pictures."""


def draw_bench(path: Path, time: Array, results: Mapping[str, Mapping[str, Array]]) -> list[Path]:
    """Draw the bench's outputs as PNG files beside the table at `path`, three joints per picture, and return the files.

    time: (n,) s; results: joint -> column -> values (n,). Raises OutputError.
    """
    joints, files = list(results), []
    with styled():
        for first in range(0, len(joints), PER_PAGE):
            members = joints[first : first + PER_PAGE]
            figure, axes = Grid(columns=len(members), heights=[style.ROW_HEIGHT] * len(ROWS), title=0.3).figure([], sharex=True)
            for c, joint in enumerate(members):
                axes[0, c].set_title(shorten(joint, 40), loc="left")
                axes[-1, c].set_xlabel("time (s)")
                for r, (words, unit, columns) in enumerate(ROWS):
                    curves = {NAMES.get(name, name): _curve(time, results[joint][name]) for name in columns}
                    curves = {name: curve for name, curve in curves.items() if np.isfinite(curve.values).any()}
                    show_time(axes[r, c], list(curves.values()))
                    for name, curve in curves.items():
                        draw_curve(axes[r, c], curve, colour=style.colour(name), gid=f"{joint}.{name}")
                    show_values(axes[r, c], list(curves.values()), brief=False)
                    axes[r, c].set_ylabel(style.axis_label(words, unit))
                    legend(axes[r, -1], list(curves))
            set_title(figure, f"test bench · {path.stem}")
            number = f"_{first // PER_PAGE + 1}" if len(joints) > PER_PAGE else ""
            files += save_figure(figure, path.parent, f"{path.stem}{number}", ("png",))
    return files


def _curve(time: Array, values: Array) -> Curve:
    time, values = decimate(time, values)
    return Curve(time=time, values=values)
