"""Figures of a run: panels in rows, joints in columns, several pages if needed.

`FIGURES` is the registry. Users add their own figures: `FIGURES.add("loops", RunFigure(title="torque loops", pages=loops))` in
a plugin file, or an entry point in the group "asrsim.figures".
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

from asrsim.outfile import make_folder
from asrsim.plots import style
from asrsim.plots.curves import REFERENCE, RunCurves, joint_info, read_curves
from asrsim.plots.layout import GAP_Y, PanelGrid, set_title
from asrsim.plots.legends import LIMIT, legend
from asrsim.plots.output import check_formats, save_figure, styled
from asrsim.plots.panels import (
    BODY_PANELS,
    Panel,
    content,
    draw_panel,
    energy_panels,
    joint_panels,
    quantity_panel,
)
from asrsim.registry import Registry, result_fault
from asrsim.samples import JointInfo

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PER_PAGE = 3
"""Largest number of joints on a page."""
TITLE = 60
"""Largest number of letters in a line of a column's title. Such a line is about as wide as a column."""
OVERVIEW_FROM = 5
"""Smallest number of joints for which the first page is an overview of all joints."""


@dataclass(frozen=True, kw_only=True)
class FigurePage:
    """Figure and the name of its file."""

    name: str
    figure: Figure


@dataclass(frozen=True, kw_only=True)
class RunFigure:
    """A figure of one run or of several variants."""

    title: str
    """Content of the figure in words, for the documentation."""
    pages: Callable[[Sequence[RunCurves]], Iterable[FigurePage]]
    """Function that draws the pages of the runs, one at a time. It returns no page if the runs have nothing to show."""


FIGURES: Registry[RunFigure] = Registry("figure", "asrsim.figures", instance=RunFigure)
STANDARD = "overview", "joints", "energy", "objects"
"""Figures that are drawn if no figure is named."""


def run_pages(
    runs: Sequence[RunCurves],
    *,
    figures: Sequence[str] | None = None,
    quantities: Sequence[str] | None = None,
    brief: bool = False,
) -> Iterator[FigurePage]:
    """Pages of one run or of several variants, made one at a time.

    figures: names in `FIGURES`; None: the standard figures. quantities: names of the only quantities to draw, each in its own
    row. brief: whether energies are left out; if an overview shows all joints, only the first page of joints follows it. Raises
    InputError for an unknown figure.
    """
    if quantities is not None:
        yield from _grid_pages("quantities", "", [quantity_panel(name) for name in quantities], runs, joint_names(runs))
        return
    for name in STANDARD if figures is None else figures:
        if not brief:
            yield from _pages_of(name, runs)
        elif name == "joints" and len(joint_names(runs)) >= OVERVIEW_FROM:
            yield from islice(_joint_pages(runs, "all pages: asrsim plot"), 1)
        elif name != "energy":
            yield from _pages_of(name, runs)


def _pages_of(name: str, runs: Sequence[RunCurves]) -> Iterator[FigurePage]:
    """Pages of the figure with this name. Raises InputError if a user's function returns something else."""
    from matplotlib.figure import Figure

    function, taken = FIGURES.get(name).pages, set[str]()
    found = function(runs)
    if not isinstance(found, Iterable):
        message = f"the figure '{name}' must return or yield pages (asrsim.plots.FigurePage); it returns {found!r}"
        raise result_fault(function, message)
    for page in found:
        if not isinstance(page, FigurePage) or not isinstance(page.figure, Figure):
            message = f"a page of the figure '{name}' must be a FigurePage with a figure of Matplotlib; it is {page!r}"
            raise result_fault(function, message)
        if not re.fullmatch(r"[^./\\][^/\\]*", page.name) or page.name in taken:
            message = f"the figure '{name}' must give each page a file name of its own, without folder; it gives '{page.name}'"
            raise result_fault(function, message)
        taken.add(page.name)
        yield page


def _overview_pages(runs: Sequence[RunCurves]) -> Iterator[FigurePage]:
    if len(joint_names(runs)) >= OVERVIEW_FROM:
        yield FigurePage(name="overview", figure=overview_figure(runs))


def _joint_pages(runs: Sequence[RunCurves], subject: str = "") -> Iterator[FigurePage]:
    return _grid_pages("joints", subject, joint_panels(), runs, joint_names(runs))


def _energy_pages(runs: Sequence[RunCurves]) -> Iterator[FigurePage]:
    return _grid_pages("energy", "energies since the start", energy_panels(), runs, joint_names(runs))


