"""Figure 14: an arm with five joints pushes against a box. The soft arm stops; the stiff arm moves the box."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from asrsim.reproduce import Claim, Evidence, FigurePart, FigureTable, PaperFigure, above, at_most, below, near
from asrsim.samples import TIP
from paper.chain import five_links
from paper.lab import Lab
from paper.law import RATIO, damping_overrides
from paper.motors import qbmove_claims
from paper.pictures import curves, films, picture
from paper.statics import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from matplotlib.figure import Figure

    from asrsim import Result
    from asrsim.samples import Array

SCENARIO, PRESETS, BOX = "box_push_5dof", ("soft", "stiff"), "box"
Y = 1
"""Index of the axis along which the arm pushes."""
RESISTANCE = 0.23 * 2.0 * GRAVITY
"""Friction mu m g of the paper's box, N."""
SLIDING = 0.02
"""Speed above which the box counts as sliding, m/s."""
ACCURACY = {"bullet": 0.1, "mujoco": 0.2}
"""Uncertainty of the mean force on a sliding box in each engine, N. In MuJoCo, the box hops, and a row of the log holds the
force of only one of its substeps."""
BEFORE = 0.01
"""Time before the first contact at which the fit of Newton's law ends, s. The impact lasts less than a step."""


def parts(folder: Path) -> tuple[FigurePart, ...]:
    """Parts of the figure: the push as in the paper, and with damping that grows with the stiffness."""
    lab = Lab(folder)
    results = lab.pairs(SCENARIO, PRESETS)
    tips = {name: result.bodies[TIP] for name, result in results.items()}
    strips = [
        item for name in PRESETS for item in films(results[name].log, f"figure_14_{name}", f"The {name} arm meets the box.")
    ]
    first = FigurePart(
        title="Pushing a box of 2 kg",
        text="The arm has five qbMoves in mode 6 with AlterEgo's springs. The path of the tip is 0.2 m long and takes 4 s. The "
        "loop of the inverse kinematics is closed on the model, and the springs' deflection under gravity is added to the "
        "equilibrium. A box of 0.265 m and 2 kg stands half-way; its friction coefficient on the ground is 0.23.",
        claims=(
            *_claims(results, tips, "paper"),
            *qbmove_claims(results, five_links, until={name: _touch(run) - BEFORE for name, run in results.items()}),
        ),
        tables=(_table(results, tips),),
        pictures=(
            picture(
                "figure_14",
                "Positions of tip and box in the direction of the push, and the force between them, soft and stiff.",
                lambda: _figure(results, tips),
            ),
            *strips,
        ),
    )
    damped = {name: lab.run(SCENARIO, name, overrides=damping_overrides(result), log=False) for name, result in results.items()}
    tips = {name: result.bodies[TIP] for name, result in damped.items()}
    second = FigurePart(
        title="With link damping that grows with the stiffness",
        text=f"The same push, with an additional damping that has the damping ratio {RATIO} at the present stiffness.",
        claims=tuple(_claims(damped, tips, "beyond")),
        tables=(_table(damped, tips),),
    )
    return first, second


def _claims(results: Mapping[str, Result], tips: Mapping[str, Array], origin: Evidence) -> list[Claim]:
    soft, stiff = (results[name] for name in PRESETS)
    goal = _goal(stiff)
    force = _force(soft)
    holding = soft.time > 0.8 * soft.time[-1]
    return [
        Claim(
            origin=origin,
            text="the soft arm does not move the box",
            quantity="displacement of the box in the direction of the push",
            measured=abs(_moved(soft)),
            bound=below(1e-3, "m"),
        ),
        Claim(
            origin=origin,
            text="the box stops the tip of the soft arm",
            quantity="distance of the tip from its goal",
            measured=goal - float(tips["soft"][-1, Y]),
            bound=above(0.05, "m"),
        ),
        Claim(
            origin="theory" if origin == "paper" else origin,
            text="the soft arm pushes with a force below the friction limit of the box",
            quantity="contact force while the arm presses on the box",
            measured=float(np.mean(force[holding])),
            bound=below(RESISTANCE, "N"),
        ),
        Claim(
            origin=origin,
            text="the stiff arm moves the box to the goal",
            quantity="distance of the box from its position at the goal",
            measured=abs(_box_goal(stiff) - float(stiff.bodies[BOX][-1, Y])),
            bound=at_most(0.01, "m"),
        ),
        Claim(
            origin="theory" if origin == "paper" else origin,
            text="the stiff arm pushes the sliding box with the force mu m g (2 kg, mu = 0.23)",
            quantity="contact force while the box slides",
            measured=_sliding_force(stiff),
            bound=near(RESISTANCE, ACCURACY.get(stiff.run.scenario.engine, 0.1), "N"),
        ),
        Claim(
            origin=origin,
            text="the tip of the stiff arm reaches its goal",
            quantity="distance of the tip from its goal",
            measured=abs(goal - float(tips["stiff"][-1, Y])),
            bound=at_most(0.01, "m"),
        ),
    ]


