"""Matplotlib figures as pictures of a page, in the style of asrsim's plots."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from asrsim.reproduce import FigurePicture

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from asrsim import Result
    from asrsim.plots.curves import RunCurves
    from asrsim.plots.panels import Panel

DPI = 130
"""Resolution of pixel images inside a vector picture, dots per inch."""
FRAMES = 6
"""Number of frames in a film strip."""


def picture(name: str, caption: str, draw: Callable[[], Figure]) -> FigurePicture:
    """SVG picture of the figure that `draw` returns."""
    import matplotlib

    from asrsim.plots.output import METADATA, styled

    with styled():
        figure = draw()
        stream = io.BytesIO()
        # Letters become paths, so that the picture looks the same on machines without the font.
        with matplotlib.rc_context({"svg.fonttype": "path"}):
            figure.savefig(stream, format="svg", metadata=METADATA["svg"], dpi=DPI)
    return FigurePicture(name=name, caption=caption, kind="svg", data=stream.getvalue())


def curves(results: Mapping[str, Result], *, start: float | None = None, end: float | None = None) -> list[RunCurves]:
    """Curves of the runs from `start` to `end` (s), thinned for plots. Runs without a log are left out."""
    from dataclasses import replace

    from asrsim.plots.curves import read_curves

    return [
        replace(read_curves(result.log, start=start, end=end), label=label)
        for label, result in results.items()
        if result.log is not None
    ]


def joints_figure(results: Mapping[str, Result], panels: Sequence[str], *, until: float | None = None) -> Figure:
    """Figure with a row for each panel, a column for each joint and a colour for each run.

    panels: `link`, or a name in `asrsim.plots.panels.PANELS`; until: end of the time axes, s.
    """
    from asrsim.plots.figures import grid_figure, joint_names
    from asrsim.plots.panels import PANELS

    runs = curves(results, end=until)
    figure = grid_figure(runs, joint_names(runs), [link_panel() if name == "link" else PANELS[name] for name in panels])
    figure.suptitle("")
    return figure


def link_panel() -> Panel:
    """Panel with the positions of reference, equilibrium and link, without motors, as in the paper's figures."""
    from asrsim.plots.curves import REFERENCE
    from asrsim.plots.panels import Panel

    return Panel(
        key="link",
        words="position",
        quantities=(REFERENCE, "equilibrium_position", "link_position"),
        compared=(REFERENCE, "link_position", "equilibrium_position"),
    )


def films(log: Path | None, name: str, caption: str) -> tuple[FigurePicture, ...]:
    """Film strip of the motion in a log; empty without a log."""
    if log is None or not log.is_file():
        return ()
    from asrsim.render import Film, film_strip, telling_times

    film = Film(log)
    stream = io.BytesIO()
    film_strip([film.frame(time) for time in telling_times([film], FRAMES)]).save(stream, format="PNG", compress_level=6)
    return (FigurePicture(name=name, caption=caption, kind="png", data=stream.getvalue()),)