def _object_pages(runs: Sequence[RunCurves]) -> Iterator[FigurePage]:
    return _grid_pages("objects", "objects", BODY_PANELS, runs, body_names(runs))


for name, figure in {
    "overview": RunFigure(
        title=f"the positions of all joints, for robots with {OVERVIEW_FROM} joints or more",
        pages=_overview_pages,
    ),
    "joints": RunFigure(
        title="per joint: link, motor and equilibrium positions with the reference; deflection; stiffness; torques at link and "
        "motors; limits of joints, torques and deflections where the motion comes near them (with several runs: the limits "
        "that all runs share)",
        pages=_joint_pages,
    ),
    "energy": RunFigure(
        title="per joint: work of the motors, energy in the springs, losses, work on the link; the residual of the "
        "energy balance",
        pages=_energy_pages,
    ),
    "objects": RunFigure(
        title="displacement and contact force of the world's objects; for a task, the displacements of tip and goal, and the "
        "distance between them",
        pages=_object_pages,
    ),
}.items():
    FIGURES.own(name, figure)


def joint_names(runs: Sequence[RunCurves]) -> tuple[str, ...]:
    """Names of the joints of all runs, in order."""
    return tuple(dict.fromkeys(joint.name for run in runs for joint in run.joints))


def body_names(runs: Sequence[RunCurves]) -> tuple[str, ...]:
    """Names of the objects and tips of all runs, in order."""
    return tuple(dict.fromkeys(body.name for run in runs for body in run.bodies))


def _grid_pages(
    name: str, subject: str, panels: Sequence[Panel], runs: Sequence[RunCurves], joints: Sequence[str]
) -> Iterator[FigurePage]:
    # Joints with the same panels share pages; joints with few panels (rigid joints) come last.
    alike: dict[tuple[str, ...], list[str]] = {}
    for joint in joints:
        alike.setdefault(tuple(panel.key for panel in panels if content(panel, runs, joint)), []).append(joint)
    groups = sorted((item for item in alike.items() if item[0]), key=lambda item: -len(item[0]))
    pages = [joints[index : index + PER_PAGE] for _, joints in groups for index in range(0, len(joints), PER_PAGE)]
    for number, members in enumerate(pages, 1):
        figure = grid_figure(runs, members, panels, subject=subject, part=(number, len(pages)))
        yield FigurePage(name=name if len(pages) == 1 else f"{name}_{number}", figure=figure)


def new_figure(width: float, height: float) -> Figure:
    """Empty figure; width and height in inches."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    from asrsim.plots.ticks import AggFigure

    figure = AggFigure(width, height)
    figure.set_layout_engine(ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05, hspace=0.02, wspace=0.02))
    return figure


def grid_figure(
    runs: Sequence[RunCurves],
    joints: Sequence[str],
    panels: Sequence[Panel],
    *,
    subject: str = "",
    part: tuple[int, int] = (1, 1),
) -> Figure:
    """Figure with panels in rows and joints in columns. Each row has a legend at the right; the legend of the variants is below
    the panels."""
    rows = [panel for panel in panels if any(content(panel, runs, joint) for joint in joints)]
    wide = style.COLUMN_WIDTH * (1.6 if len(joints) == 1 else 0.85)
    grid = PanelGrid(columns=len(joints), heights=[style.ROW_HEIGHT - GAP_Y] * len(rows), width=wide)
    figure, axes = grid.figure([run.label for run in runs], sharex=True)
    several = len(runs) > 1
    for r, panel in enumerate(rows):
        shown: dict[str, None] = {}
        for c, joint in enumerate(joints):
            shown |= dict.fromkeys(draw_panel(axes[r, c], panel, runs, joint))
            if not content(panel, runs, joint):
                style.empty(axes[r, c])
        names = [name for name in panel.of_any(several=several) if name in shown]
        # With several runs and a single quantity, leave the quantity out of the legend, since the axis label names it.
        names = [name for name in (*(names if len(names) > 1 or not several else ()), LIMIT) if name in shown]
        words = {"motor_2_position": "adjuster \u03c3", "reference_2": "its reference"} if panel.key == "adjuster" else None
        legend(axes[r, -1], names, several=several, words=words, among=panel.of_any(several=several))
    for c, joint in enumerate(joints):
        axes[0, c].set_title(joint_title(joint_info(runs, joint)), loc="left", color=style.BLACK)
        axes[-1, c].set_xlabel("time (s)")
    figure_title(figure, runs, subject, part)
    return figure


def overview_figure(runs: Sequence[RunCurves]) -> Figure:
    """Small panels with link position, reference and equilibrium of every joint."""
    joints = joint_names(runs)
    prismatic = {info.name: info.prismatic for run in runs for info in run.joints}
    columns = 3 if len(joints) <= 8 else 4 if len(joints) <= 24 else 6
    rows = -(-len(joints) // columns)
    names = (REFERENCE, "equilibrium_position", "link_position")
    panel = Panel(key="position", words="position", quantities=names, compared=(REFERENCE, "link_position"))
    grid = PanelGrid(columns=columns, heights=[1.05] * rows, width=2.0, gap_x=0.55, gap_y=0.42, title=0.24, right=1.35)
    figure, axes = grid.figure([run.label for run in runs], sharex=True)
    shown: dict[str, None] = {}
    for index, ax in enumerate(axes.flat):
        if index >= len(joints):
            ax.set_visible(False)
            continue
        shown |= dict.fromkeys(draw_panel(ax, panel, runs, joints[index]))
        slides, first = (prismatic[joints[i]] for i in (index, index - index % columns))
        # Only the first panel of a row has an axis label. If another joint of the row has another unit (rad or m), its title
        # states the unit.
        unit = "" if slides == first else " (m)" if slides else " (rad)"
        ax.set_title(shorten(joints[index], 30) + unit, loc="left", fontsize=8)
        if index % columns:
            ax.set_ylabel("")
        if index + columns >= len(joints):
            ax.set_xlabel("time (s)")
            ax.xaxis.set_tick_params(labelbottom=True)
    several = len(runs) > 1
    legend(axes[0, -1], [name for name in (*panel.of_any(several=several), LIMIT) if name in shown], several=several)
    figure_title(figure, runs, "all joints", (1, 1))
    return figure


def joint_title(joint: JointInfo) -> str:
    """Title of a joint's column: its name, and its actuator and mode."""
    return f"{shorten(joint.name, 40)}\n{fill(describe(joint), TITLE, max_lines=2, placeholder=' …')}".strip()