def _goal(result: Result) -> float:
    task = result.run.scenario.task
    return task.poses[-1].position[Y] if task is not None else float("nan")


def _box_goal(result: Result) -> float:
    """Position of the box's centre along the push when the tip touches the box at the goal, m."""
    (box,) = result.run.scenario.world.objects
    return _goal(result) + TIP_RADIUS + 0.5 * box.size[Y]


TIP_RADIUS = 0.03
"""Radius of the fist, m."""


def _moved(result: Result) -> float:
    path = result.bodies[BOX][:, Y]
    return float(path[-1] - path[0])


def _force(result: Result) -> Array:
    """Magnitude (n,) of the contact force between robot and box, N."""
    return np.asarray(np.linalg.norm(_push(result), axis=1))


def _push(result: Result) -> Array:
    """Contact force (n, 3) of the robot on the box, N."""
    total = np.zeros((len(result.time), 3))
    for pair, force in result.contacts.items():
        if BOX in pair.split("/") and "ground" not in pair:
            total += np.nan_to_num(force)
    return total


def _touch(result: Result) -> float:
    """Time at which the arm first touches the box, s; the end of the run if the arm never touches the box."""
    touching = _force(result) > 0.0
    return float(result.time[np.argmax(touching)] if touching.any() else result.time[-1])


def _sliding_force(result: Result) -> float:
    """Mean contact force along the push while the box slides, N; NaN if it never slides."""
    slides = np.gradient(result.bodies[BOX][:, Y], result.time) > SLIDING
    return float(np.mean(_push(result)[slides, Y])) if slides.any() else float("nan")


def _table(results: Mapping[str, Result], tips: Mapping[str, Array]) -> FigureTable:
    rows = [
        (
            name,
            f"{1e3 * _moved(result):.2f}",
            f"{1e3 * (tips[name][-1, Y] - _goal(result)):+.1f}",
            f"{np.mean(_force(result)[result.time > 0.8 * result.time[-1]]):.2f}",
            f"{np.max(_force(result)):.2f}",
            f"{RESISTANCE:.2f}",
        )
        for name, result in results.items()
    ]
    headings = ("", "box moved (mm)", "tip from goal (mm)", "force while holding (N)", "largest force (N)", "μ m g (N)")
    return FigureTable(caption="The push in numbers", headings=headings, rows=tuple(rows))


def _figure(results: Mapping[str, Result], tips: Mapping[str, Array]) -> Figure:
    from asrsim.plots import style
    from asrsim.plots.figures import new_figure

    figure = new_figure(9.0, 4.6)
    axes = figure.subplots(2, 2, sharex=True, sharey="row", squeeze=False)
    for column, (name, run) in enumerate(zip(results, curves(results), strict=True)):
        top, bottom = axes[0, column], axes[1, column]
        result, every = results[name], max(len(results[name].time) // 2000, 1)
        (box,) = result.run.scenario.world.objects
        top.axhline(_goal(result) + TIP_RADIUS, color=style.LIGHT, linewidth=2.6, label="goal of the tip")
        top.plot(result.time[::every], tips[name][::every, Y] + TIP_RADIUS, color=style.VERMILION, label="face of the tip")
        top.plot(
            result.time[::every],
            result.bodies[BOX][::every, Y] - 0.5 * box.size[Y],
            color=style.BLACK,
            label="face of the box",
        )
        top.set_title(f"{name} (preset {0.2 if name == 'soft' else 0.6})", loc="left")
        force = run.curves[BOX, "force"]
        bottom.plot(force.time, force.values, color=style.VERMILION, label="between tip and box")
        bottom.axhline(RESISTANCE, color=style.GREY, linestyle="--", label="μ m g: friction limit")
        bottom.set_xlabel("time (s)")
        bottom.set_ylim(0.0, 3.0 * RESISTANCE)
        peak = int(np.argmax(_force(result)))
        if _force(result)[peak] < 3.0 * RESISTANCE:
            continue
        bottom.annotate(
            f"impact: {_force(result)[peak]:.0f} N during {1e3 * result.run.scenario.step:g} ms",
            (float(result.time[peak]), 3.0 * RESISTANCE),
            xytext=(-6, -10),
            textcoords="offset points",
            ha="right",
            color=style.GREY,
            fontsize=8,
        )
    axes[0, 0].set_ylabel("y (m)")
    axes[1, 0].set_ylabel("force (N)")
    for row in axes:
        row[-1].legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))
    return figure


FIGURE = PaperFigure(
    number=14,
    title="An arm meets a box",
    section="4.2.3",
    paper="An arm with five joints moves its tip along a line, on which a box of 2 kg stands. The box stops the soft arm. The "
    "stiff arm moves the box and reaches its goal. The real arm and the simulation agree.",
    parts=parts,
    cost=10.0,
)
