"""Figure 12: steps of a horizontal arm with two joints, and the damping that the authors' simulation lacks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from asrsim.reproduce import Claim, Evidence, FigurePart, FigurePicture, FigureTable, PaperFigure, above, at_most, below, near
from paper.lab import Lab
from paper.law import RATIO, damping_overrides, swings
from paper.motors import qbmove_claims
from paper.newton import level
from paper.pictures import joints_figure, picture

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from asrsim import Result

SCENARIO, JOINTS, GOAL, AT = "step_2dof", ("joint_1", "joint_2"), 0.8, 0.1
MOTORS_OFF = 5e-4
"""Largest distance of the equilibrium from the reference that motor friction and the last swings explain, rad."""
FRICTION = 0.025
"""Friction of each joint in the paper, N m."""
SETTLED = 0.03
"""Largest distance from the reference at which a link counts as settled, rad."""
SHOWN = 2.5
"""Time span of the pictures, s. At its end, the arm is at rest."""
LONG = "duration=8"
"""Override: a duration in which the arm with the default springs comes to rest."""


def parts(folder: Path) -> tuple[FigurePart, ...]:
    """Parts of the figure: AlterEgo's springs, default springs, and default springs with damping that grows with stiffness."""
    lab = Lab(folder)
    plain = lab.pairs(SCENARIO, ("soft", "stiff"))
    nominal = {name: lab.run(SCENARIO, f"nominal_{name}", overrides=[LONG]) for name in ("soft", "stiff")}
    first = FigurePart(
        title="Steps of 0.8 rad, horizontal",
        text="The arm has two links, each a qbMove cube on a flange. It is in mode 6 and has AlterEgo's springs, a joint "
        "damping of 0.065 N m s/rad and a joint friction of 0.025 N m. A link may come to rest wherever the torque of its "
        "springs is below the friction. The law of the springs gives the largest distance from the reference at which this is "
        "possible.",
        claims=(
            *_settled(plain, "AlterEgo's springs"),
            *_faster(plain),
            *qbmove_claims(plain, level),
        ),
        tables=(_table(plain),),
        pictures=(_picture("figure_12", "Links (solid) and equilibria (dashed) of the two joints, soft and stiff.", plain),),
    )
    rings = [
        Claim(
            text=f"the stiff {joint} oscillates more than the soft {joint}",
            quantity="number of swings above 2 % of the step, stiff - soft",
            measured=float(_swings(nominal["stiff"], joint) - _swings(nominal["soft"], joint)),
            bound=above(0.0),
        )
        for joint in JOINTS
    ]
    second = FigurePart(
        title="With the toolbox's default springs",
        text="As in the paper's simulation, the stiff arm oscillates. The soft springs are weak compared with the friction of "
        "the joints, so a soft link may come to rest up to a sixth of a radian from its reference.",
        claims=(*_settled(nominal, "default springs"), *rings),
        tables=(_table(nominal),),
        pictures=(_picture("figure_12_nominal", "The same steps with the toolbox's default springs.", nominal),),
    )
    return first, second, _damped(lab, plain, nominal)


def _settled(results: Mapping[str, Result], springs: str, origin: Evidence = "paper") -> list[Claim]:
    claims = []
    for name, result in results.items():
        claims.append(
            Claim(
                origin=origin,
                text=f"{name}: the equilibria reach the reference ({springs})",
                quantity="largest distance of an equilibrium from the reference at the end",
                measured=max(abs(float(result[joint].equilibrium_position[-1]) - GOAL) for joint in JOINTS),
                bound=at_most(MOTORS_OFF, "rad"),
            )
        )
        claims += [_arrives(result, name, joint, springs, origin) for joint in JOINTS]
    return claims


def _arrives(result: Result, name: str, joint: str, springs: str, origin: Evidence) -> Claim:
    """Claim that the link settles at the reference. If its springs are too weak: claim that friction holds it elsewhere."""
    from asrsim.kinematics import equilibria_for_loads
    from asrsim.robot import drive_of

    block = next(block for block in result.run.robot.actuators if block.joint == joint)
    series = result[joint]
    # At this distance from the equilibrium, the torque of the springs is as large as the friction.
    place, load, preset = np.array([[GOAL], [FRICTION], [series.reference_2[-1]]])
    band = float(equilibria_for_loads(drive_of(block), place, load, preset, droop=False)[0]) - GOAL
    if band <= SETTLED:
        return Claim(
            origin=origin,
            text=f"{name}, {joint}: the link settles at the reference ({springs})",
            quantity="link at the end",
            measured=float(np.mean(series.link_position[-200:])),
            bound=near(GOAL, band + MOTORS_OFF, "rad"),
        )
    return Claim(
        origin="theory" if origin == "paper" else origin,
        text=f"{name}, {joint}: where the link rests, the torque of its springs is below the friction ({springs})",
        quantity="torque of the springs at the end",
        measured=abs(float(np.mean(series.link_torque[-200:]))),
        bound=at_most(FRICTION, "N m"),
    )