def describe(joint: JointInfo) -> str:
    """Actuator and operation mode of a joint in a few words."""
    from asrsim.actuators import ACTUATORS, MODES

    actuator = ACTUATORS.get(joint.actuator).title if joint.actuator in ACTUATORS else joint.actuator
    actuator = actuator.split(" (")[0]
    if joint.mode is None or joint.mode not in MODES:
        return actuator
    return f"{actuator}, mode {joint.mode} {MODES[joint.mode].name}"


def shorten(text: str, length: int) -> str:
    """Text for a picture; the middle of a text longer than `length` is replaced by an ellipsis."""
    return style.plain(text if len(text) <= length else f"{text[: length // 2 - 1]}…{text[-(length // 2) + 1 :]}")


def figure_title(figure: Figure, runs: Sequence[RunCurves], subject: str, part: tuple[int, int], *, more: str = "") -> None:
    """Write robot, scenario, variant, subject and page in one line at the top left."""
    robots = ", ".join(dict.fromkeys(run.info.robot for run in runs))
    scenarios = dict.fromkeys(run.info.scenario_name for run in runs)
    words = [shorten(name, 40) for name in dict.fromkeys((robots, *(scenarios if len(scenarios) == 1 else ()))) if name]
    if len(runs) == 1 and runs[0].label not in ("default", ""):
        words.append(style.plain(runs[0].label))
    if runs[0].status not in ("complete",):
        words.append(f"run {runs[0].status}")
    words += [text for text in (subject, more) if text]
    if part[1] > 1:
        words.append(f"page {part[0]} of {part[1]}")
    set_title(figure, " · ".join(words))


def draw_run(
    log_path: str | os.PathLike[str], folder: str | os.PathLike[str], *, formats: Sequence[str] = ("png",), brief: bool = False
) -> list[Path]:
    """Draw one run into `folder` (created if missing) and return the files; `asrsim.plots.job.plot` has more options.

    The files are `joints.png` and `energy.png`, and for many joints or objects `overview.png` and `objects.png`. If the joints
    do not fit on one page, the files are `joints_1.png`, `joints_2.png` and so on. formats: one or more of `png`, `pdf`, `svg`.
    brief: whether energies are left out; of many joints, only the overview and the first page are then drawn, as by `asrsim
    run`. Raises LogError for files that are not logs, and OutputError.
    """
    kinds = check_formats(formats)
    place = make_folder(Path(folder))
    run = read_curves(log_path)
    written: list[Path] = []
    with styled():
        for page in run_pages([run], brief=brief):
            written += save_figure(page.figure, place, page.name, kinds)
    return written
