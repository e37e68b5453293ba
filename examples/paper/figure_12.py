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
    """Parts of the figure: AlterEgo's springs, the default springs, and both with damping that grows with the stiffness."""
    lab = Lab(folder)
    plain = lab.pairs(SCENARIO, ("soft", "stiff"))
    nominal = {name: lab.run(SCENARIO, f"nominal_{name}", overrides=[LONG]) for name in ("soft", "stiff")}
    first = FigurePart(
        title="Steps of 0.8 rad, horizontal",
        text="Two links, each a qbMove cube on its flange, mode 6, AlterEgo's springs, joint damping 0.065 N m s/rad and "
        "friction 0.025 N m. A link may stop where friction outweighs the springs: how far off that is, the springs' law says.",
        claims=(
            *_settled(plain, "AlterEgo's springs"),
            *_faster(plain),
            *qbmove_claims(plain, level),
        ),
        tables=(_table(plain),),
        pictures=(_picture("figure_12", "Both joints' links (solid) and equilibria (dashed), soft and stiff.", plain),),
    )
    rings = [
        Claim(
            text=f"the stiff arm rings more than the soft one, {joint}",
            quantity="swings beyond 2 % of the step, stiff - soft",
            measured=float(_swings(nominal["stiff"], joint) - _swings(nominal["soft"], joint)),
            bound=above(0.0),
        )
        for joint in JOINTS
    ]
    second = FigurePart(
        title="With the toolbox's default springs",
        text="Here it is as in the paper's simulation: the stiff arm oscillates. The soft springs are weak against the "
        "joint's friction, so that a soft link may stop a sixth of a radian off.",
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
                text=f"{name}: the equilibria arrive at the reference ({springs})",
                quantity="largest distance of an equilibrium from the reference at the end",
                measured=max(abs(float(result[joint].equilibrium_position[-1]) - GOAL) for joint in JOINTS),
                bound=at_most(MOTORS_OFF, "rad"),
            )
        )
        claims += [_arrives(result, name, joint, springs, origin) for joint in JOINTS]
    return claims


def _arrives(result: Result, name: str, joint: str, springs: str, origin: Evidence) -> Claim:
    """Claim that the link settles on the reference, or, if its springs are too weak, that friction holds it elsewhere."""
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
            text=f"{name}, {joint}: the link settles on the reference ({springs})",
            quantity="link at the end",
            measured=float(np.mean(series.link_position[-200:])),
            bound=near(GOAL, band + MOTORS_OFF, "rad"),
        )
    return Claim(
        origin="theory" if origin == "paper" else origin,
        text=f"{name}, {joint}: the link stops short only where its springs give less than the joint's friction ({springs})",
        quantity="torque of the springs at the end",
        measured=abs(float(np.mean(series.link_torque[-200:]))),
        bound=at_most(FRICTION, "N m"),
    )


def _faster(results: Mapping[str, Result]) -> list[Claim]:
    return [
        Claim(
            origin="theory",
            text=f"the stiff {joint} swings faster than the soft one",
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
    """Settling time: time after the step at which the link enters, for good, a band of 5 % about its final position, s."""
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
    headings = ("", "end (rad)", "stiffness (N m/rad)", "beyond 0.8 rad", "swings beyond 2 %", "within 5 % after (s)")
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
                text=f"the stiff {joint} no longer rings as in the paper's simulation (default springs)",
                quantity="swings beyond 2 %, with - without",
                measured=float(_swings(default["stiff"], joint) - _swings(nominal["stiff"], joint)),
                bound=below(0.0),
            ),
            Claim(
                origin="beyond",
                text=f"the stiff {joint} settles sooner, as the real arm does (default springs)",
                quantity="settling time with / without",
                measured=after / before,
                bound=below(0.8),
            ),
        ]
    return FigurePart(
        title="What the paper could not show: damping that changes with the preset",
        text="The authors explain the stiff simulation's ringing by a damping that stays fixed, where the real "
        "joint's grows with the preset. "
        f"The same steps with an added damping ratio of {RATIO} at each moment's stiffness and each joint's inertia.",
        claims=tuple(claims),
        tables=(_table({f"default {name}": run for name, run in default.items()} | alterego),),
        pictures=(
            _picture(
                "figure_12_nominal_damped",
                "Default springs, with damping that grows with the stiffness: the ringing is gone.",
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
    paper="Two joints step by 0.8 rad without gravity in the way. Links and equilibria reach the reference in both "
    "presets; the stiff simulation oscillates more than the real arm, since its damping does not change with the preset.",
    parts=parts,
    cost=4.0,
)