def _faster(results: Mapping[str, Result]) -> list[Claim]:
    return [
        Claim(
            origin="theory",
            text=f"the stiff {joint} oscillates faster than the soft {joint}",
            quantity="frequency stiff / soft",
            measured=_frequency(results["stiff"], joint) / _frequency(results["soft"], joint),
            bound=above(2.0),
        )
        for joint in JOINTS
    ]


def _frequency(result: Result, joint: str) -> float:
    from asrsim.metrics.oscillation import frequency

    series = result[joint]
    after = result.time > AT
    return frequency(result.time[after], (series.link_position - series.equilibrium_position)[after])


def _swings(result: Result, joint: str) -> int:
    return swings(result[joint].link_position[result.time >= AT], GOAL)


def _overshoot(result: Result, joint: str) -> float:
    return float(np.max(result[joint].link_position)) / GOAL - 1.0


def _settling(result: Result, joint: str) -> float:
    """Settling time: time from the step until the link stays within 5 % of its final position, s."""
    q = result[joint].link_position
    outside = np.flatnonzero(np.abs(q - q[-1]) > 0.05 * GOAL)
    return float(result.time[outside[-1]]) - AT if len(outside) else 0.0


def _table(results: Mapping[str, Result]) -> FigureTable:
    rows = [
        (
            f"{name}, {joint}",
            f"{result[joint].link_position[-1]:.4f}",
            f"{result[joint].stiffness[-1]:.3g}",
            f"{100 * _overshoot(result, joint):.1f} %",
            str(_swings(result, joint)),
            f"{_settling(result, joint):.2f}",
        )
        for name, result in results.items()
        for joint in JOINTS
    ]
    headings = ("", "end (rad)", "stiffness (N m/rad)", "overshoot", "swings above 2 %", "settling to 5 % (s)")
    return FigureTable(caption="The steps in numbers", headings=headings, rows=tuple(rows))


def _damped(lab: Lab, plain: Mapping[str, Result], nominal: Mapping[str, Result]) -> FigurePart:
    alterego = {
        name: lab.run(SCENARIO, name, overrides=damping_overrides(result), label=f"{name}_damped")
        for name, result in plain.items()
    }
    default = {
        name: lab.run(SCENARIO, f"nominal_{name}", overrides=[LONG, *damping_overrides(result)], label=f"nominal_{name}_damped")
        for name, result in nominal.items()
    }
    claims = [*_settled(alterego, "AlterEgo's springs", "beyond"), *_settled(default, "default springs", "beyond")]
    for joint in JOINTS:
        before, after = (_settling(runs["stiff"], joint) for runs in (nominal, default))
        claims += [
            Claim(
                origin="beyond",
                text=f"this damping reduces the oscillations of the stiff {joint} (default springs)",
                quantity="number of swings above 2 % of the step, with - without this damping",
                measured=float(_swings(default["stiff"], joint) - _swings(nominal["stiff"], joint)),
                bound=below(0.0),
            ),
            Claim(
                origin="beyond",
                text=f"with this damping, the stiff {joint} settles sooner, as in the real arm (default springs)",
                quantity="settling time with / without this damping",
                measured=after / before,
                bound=below(0.8),
            ),
        ]
    return FigurePart(
        title="Beyond the paper: damping that changes with the preset",
        text="The authors of the paper explain the oscillations of the stiff simulation by its constant damping, since the "
        "damping of the real joint grows with the preset. The steps are repeated with an additional damping that has the "
        f"damping ratio {RATIO} at the present stiffness and the inertia of each joint.",
        claims=tuple(claims),
        tables=(_table({f"default {name}": run for name, run in default.items()} | alterego),),
        pictures=(
            _picture(
                "figure_12_nominal_damped",
                "Default springs, with damping that grows with the stiffness: the arm hardly oscillates.",
                default,
            ),
            _picture("figure_12_damped", "AlterEgo's springs, with damping that grows with the stiffness.", alterego),
        ),
    )


def _picture(name: str, caption: str, results: Mapping[str, Result]) -> FigurePicture:
    return picture(name, caption, lambda: joints_figure(results, ("link", "stiffness"), until=SHOWN))


FIGURE = PaperFigure(
    number=12,
    title="Steps of a horizontal arm",
    section="4.2.2",
    paper="The references of two joints step by 0.8 rad, in a plane without gravity. Links and equilibria reach the reference "
    "with the two presets. The stiff simulation oscillates more than the real arm, since its damping does not change with the "
    "preset.",
    parts=parts,
    cost=4.0,
)
