"""Panels: quantities that share one pair of axes, and their drawing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators import MODES
from asrsim.actuators.stages import STAGES, Stage
from asrsim.plots import style
from asrsim.plots.curves import REFERENCE, RunCurves
from asrsim.plots.decimate import Curve
from asrsim.plots.legends import LIMIT, LIMIT_LINE
from asrsim.plots.limits import panel_limits
from asrsim.plots.view import draw_curve, label_values, show_time, show_values
from asrsim.quantities import each_motor
from asrsim.samples import JointInfo

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Quantities that one pair of axes shows for a joint."""

    key: str
    words: str
    """Label of the vertical axis, without unit."""
    quantities: tuple[str, ...]
    """Quantities in drawing order; the first quantity lies under the others."""
    optional: tuple[str, ...] = ()
    """Quantities that are left out if they are zero at all times."""
    shown: Callable[[JointInfo], bool] = lambda joint: True
    """Function that returns whether a joint has this panel."""
    compared: tuple[str, ...] | None = None
    """Quantities that are drawn if a picture has several runs, which colours distinguish; None: `quantities`; (): no panel."""

    def of(self, joint: JointInfo, *, several: bool = False) -> tuple[str, ...]:
        """Quantities of a joint in this panel. several: whether the picture has several runs."""
        return tuple(name for name in self.of_any(several=several) if self._belongs(name, joint))

    def of_any(self, *, several: bool) -> tuple[str, ...]:
        """Quantities that the panel may contain for any joint. several: whether the picture has several runs."""
        return self.quantities if not several or self.compared is None else self.compared

    def _belongs(self, name: str, joint: JointInfo) -> bool:
        if self.key in ("position", "motors") and name == "motor_2_position":
            return not style.has_adjuster(joint)
        word = _TORQUES.get(self.key)
        if word is None or not name.startswith("reference_"):
            return True
        mode, index = MODES.get(joint.mode) if joint.mode is not None else None, int(name[-1]) - 1
        names = () if mode is None else mode.references_of(joint.motors)
        given = names[index] if index < len(names) else ""
        return given.startswith(word) and given.endswith("torque")


_TORQUES = {"torque": "link", "motor_torque": "motor"}
"""Panels that show the reference only if the reference is a torque, and the part (link or motor) on which this torque acts."""

PANELS: dict[str, Panel] = {
    panel.key: panel
    for panel in (
        Panel(
            key="position",
            words="position",
            quantities=(REFERENCE, *each_motor("motor_{}_position"), "equilibrium_position", "link_position"),
            compared=(REFERENCE, "link_position"),
        ),
        Panel(key="motors", words="motor position", quantities=(), compared=each_motor("motor_{}_position")),
        Panel(key="adjuster", words="adjuster", quantities=("reference_2", "motor_2_position"), shown=style.has_adjuster),
        Panel(key="deflection", words="deflection", quantities=("deflection",)),
        Panel(key="stiffness", words="stiffness", quantities=("stiffness",)),
        Panel(
            key="torque",
            words="link torque",
            quantities=("reference_1", "damping_torque", "external_torque", "link_torque"),
            optional=("damping_torque", "external_torque"),
            compared=("reference_1", "link_torque", "external_torque"),
        ),
        Panel(
            key="motor_torque",
            words="torque at motors",
            quantities=(*each_motor("reference_{}"), *each_motor("elastic_torque_{}"), *each_motor("motor_{}_torque")),
            compared=(*each_motor("reference_{}"), *each_motor("motor_{}_torque")),
        ),
        Panel(
            key="energy",
            words="energy",
            quantities=("motor_work", "friction_loss", "link_work", "damping_loss", "spring_energy"),
            optional=("damping_loss", "friction_loss"),
            compared=("spring_energy", "motor_work", "link_work"),
        ),
        Panel(key="residual", words="energy residual", quantities=("energy_residual",)),
        Panel(key="numerical_error", words="numerical error", quantities=("numerical_error",)),
    )
}
BODY_PANELS = (
    Panel(key="displacement", words="displacement", quantities=("reference_x", "reference_y", "reference_z", "dx", "dy", "dz")),
    Panel(key="force", words="contact force", quantities=("force",)),
    Panel(key="distance", words="distance to the goal", quantities=("error",)),
)
"""Panels of the objects of the world and of the tip of a task."""
_STILL = 1e-6
"""Smallest change of a position that counts as motion, rad or m."""
JOINT_PANELS = ("position", "motors", "adjuster", "deflection", "stiffness", "torque", "motor_torque")
ENERGY_PANELS = ("energy", "residual", "numerical_error")


def joint_panels() -> tuple[Panel, ...]:
    """Panels of a joint's motion and torques. Each actuator stage adds one panel for each unit of its quantities; energies (J)
    are left out."""
    return (*(PANELS[key] for key in JOINT_PANELS), *(panel for stage in STAGES.loaded() for panel in _stage_panels(stage)))


