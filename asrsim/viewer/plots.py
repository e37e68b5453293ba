"""Moving plots. They show the quantities of joints that the user chooses, over the last seconds, beside the same quantities of
other runs and recordings.
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
"""Colours of the curves, one for each joint; further joints repeat the colours."""
POINTS = 600
"""Largest number of points of a curve. A plot is 180 pixels wide; with more than four points per pixel, uPlot would draw stairs
of whole pixels.
"""
WINDOW = 10.0
"""Length of the time axis at first, s."""
ALL = "all joints"
ZERO = 1e-12
"""Magnitude up to which all values of a curve count as zero, in the quantity's unit."""
MOST = 8
"""Number of joints above which the first plots show one joint."""
LOOK: dict[str, Any] = {"width": 1.5, "pxAlign": 0}
"""Style of a curve for uPlot. `width` is in pixels. `pxAlign` is 0, since rounding points to whole pixels would turn slopes
into stairs.
"""
DASHES = [6, 4]
"""Lengths of the dashes, and of the gaps between them, in the curves of other runs and recordings, pixels."""
CHOICE = 1e9
"""Rank of a plot's controls in their folder. It is so high that the controls stand below the plot, although the plot is created
later."""
HEIGHT = 190
"""Height of a plot, pixels."""
FIRST = ("link_position", "elastic_torque_1", "external_torque", "link_torque")
"""Quantities for the first two plots. The plots show the first two of these quantities that the subject has."""


class Plots:
    """All plots of a page, in a panel of their own."""

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
        """Add a plot of a quantity; None: the subject's first quantity."""
        with self._container:
            folder = self._gui.add_folder(f"Plot {len(self.plots) + 1}")
        self.plots.append(Plot(self._gui, folder, self, quantity or self.subject.quantities()[0], self._first))

    def draw(self, now: float) -> None:
        """Show in all plots the last seconds before the time `now` in s."""
        for plot in self.plots:
            plot.draw(now - float(self._window.value), now)

    def joints_of(self, quantity: str) -> tuple[JointInfo, ...]:
        """Joints for which a quantity is recorded; if it is recorded for no joint, joints for which it is computed from other
        quantities."""
        logged = [joint for joint in self.subject.joints if quantity in joint.quantities]
        return tuple(logged) or tuple(joint for joint in self.subject.joints if joint.motors)


class Plot:
    """One plot, with controls that choose its quantity and its joint."""

    def __init__(self, gui: viser.GuiApi, folder: Any, plots: Plots, quantity: str, joint: str) -> None:
        self._gui, self._folder, self._plots = gui, folder, plots
        with folder, gui.add_folder("Choose", order=CHOICE, expand_by_default=False):
            self.quantity = gui.add_dropdown("Quantity", plots.subject.quantities(), initial_value=quantity)
            self.joint = gui.add_dropdown("Joint", (ALL, *(one.name for one in plots.subject.joints)), initial_value=joint)
            gone = gui.add_button("Remove")
        gone.on_click(lambda _: self.remove())
        self._shown: tuple[Any, ...] = ()
        """Quantity, and labels of the curves, for which the plot on the page was created."""
        self._plot: viser.GuiUplotHandle | None = None

    def remove(self) -> None:
        """Remove this plot from the page."""
        if self in self._plots.plots:
            self._plots.plots.remove(self)
            self._folder.remove()

    def draw(self, start: float, end: float) -> None:
        """Show the curves from `start` to `end` in s."""
        quantity, chosen, subject = str(self.quantity.value), str(self.joint.value), self._plots.subject
        joints = [joint for joint in self._plots.joints_of(quantity) if chosen in (ALL, joint.name)]
        time = np.empty(0)
        curves: list[Array] = []
        series: list[dict[str, Any]] = [{"label": "s"}]
        for number, joint in enumerate(joints):
            own, values = subject.history.curve(joint.name, quantity, start, end + 1e-9)
            every = max(1, -(-len(own) // POINTS))
            # Keep every n-th sample, counted from the end, so that the newest sample is kept.
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
        # Draw nothing for a single sample, since the page could not scale the time axis.
        if len(time) > 1 and curves:
            self._show(quantity, joints, series, (time, *curves))

    def _show(self, quantity: str, joints: Sequence[JointInfo], series: list[dict[str, Any]], data: tuple[Array, ...]) -> None:
        # Give curves that are always 0 an axis from -1 to 1, since uPlot would give them an axis from 0 to 100.
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
        # Create a new plot. If only the curves were replaced, the plot would show a wrong range of time, since viser keeps the
        # visible fraction of the time axis and assumes that the time of new curves ends at 1 s.
        if self._plot is not None:
            self._plot.remove()
        with self._folder:
            self._plot = self._gui.add_uplot(
                data, lines, scales=scales, height=HEIGHT, axes=axes, legend={"show": True}, padding=(8, 12, 0, 0)
            )


def _hex(colour: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
