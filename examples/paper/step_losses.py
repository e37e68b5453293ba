"""Figure 8 with losses that the paper leaves out: joint friction, and damping that grows with the stiffness."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from asrsim.reproduce import Claim, FigurePart, FigureTable, at_most, near
from paper.friction import with_joint_losses
from paper.law import RATIO, damping_overrides
from paper.ringing import fit_ringing
from paper.statics import AT, RESIDUAL, SPRINGS, label_of, losses, rest

if TYPE_CHECKING:
    from asrsim import Result
    from paper.lab import Lab

DAMPING, FRICTION = 0.065, 0.025
"""Damping (N m s/rad) and friction (N m) of a joint, as the paper gives them from section 4.2 on."""
SLOW = (("awas_ii", "soft"), ("qbmove", "soft"), ("qbmove", "stiff"))
"""Cases whose motion is slow enough for finite differences over 1 ms."""
SWINGING = tuple(case for case in SPRINGS if case not in (("awas_ii", "stiff"), ("qbmove", "soft")))
"""Cases whose oscillations are weakly damped, and slow enough for samples at 1 ms."""


def with_friction(lab: Lab) -> FigurePart:
    """All cases with the losses of section 4.2. Links must rest where friction can hold them, and have the given losses."""
    from asrsim.robot import load_robot

    claims, rows = [], []
    for case in SPRINGS:
        name, variant = case
        robot = load_robot(lab.scenario(f"step_1dof_{name}", variant).robot)
        robot = with_joint_losses(robot, damping=DAMPING, friction=FRICTION)
        result = lab.run(f"step_1dof_{name}", variant, robot=robot, log=False)
        wanted = rest(case, damping=DAMPING, friction=FRICTION)
        link = result["joint_1"].link_position
        end, label = float(link[-1]), label_of(case)
        claims.append(
            Claim(
                origin="theory",
                text=f"{label}, with friction: the link rests where friction can hold it",
                quantity="distance of the rest position from the range in which friction holds the link",
                measured=wanted.outside(end),
                bound=at_most(RESIDUAL, "rad"),
            )
        )
        if case in SLOW:
            found = losses(case, link[result.time > AT], result.run.scenario.step)
            claims += [
                Claim(
                    origin="theory",
                    text=f"{label}: the {what} that is fitted to the motion is right",
                    quantity=f"{what}, fitted by Newton's law",
                    measured=measured,
                    bound=near(value, 0.05 * value, unit),
                )
                for what, measured, value, unit in (
                    ("damping", found.damping, DAMPING, "N m s/rad"),
                    ("friction", found.friction, FRICTION, "N m"),
                )
            ]
        band = f"{wanted.lowest - wanted.position:+.2e} … {wanted.highest - wanted.position:+.2e}"
        rows.append((label, f"{end:.6f}", f"{end - wanted.position:+.2e}", band))
    return FigurePart(
        title="With the joint friction of section 4.2",
        text=f"The same steps, with the damping of {DAMPING} N m s/rad and the friction of {FRICTION} N m that the paper "
        "states for its later experiments. A link may rest wherever the torques of spring and gravity differ by less than the "
        "friction. For joints that are slow compared with the step of 1 ms, damping and friction are fitted to the motion.",
        claims=tuple(claims),
        tables=(
            FigureTable(
                caption="Rest positions, and the ranges in which friction holds the links",
                headings=("", "rest position (rad)", "minus rest without friction (rad)", "range of friction (rad)"),
                rows=tuple(rows),
            ),
        ),
    )


def with_growing_damping(lab: Lab, results: dict[tuple[str, str], Result]) -> FigurePart:
    """Cases with link damping that grows with the stiffness. Their oscillations must decay as the law predicts."""
    claims, rows = [], []
    for case, plain in results.items():
        name, variant = case
        damped = lab.run(f"step_1dof_{name}", variant, overrides=damping_overrides(plain), label=f"{variant}_damped", log=False)
        before, after = (float(np.max(run["joint_1"].link_position)) for run in (plain, damped))
        off = float(damped["joint_1"].link_position[-1] - plain["joint_1"].link_position[-1])
        label, undamped = label_of(case), rest(case)
        grown = undamped.damping + 2.0 * RATIO * math.sqrt(undamped.inertia * undamped.spring)
        wanted = grown / (2.0 * undamped.inertia)
        found = fit_ringing(damped.time, damped["joint_1"].link_velocity, start=AT).decay
        rows.append((label, f"{before:.3f}", f"{after:.3f}", f"{found:.4g}", f"{wanted:.4g}", f"{off:+.1e}"))
        if case in SWINGING:
            claims.append(
                Claim(
                    origin="beyond",
                    text=f"{label}: damping of the file and damping ratio {RATIO} together determine the decay",
                    quantity="decay rate of the last oscillations",
                    measured=found,
                    bound=near(wanted, 0.02 * wanted, "1/s"),
                )
            )
    headings = (
        "",
        "largest position (rad)",
        "with growing damping",
        "decay rate (1/s)",
        "predicted",
        "change of the rest position (rad)",
    )
    return FigurePart(
        title="With link damping that grows with the stiffness",
        text=f"The same steps, with an additional damping that has the damping ratio {RATIO} at the present stiffness.",
        claims=tuple(claims),
        tables=(FigureTable(caption="First swing and decay", headings=headings, rows=tuple(rows)),),
    )
