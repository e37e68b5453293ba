"""Figures of matplotlib as pictures for a page, in the look of all our plots."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from asrsim.reproduce import Picture

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from asrsim import Result
    from asrsim.plots.curves import RunCurves
    from asrsim.plots.panels import Panel

DPI = 130
"""Dots per inch of what a vector picture holds as pixels."""
FRAMES = 6
"""Of a film strip."""


def picture(name: str, caption: str, draw: Callable[[], Figure]) -> Picture:
    """What `draw` draws, as SVG."""
    import matplotlib

    from asrsim.plots.output import METADATA, styled

    with styled():
        figure = draw()
        stream = io.BytesIO()
        # Letters become paths, so that it looks the same without our font.
        with matplotlib.rc_context({"svg.fonttype": "path"}):
            figure.savefig(stream, format="svg", metadata=METADATA["svg"], dpi=DPI)
    return Picture(name=name, caption=caption, kind="svg", data=stream.getvalue())


def curves(results: Mapping[str, Result], *, start: float | None = None, end: float | None = None) -> list[RunCurves]:
    """Thinned curves of runs by label, from `start` to `end` (s); runs without a log are left out."""
    from dataclasses import replace

    from asrsim.plots.curves import read_curves

    return [
        replace(read_curves(result.log, start=start, end=end), label=label)
        for label, result in results.items()
        if result.log is not None
    ]


def joints_figure(results: Mapping[str, Result], panels: Sequence[str], *, until: float | None = None) -> Figure:
    """Panels by name (`link`, or see :data:`asrsim.plots.panels.PANELS`) in rows, joints in columns, runs by colour.

    until: s, end of the axes of time.
    """
    from asrsim.plots.figures import grid_figure, joint_names
    from asrsim.plots.panels import PANELS

    runs = curves(results, end=until)
    figure = grid_figure(runs, joint_names(runs), [link_panel() if name == "link" else PANELS[name] for name in panels])
    figure.suptitle("")
    return figure


def link_panel() -> Panel:
    """Reference, equilibrium and link, as in the paper's figures: without the motors."""
    from asrsim.plots.curves import REFERENCE
    from asrsim.plots.panels import Panel

    return Panel(
        key="link", words="position", quantities=(REFERENCE, "equilibrium_position", "link_position"),
        compared=(REFERENCE, "link_position", "equilibrium_position"),
    )  # fmt: skip


def films(log: Path | None, name: str, caption: str) -> tuple[Picture, ...]:
    """A film strip of a run's motion, from its log; nothing without one."""
    if log is None or not log.is_file():
        return ()
    from asrsim.render import Film, film_strip, telling_times

    film = Film(log)
    stream = io.BytesIO()
    film_strip([film.frame(time) for time in telling_times([film], FRAMES)]).save(stream, format="PNG", compress_level=6)
    return (Picture(name=name, caption=caption, kind="png", data=stream.getvalue()),)
