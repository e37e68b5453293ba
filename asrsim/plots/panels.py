"""Panels: which quantities stand together on one pair of axes, and drawing them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators import MODES
from asrsim.plots import style
from asrsim.plots.curves import REFERENCE, RunCurves
from asrsim.plots.world import Curve
from asrsim.samples import JointInfo

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A kind of panel: one pair of axes a joint."""

    key: str
    words: str
    """Of the vertical axis, without unit."""
    quantities: tuple[str, ...]
    """In drawing order: the first lies underneath."""
    optional: tuple[str, ...] = ()
    """Left out where they are zero all the time."""
    shown: Callable[[JointInfo], bool] = lambda joint: True
    """Joints that have this panel."""

    def of(self, joint: JointInfo) -> tuple[str, ...]:
        """The quantities that this panel shows of a joint."""
        return tuple(name for name in self.quantities if self._belongs(name, joint))

    def _belongs(self, name: str, joint: JointInfo) -> bool:
        mode = MODES.get(joint.mode) if joint.mode is not None else None
        if self.key == "position" and name == "motor_2_position":
            return not style.has_adjuster(joint)
        if name in ("reference_1", "reference_2") and self.key in _REFERENCE_WORD:
            index = int(name[-1]) - 1
            if mode is None or index >= len(mode.references):
                return False
            if self.key == "position":
                # What the motors are told; the position that follows from it is the other reference.
                return not mode.mapped and mode.spring and not mode.references[index].endswith("torque") and (
                    index == 0 or not style.has_adjuster(joint)
                )  # fmt: skip
            return mode.references[index].startswith(_REFERENCE_WORD[self.key]) and mode.references[index].endswith("torque")
        return True


_REFERENCE_WORD = {"position": "", "torque": "link", "motor_torque": "motor"}

PANELS: dict[str, Panel] = {
    panel.key: panel
    for panel in (
        Panel(
            key="position",
            words="position",
            quantities=(REFERENCE, "motor_1_position", "motor_2_position", "equilibrium_position", "link_position"),
        ),
        Panel(key="adjuster", words="adjuster", quantities=("reference_2", "motor_2_position"), shown=style.has_adjuster),
        Panel(key="deflection", words="deflection", quantities=("deflection",)),
        Panel(key="stiffness", words="stiffness", quantities=("stiffness",)),
        Panel(
            key="torque",
            words="link torque",
            quantities=("reference_1", "damping_torque", "external_torque", "link_torque"),
            optional=("damping_torque", "external_torque"),
        ),
        Panel(
            key="motor_torque",
            words="torque at motors",
            quantities=(
                "reference_1",
                "reference_2",
                "elastic_torque_1",
                "elastic_torque_2",
                "motor_1_torque",
                "motor_2_torque",
            ),
        ),
        Panel(
            key="energy",
            words="energy",
            quantities=("motor_work", "friction_loss", "link_work", "damping_loss", "spring_energy"),
            optional=("damping_loss", "friction_loss"),
        ),
        Panel(key="residual", words="energy residual", quantities=("energy_residual",)),
        Panel(key="numerical_error", words="numerical error", quantities=("numerical_error",)),
    )
}
JOINT_PANELS = ("position", "adjuster", "deflection", "stiffness", "torque", "motor_torque")
ENERGY_PANELS = ("energy", "residual", "numerical_error")


def quantity_panel(quantity: str) -> Panel:
    """A panel of one quantity."""
    return Panel(key=f"quantity:{quantity}", words=style.name(quantity), quantities=(quantity,))


def content(panel: Panel, runs: Sequence[RunCurves], joint: str) -> list[tuple[str, int, Curve]]:
    """(quantity, number of the run, curve) of everything that a panel shows of a joint, in drawing order."""
    found: list[tuple[str, int, Curve]] = []
    for name in dict.fromkeys(name for run in runs for info in _info(run, joint) for name in panel.of(info)):
        for number, run in enumerate(runs):
            for info in _info(run, joint):
                curve = run.get(joint, name)
                if curve is None or not panel.shown(info) or name not in panel.of(info):
                    continue
                if name in panel.optional and curve.extent == 0.0:
                    continue
                # One motor alone is the equilibrium: one line for both.
                motor = run.get(joint, "motor_1_position")
                if panel.key == "position" and name == "equilibrium_position" and motor is not None and _equal(curve, motor):
                    continue
                # References that all variants share are drawn once.
                if name.startswith("reference") and any(_equal(curve, other) for q, _, other in found if q == name):
                    continue
                found.append((name, number, curve))
    if all(name.startswith("reference") for name, _, _ in found) and not panel.key.startswith("quantity:"):
        return []
    return found


def draw_panel(axes: Axes, panel: Panel, runs: Sequence[RunCurves], joint: str) -> tuple[str, ...]:
    """Draws a joint's panel on the given axes, variants by line style; returns the quantities drawn."""
    drawn = content(panel, runs, joint)
    for name, number, curve in drawn:
        reference = name.startswith("reference")
        axes.plot(
            curve.time,
            curve.values,
            color=style.colour(name),
            linestyle=style.line_style(number),
            linewidth=2.6 if reference else style.WIDTH,
            label=style.symbol(name) if len(runs) == 1 else f"{style.symbol(name)} {style.plain(runs[number].label)}",
            gid=f"{joint}.{name}.{number}",
            zorder=1.5 if reference else 2.0,
        )
    infos = [info for run in runs for info in _info(run, joint)]
    units = dict.fromkeys(style.unit(name, info) for name, _, _ in drawn for info in infos[:1])
    axes.set_ylabel(style.axis_label(panel.words, " or ".join(filter(None, units))))
    frame(axes, [curve for _, _, curve in drawn])
    return tuple(dict.fromkeys(name for name, _, _ in drawn))


def frame(axes: Axes, curves: Sequence[Curve]) -> None:
    """Limits of the axes: the whole time; values that rest are not blown up to show their last digits."""
    times = [(curve.time[0], curve.time[-1]) for curve in curves if len(curve.time)]
    if not times:
        return
    start, end = min(t[0] for t in times), max(t[1] for t in times)
    if end > start:
        # A start that misses 0 by the rounding of a lag would take the 0 off the axis.
        axes.set_xlim(0.0 if abs(start) < 1e-4 * (end - start) else start, end)
    finite = [curve.values[np.isfinite(curve.values)] for curve in curves]
    low = min((float(v.min()) for v in finite if len(v)), default=0.0)
    high = max((float(v.max()) for v in finite if len(v)), default=0.0)
    size = max(abs(low), abs(high))
    if high - low <= 1e-6 * size or size < 1e-12:
        half = 0.1 * size if size >= 1e-12 else 1.0
        axes.set_ylim(low - half, high + half)
    else:
        margin = 0.07 * (high - low)
        axes.set_ylim(low - margin, high + margin)


def _info(run: RunCurves, joint: str) -> list[JointInfo]:
    return [info for info in run.joints if info.name == joint]


def _equal(a: Curve, b: Curve) -> bool:
    return len(a.time) == len(b.time) and np.array_equal(a.time, b.time) and np.array_equal(a.values, b.values, equal_nan=True)
