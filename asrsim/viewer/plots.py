"""Moving plots: chosen quantities of chosen joints over the last seconds, beside the same quantities of other runs and
recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.plots.style import unit
from asrsim.samples import Array, JointInfo
from asrsim.viewer.colours import label_of
from asrsim.viewer.stage import GHOSTS
from asrsim.viewer.subject import Companion, Subject

if TYPE_CHECKING:
    import viser

COLOURS = ("#d55e00", "#0072b2", "#009e73", "#e69f00", "#b3599a", "#56b4e9", "#a39700", "#1a1a1a")
"""Colours of the joints' curves."""
POINTS = 600
"""Largest number of points of a curve. With more than four points per pixel, uPlot draws stairs of whole pixels; a plot is 180
pixels wide.
"""
WINDOW = 10.0
"""Time shown at first, s."""
ALL = "all joints"
ZERO = 1e-12
"""A curve whose largest value is below this number is drawn as zero."""
MOST = 8
"""Number of joints above which the first plots show one joint."""
LOOK: dict[str, Any] = {"width": 1.5, "pxAlign": 0}
"""Width of a curve in pixels; its points are not rounded to whole pixels, since a slope would then look like stairs."""
DASHES = [6, 4]
"""Dashes of the curves of other runs and recordings, pixels."""
CHOICE = 1e9
"""Position of the controls of a plot: below the plot, which is created later."""
HEIGHT = 190
"""Height of a plot, pixels."""
FIRST = ("link_position", "elastic_torque_1", "external_torque", "link_torque")
"""Quantities of the first two plots; those that are not recorded are left out."""


class Plots:
    """Plots of a page, in a separate panel."""

    def __init__(self, gui: viser.GuiApi, subject: Subject, container: Any, *, together: bool) -> None:
        """together: whether the first plots show all joints."""
        self._gui, self.subject, self._container = gui, subject, container
        self.companions: dict[str, Companion] = {}
        self.plots: list[Plot] = []
        with container:
            self._window = gui.add_slider("Window, s", min=1.0, max=60.0, step=0.5, initial_value=WINDOW)
            more = gui.add_button("Add a plot")
        more.on_click(lambda _: self.add())
        self._first = ALL if together and len(subject.joints) <= MOST else subject.joints[0].name
        names = [name for name in FIRST if name in subject.quantities()][:2]
        for name in names or subject.quantities()[:1]:
            self.add(name)

    def add(self, quantity: str | None = None) -> None:
        """Add a plot of a quantity of all joints."""
        with self._container:
            folder = self._gui.add_folder(f"Plot {len(self.plots) + 1}")
        self.plots.append(Plot(self._gui, folder, self, quantity or self.subject.quantities()[0], self._first))

    def draw(self, now: float) -> None:
        """Show the last seconds before a time in s."""
        for plot in self.plots:
            plot.draw(now - float(self._window.value), now)

    def joints_of(self, quantity: str) -> tuple[JointInfo, ...]:
        """Joints that record a quantity, or from whose quantities it is computed."""
        logged = [joint for joint in self.subject.joints if quantity in joint.quantities]
        return tuple(logged) or tuple(joint for joint in self.subject.joints if joint.motors)


class Plot:
    """A plot with the choices of quantity and joint."""

    def __init__(self, gui: viser.GuiApi, folder: Any, plots: Plots, quantity: str, joint: str) -> None:
        self._gui, self._folder, self._plots = gui, folder, plots
        with folder, gui.add_folder("Choose", order=CHOICE, expand_by_default=False):
            self.quantity = gui.add_dropdown("Quantity", plots.subject.quantities(), initial_value=quantity)
            self.joint = gui.add_dropdown("Joint", (ALL, *(one.name for one in plots.subject.joints)), initial_value=joint)
            gone = gui.add_button("Remove")
        gone.on_click(lambda _: self.remove())
        self._shown: tuple[Any, ...] = ()
        """Quantity and labels of the curves that the present plot has."""
        self._plot: viser.GuiUplotHandle | None = None

    def remove(self) -> None:
        """Remove the plot."""
        if self in self._plots.plots:
            self._plots.plots.remove(self)
            self._folder.remove()

    def draw(self, start: float, end: float) -> None:
        """Show the curves between two times in s."""
        quantity, chosen, subject = str(self.quantity.value), str(self.joint.value), self._plots.subject
        joints = [joint for joint in self._plots.joints_of(quantity) if chosen in (ALL, joint.name)]
        time = np.empty(0)
        curves: list[Array] = []
        series: list[dict[str, Any]] = [{"label": "s"}]
        for number, joint in enumerate(joints):
            own, values = subject.history.curve(joint.name, quantity, start, end + 1e-9)
            every = max(1, -(-len(own) // POINTS))
            # Counting from the end keeps the newest sample.
            rows = slice((len(own) - 1) % every, None, every)
            if not len(time):
                time = own[rows]
            if not len(time) or not np.isfinite(values).any():
                continue
            colour = COLOURS[number % len(COLOURS)]
            curves.append(values[rows])
            series.append({"label": joint.name, "stroke": colour, **LOOK})
            for k, companion in enumerate(self._plots.companions.values()):
                there, other = companion.curve(joint.name, quantity, start - 1.0, end + 1.0)
                if len(there) > 1:
                    curves.append(np.interp(time, there, other, left=np.nan, right=np.nan))
                    stroke = colour if len(self._plots.companions) == 1 else _hex(GHOSTS[k % len(GHOSTS)])
                    name = f"{companion.label} {joint.name}" if len(joints) > 1 else companion.label
                    series.append({"label": name, "stroke": stroke, "dash": DASHES, **LOOK})
        # A single sample spans no time, so the page could not scale the time axis.
        if len(time) > 1 and curves:
            self._show(quantity, joints, series, (time, *curves))

    def _show(self, quantity: str, joints: Sequence[JointInfo], series: list[dict[str, Any]], data: tuple[Array, ...]) -> None:
        # uPlot would give curves of zeros an axis from 0 to 100.
        zero = not any(np.any(np.abs(curve[np.isfinite(curve)]) > ZERO) for curve in data[1:])
        shown = (quantity, zero, *(one["label"] for one in series))
        if shown == self._shown and self._plot is not None:
            if any(not np.array_equal(new, old) for new, old in zip(data, self._plot.data, strict=True)):
                self._plot.data = data
            return
        self._shown = shown
        units = [unit(quantity, joint) for joint in joints]
        axis: Any = {"size": 52, "label": label_of(quantity, units), "labelSize": 18, "font": "11px sans-serif"}
        axes: Any = ({"size": 30, "font": "11px sans-serif"}, axis)
        lines: Any = tuple(series)
        scales: Any = {"x": {"time": False}, **({"y": {"range": (-1.0, 1.0)}} if zero else {})}
        # A plot whose curves are replaced would show a wrong range of time: viser keeps the shown fraction of the time, and
        # assumes that the time of a new plot ends at 1 s.
        if self._plot is not None:
            self._plot.remove()
        with self._folder:
            self._plot = self._gui.add_uplot(
                data, lines, scales=scales, height=HEIGHT, axes=axes, legend={"show": True}, padding=(8, 12, 0, 0)
            )


def _hex(colour: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
