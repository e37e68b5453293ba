"""Figure 13: a sinusoid in both joints of a vertical arm: gravity against soft and stiff springs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from asrsim.reproduce import Claim, Evidence, FigurePart, FigureTable, PaperFigure, below, near
from paper.lab import Lab
from paper.law import RATIO, damping_overrides
from paper.motors import qbmove_claims
from paper.newton import hanging
from paper.pictures import joints_figure, picture

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from asrsim import Result
    from asrsim.samples import Array

SCENARIO, JOINTS, PRESETS, AMPLITUDE = "sine_2dof", ("joint_1", "joint_2"), ("soft", "stiff"), 0.8
EXPECTED = {("soft", "joint_1"): 0.58, ("soft", "joint_2"): 0.65, ("stiff", "joint_1"): 0.785, ("stiff", "joint_2"): 0.794}
"""Amplitudes in an independent simulation of the arm, rad."""


def parts(folder: Path) -> tuple[FigurePart, ...]:
    """Parts of the figure: the arm as in the paper, and with damping that grows with the stiffness."""
    lab = Lab(folder)
    results = lab.pairs(SCENARIO, PRESETS)
    first = FigurePart(
        title="0.8 sin(0.8 t) under gravity",
        text="The arm of figure 12 hangs down. It is in mode 6 and has AlterEgo's springs.",
        claims=(
            *_claims(results),
            *qbmove_claims(results, hanging),
        ),
        tables=(_table(results),),
        pictures=(
            picture(
                "figure_13",
                "Links (solid) and equilibria (dashed) of the two joints, soft and stiff.",
                lambda: joints_figure(results, ("link", "deflection")),
            ),
        ),
    )
    damped = {
        name: lab.run(SCENARIO, name, overrides=damping_overrides(result), label=f"{name}_damped")
        for name, result in results.items()
    }
    second = FigurePart(
        title="With link damping that grows with the stiffness",
        text=f"The same sinusoid, with an additional damping that has the damping ratio {RATIO} at the present stiffness. "
        "Springs and weight determine the sag, so damping does not change it.",
        claims=tuple(_sags(damped, "beyond")),
        tables=(_table(damped),),
    )
    return first, second


def _amplitude(values: Array) -> float:
    return 0.5 * float(np.ptp(values))


def _claims(results: Mapping[str, Result]) -> list[Claim]:
    claims = []
    for name in PRESETS:
        for joint in JOINTS:
            series = results[name][joint]
            claims.append(
                Claim(
                    text=f"{name}, {joint}: the equilibrium tracks the reference",
                    quantity="amplitude of the equilibrium",
                    measured=_amplitude(series.equilibrium_position),
                    bound=near(AMPLITUDE, 0.015, "rad"),
                )
            )
    claims += _sags(results, "paper")
    for (name, joint), value in EXPECTED.items():
        claims.append(
            Claim(
                origin="simulation",
                text=f"{name}, {joint}: the link has the amplitude that an independent simulation of the same arm gives",
                quantity="amplitude of the link",
                measured=_amplitude(results[name][joint].link_position),
                bound=near(value, 0.015, "rad"),
            )
        )
    return claims


def _sags(results: Mapping[str, Result], origin: Evidence) -> list[Claim]:
    claims = []
    for joint in JOINTS:
        share = {name: _amplitude(results[name][joint].link_position) / AMPLITUDE for name in PRESETS}
        claims += [
            Claim(
                origin=origin,
                text=f"the soft {joint} does not reach its reference, because of gravity",
                quantity="amplitude of the link / of the reference",
                measured=share["soft"],
                bound=below(0.9),
            ),
            Claim(
                origin=origin,
                text=f"the stiff {joint} tracks the reference",
                quantity="amplitude of the link / of the reference",
                measured=share["stiff"],
                bound=near(1.0, 0.03),
            ),
        ]
    return claims


def _table(results: Mapping[str, Result]) -> FigureTable:
    rows = []
    for name, result in results.items():
        for joint in JOINTS:
            series = result[joint]
            error = series.reference_1 - series.link_position
            rows.append(
                (
                    f"{name}, {joint}",
                    f"{_amplitude(series.link_position):.4f}",
                    f"{_amplitude(series.equilibrium_position):.4f}",
                    f"{np.max(np.abs(error)):.3f}",
                    f"{np.sqrt(np.mean(error**2)):.3f}",
                    f"{np.max(np.abs(series.reference_1 - series.equilibrium_position)):.3f}",
                )
            )
    headings = (
        "",
        "amplitude, link (rad)",
        "equilibrium (rad)",
        "largest error, link (rad)",
        "rms",
        "largest error, equilibrium (rad)",
    )
    return FigureTable(caption="The sinusoid in numbers", headings=headings, rows=tuple(rows))


FIGURE = PaperFigure(
    number=13,
    title="A sinusoid of a vertical arm",
    section="4.2.2",
    paper="The reference of the two joints is 0.8 sin(0.8 t), under gravity. The equilibrium tracks the reference with the two "
    "presets. The stiff link also tracks the reference, but the soft link does not, since its springs yield to the weight.",
    parts=parts,
    cost=6.0,
)
