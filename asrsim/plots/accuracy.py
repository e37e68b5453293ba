"""Picture of a run's accuracy: estimated numerical error and difference from a second engine, joint by joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from asrsim.outfile import make_folder
from asrsim.plots import style
from asrsim.plots.figures import shorten
from asrsim.plots.layout import PanelGrid, set_title
from asrsim.plots.output import save_figure, styled

SMALLEST = 1e-17
"""Smallest value on the logarithmic axis. Smaller values and 0 are drawn at this value, because the axis has no 0."""


def draw_accuracy(folder: Path, certificate: Mapping[str, Any], cross_check: Mapping[str, Any]) -> list[Path]:
    """Draw `accuracy.png` into `folder` and return its path; return an empty list if both tables are empty.

    certificate, cross_check: tables of `summary.json`, empty if the run did not compute the table. A dot marks the largest
    value over the run; a bar reaches from the dot to the root mean square. Raises OutputError.
    """
    engines = f"difference\n{cross_check.get('engine')} - {cross_check.get('other')}"
    named = (("numerical error\n(estimated)", certificate), (engines, cross_check))
    found = [(name, data["joints"]) for name, data in named if data.get("joints")]
    if not found:
        return []
    joints = list(dict.fromkeys(joint for _, data in found for joint in data))
    with styled():
        grid = PanelGrid(columns=2, heights=[0.35 + 0.28 * len(joints)], title=0.3, gap_x=0.3, right=2.1)
        figure, axes = grid.figure([])
        for ax, quantity, words in ((axes[0, 0], "position", "position (rad, m)"), (axes[0, 1], "torque", "torque (N·m, N)")):
            for number, (name, data) in enumerate(found):
                _draw(ax, [data.get(joint, {}) for joint in joints], quantity, number / 4.0 - 0.1 * len(found), number, name)
            ax.set_xscale("log")
            ax.margins(x=0.06)
            ax.set_xlabel(words)
            ax.set_ylim(len(joints) - 0.5, -0.5)
            ax.set_yticks(range(len(joints)), [shorten(joint, 16) for joint in joints] if quantity == "position" else [])
        axes[0, 1].legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))
        set_title(figure, "accuracy: dots are the largest values of the run, bars reach to the root mean square")
        return save_figure(figure, make_folder(folder), "accuracy", ("png",))


def _draw(axes: Any, rows: Sequence[Mapping[str, Any]], quantity: str, shift: float, number: int, name: str) -> None:
    pairs = [[max(row.get(f"{quantity}_{kind}") or 0.0, SMALLEST) for row in rows] for kind in ("rms", "max")]
    places = [place + shift for place in range(len(rows))]
    axes.hlines(places, *pairs, color=style.variant_colour(number), linewidth=2.0)
    axes.plot(pairs[1], places, "o", color=style.variant_colour(number), markersize=4.0, label=name)
