"""Figure 8 with losses that the paper's has not: joint friction, and damping that grows with the stiffness."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from asrsim.reproduce.claim import Claim
from asrsim.reproduce.figure import Part, Table
from asrsim.reproduce.friction import with_joint_losses
from asrsim.reproduce.law import RATIO, damping_overrides
from asrsim.reproduce.step_cases import CASES, RESIDUAL, expected, label_of

if TYPE_CHECKING:
    from asrsim.api import Result
    from asrsim.reproduce.lab import Lab

DAMPING, FRICTION = 0.065, 0.025
"""N m s/rad, N m: the joint's losses that the paper gives from its section 4.2 on."""


def with_friction(lab: Lab) -> Part:
    """All cases with the joint's losses of section 4.2: they must rest within what friction can hold."""
    from asrsim.robot import load_robot

    claims, rows = [], []
    for name, variant in CASES:
        robot = load_robot(lab.scenario(f"step_1dof_{name}", variant).robot)
        robot = with_joint_losses(robot, damping=DAMPING, friction=FRICTION)
        result = lab.run(f"step_1dof_{name}", variant, robot=robot, log=False)
        wanted = expected(result)
        end = float(result["joint_1"].link_position[-1])
        label = label_of((name, variant))
        claims.append(
            Claim(
                figure=8,
                origin="theory",
                text=f"{label}, with friction, rests within what friction can hold",
                quantity="rest outside of the friction band",
                measured=wanted.outside(end),
                comparison="<=",
                value=RESIDUAL,
                unit="rad",
            )
        )
        band = f"{wanted.lowest - wanted.position:+.2e} … {wanted.highest - wanted.position:+.2e}"
        rows.append((label, f"{end:.6f}", f"{end - wanted.position:+.2e}", band))
    return Part(
        title="With the joint friction of section 4.2",
        text=f"The same steps with damping {DAMPING} N m s/rad and friction {FRICTION} N m, which the paper gives for its "
        "later experiments: a link may stop wherever friction outweighs what spring and gravity leave over.",
        claims=tuple(claims),
        tables=(
            Table(
                caption="Rest and friction band",
                headings=("", "rest (rad)", "rest - frictionless (rad)", "friction band (rad)"),
                rows=tuple(rows),
            ),
        ),
    )


def with_growing_damping(lab: Lab, results: dict[tuple[str, str], Result]) -> Part:
    """All cases with link damping that grows with the stiffness: they must rest where they did."""
    claims, rows = [], []
    for (name, variant), plain in results.items():
        damped = lab.run(f"step_1dof_{name}", variant, overrides=damping_overrides(plain), label=f"{variant}_damped", log=False)
        before, after = (float(np.max(run["joint_1"].link_position)) for run in (plain, damped))
        off = float(damped["joint_1"].link_position[-1] - plain["joint_1"].link_position[-1])
        label = label_of((name, variant))
        rows.append((label, f"{before:.3f}", f"{after:.3f}", f"{off:+.1e}"))
        claims.append(
            Claim(
                figure=8,
                origin="beyond",
                text=f"damping that grows with the stiffness leaves {label} at rest where it was",
                quantity="rest with - rest without",
                measured=off,
                comparison="==",
                value=0.0,
                tolerance=RESIDUAL,
                unit="rad",
            )
        )
    headings = ("", "largest position (rad)", "with growing damping", "rest moves by (rad)")
    return Part(
        title="With link damping that grows with the stiffness",
        text=f"The same steps with an added damping ratio of {RATIO} at each moment's stiffness.",
        claims=tuple(claims),
        tables=(Table(caption="First swing", headings=headings, rows=tuple(rows)),),
    )