def _stage_panels(stage: type[Stage]) -> Iterator[Panel]:
    for unit in dict.fromkeys(one.unit for one in stage.quantities if one.unit != "J"):
        names = tuple(one.name for one in stage.quantities if one.unit == unit)
        yield Panel(key=f"stage:{stage.name}:{unit}", words=stage.name, quantities=names)


def energy_panels() -> tuple[Panel, ...]:
    """Panels of a joint's energies. Losses of stages of actuators are in the panel with all other losses."""
    energy, *others = (PANELS[key] for key in ENERGY_PANELS)
    losses = tuple(stage.lost for stage in STAGES.loaded() if stage.lost)
    return (replace(energy, quantities=(*energy.quantities, *losses), optional=(*energy.optional, *losses)), *others)


def quantity_panel(quantity: str) -> Panel:
    """Panel with a single quantity."""
    return Panel(key=f"quantity:{quantity}", words=style.name(quantity), quantities=(quantity,))


def content(panel: Panel, runs: Sequence[RunCurves], joint: str) -> list[tuple[str, int, Curve]]:
    """Curves of a joint in a panel in drawing order, each as (quantity, index of the run, curve)."""
    found: list[tuple[str, int, Curve]] = []
    several = len(runs) > 1
    for name in dict.fromkeys(name for run in runs for info in _info(run, joint) for name in panel.of(info, several=several)):
        for number, run in enumerate(runs):
            for info in _info(run, joint):
                curve = run.get(joint, name)
                if curve is None or not panel.shown(info) or name not in panel.of(info, several=several):
                    continue
                if name in panel.optional and curve.extent == 0.0:
                    continue
                # Draw one line for the two quantities, since with a single motor the equilibrium is equal to the motor
                # position.
                motor = run.get(joint, "motor_1_position")
                if panel.key == "position" and name == "equilibrium_position" and motor is not None and _equal(curve, motor):
                    continue
                # Draw a reference that all variants share only once.
                if name.startswith("reference") and any(_equal(curve, other) for q, _, other in found if q == name):
                    continue
                found.append((name, number, curve))
    if all(name.startswith("reference") for name, _, _ in found) and not panel.key.startswith("quantity:"):
        return []
    return found


def draw_panel(axes: Axes, panel: Panel, runs: Sequence[RunCurves], joint: str) -> tuple[str, ...]:
    """Draw a joint's panel, in which colours mark variants. Returns the names of the drawn quantities, with `limit` if limits
    were drawn.
    """
    drawn = content(panel, runs, joint)
    several = len(runs) > 1
    plain = [name for name in dict.fromkeys(name for name, _, _ in drawn) if not name.startswith("reference")]
    styles = style.styles_of_equal_colours(panel.of_any(several=several))
    show_time(axes, [curve for _, _, curve in drawn])
    for name, number, curve in drawn:
        reference = name.startswith("reference")
        shared = reference and sum(other == name for other, _, _ in drawn) == 1
        colour = style.variant_colour(number) if several and not shared else style.colour(name)
        draw_curve(
            axes,
            curve,
            colour=colour,
            linestyle=style.line_style(plain.index(name)) if several and not reference else styles[name],
            reference=reference,
            gid=f"{joint}.{name}.{number}",
            alpha=0.35 if reference and several and not shared else None,
        )
    infos = [info for run in runs for info in _info(run, joint)]
    units = dict.fromkeys(style.unit(name, info) for name, _, _ in drawn for info in infos[:1])
    words = panel.words.replace("torque", "force") if infos and infos[0].prismatic else panel.words
    limits = _common_limits(runs, joint, panel.key) if drawn else []
    show_values(
        axes,
        [curve for _, _, curve in drawn],
        limits=limits,
        brief=any("N" in unit for unit in units),
        still=_STILL if panel.key in ("position", "link") else 1e-12,
    )
    label_values(axes, words, " or ".join(filter(None, units)))
    low, high = axes.get_ylim()
    seen = [limit for limit in limits if ((limit.values >= low) & (limit.values <= high)).any()]
    for limit in seen:
        axes.plot(
            limit.time,
            limit.values,
            color=style.colour(LIMIT),
            linewidth=0.9,
            linestyle=LIMIT_LINE,
            zorder=1.2,
            gid=f"{joint}.{panel.key}.limit",
        )
    return (*dict.fromkeys(name for name, _, _ in drawn), *([LIMIT] if seen else []))


def _common_limits(runs: Sequence[RunCurves], joint: str, panel: str) -> list[Curve]:
    """Limits that all runs share; limits that differ from run to run would hide the curves."""
    first, *others = (panel_limits(run, joint, panel) for run in runs if _info(run, joint))
    return [
        limit for limit in first if all(any(np.array_equal(limit.values, same.values) for same in other) for other in others)
    ]


def _info(run: RunCurves, joint: str) -> list[JointInfo]:
    return [info for info in (*run.joints, *run.bodies) if info.name == joint]


def _equal(a: Curve, b: Curve) -> bool:
    return len(a.time) == len(b.time) and np.array_equal(a.time, b.time) and np.array_equal(a.values, b.values, equal_nan=True)
