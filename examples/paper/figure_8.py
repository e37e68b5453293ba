"""Figure 8: steps of four actuators, soft and stiff, against closed forms of equilibrium, frequency and decay."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from asrsim.reproduce import Claim, FigurePart, FigureTable, PaperFigure, above, below, near
from paper.lab import Lab
from paper.pictures import curves, link_panel, picture
from paper.ringing import fit_ringing
from paper.statics import ACTUATORS, AT, RESIDUAL, SPRINGS, STEP, Rest, label_of, rest
from paper.step_losses import with_friction, with_growing_damping

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from asrsim import Result

RESOLVED = 0.1
"""Largest product of angular frequency and sampling interval at which samples resolve an oscillation."""
FINE_TIME = 0.5
"""Duration of the extra run at a fine step, s."""


def parts(folder: Path) -> tuple[FigurePart, ...]:
    """Parts of the figure: all eight cases as in the paper, with the friction of section 4.2, and with growing damping."""
    lab = Lab(folder)
    results = {case: lab.run(f"step_1dof_{case[0]}", case[1]) for case in SPRINGS}
    rests = {case: rest(case) for case in SPRINGS}
    claims: list[Claim] = []
    rows = []
    for case, result in results.items():
        claims_of, row = _measure(lab, case, result, rests[case])
        claims += claims_of
        rows.append(row)
    claims += _paper(results)
    headings = (
        "",
        "rest (rad)",
        "predicted",
        "stiffness (N m/rad)",
        "frequency (Hz)",
        "predicted",
        "ω h at 1 ms",
        "substeps",
    )
    table = FigureTable(
        caption="Rest positions of the links, and natural frequencies of the last oscillations",
        headings=headings,
        rows=tuple(rows),
    )
    shown = picture(
        "figure_8",
        "Links (vermilion) and equilibria (blue) after the step: soft (top row) and stiff (bottom row).",
        lambda: _figure(results),
    )
    first = FigurePart(
        title="Steps of four actuators",
        text="The motors are ideal (mode 3), the load is 0.2 kg at 0.04 m under gravity, and the reference steps by 0.8 rad. "
        "The joints have a damping of 0.02 N m s/rad and no friction. The predicted values are closed forms with the paper's "
        "numbers; they use neither laws nor files of the simulator.",
        claims=tuple(claims),
        tables=(table,),
        pictures=(shown,),
    )
    return first, with_friction(lab), with_growing_damping(lab, results)


def _measure(lab: Lab, case: tuple[str, str], result: Result, wanted: Rest) -> tuple[list[Claim], tuple[str, ...]]:
    name, variant = case
    label = label_of(case)
    series = result["joint_1"]
    end, step = float(series.link_position[-1]), result.run.scenario.step
    omega_h = wanted.natural * step
    claims = [
        Claim(
            origin="theory",
            text=f"{label}: the link rests where its spring and gravity balance",
            quantity="rest - predicted rest",
            measured=end - wanted.position,
            bound=near(0.0, RESIDUAL, "rad"),
        ),
        Claim(
            origin="theory",
            text=f"{label}: the logged stiffness is the slope of the spring's torque",
            quantity="stiffness at rest",
            measured=float(series.stiffness[-1]),
            bound=near(wanted.spring, 1e-4 * wanted.spring, "N m/rad"),
        ),
        Claim(
            origin="theory",
            text=f"{label}: the logged energy is the work of the spring",
            quantity="change of the logged energy / change of the energy in closed form",
            measured=_energy_share(case, result),
            bound=near(1.0, 1e-3),
        ),
    ]
    sampled = result
    if omega_h > np.pi / 2:
        # At a sampling interval of 1 ms, such a frequency is aliased. A short run at a fine step resolves it.
        fine = FINE_TIME / math.ceil(FINE_TIME * wanted.natural / RESOLVED)
        sampled = lab.run(f"step_1dof_{name}", variant, overrides=[f"step={fine!r}", f"duration={FINE_TIME}"], log=False)
        claims += _right_at_one_millisecond(label, result, wanted)
    found = fit_ringing(sampled.time, sampled["joint_1"].link_velocity, start=AT)
    claims.append(
        Claim(
            origin="theory",
            text=f"{label}: the frequency of the oscillation follows from stiffness and inertia",
            quantity="natural frequency of the last oscillations",
            measured=found.frequency,
            bound=near(wanted.frequency, 0.005 * wanted.frequency, "Hz"),
        )
    )
    claims.append(
        Claim(
            origin="theory",
            text=f"{label}: only the damping of the joint makes the oscillation decay",
            quantity="decay rate of the last oscillations",
            measured=found.decay,
            bound=near(wanted.decay, 0.01 * wanted.decay, "1/s"),
        )
    )
    row = (
        label,
        f"{end:.6f}",
        f"{wanted.position:.6f}",
        f"{wanted.spring:.5g}",
        f"{found.frequency:.3f}",
        f"{wanted.frequency:.3f}",
        f"{omega_h:.2f}",
        str(result.run.resolution.substeps),
    )
    return claims, row


def _energy_share(case: tuple[str, str], result: Result) -> float:
    """Change of the logged energy / change of the closed form, while motors rest and the spring is within its limit."""
    series, spring = result["joint_1"], SPRINGS[case]
    deflection = STEP - series.link_position
    use = (result.time > AT) & (np.abs(deflection) < spring.straight)
    return float(np.polyfit(spring.energy(deflection[use]), series.spring_energy[use], 1)[0])


def _right_at_one_millisecond(label: str, result: Result, wanted: Rest) -> list[Claim]:
    """Claims about a run at 1 ms. An oscillation near the sampling rate is aliased to 1 / step minus its frequency."""
    step = result.run.scenario.step
    found = fit_ringing(result.time, result["joint_1"].link_velocity, start=AT)
    omega = np.sqrt(found.natural**2 - found.decay**2)
    turns = round(wanted.natural * step / (2.0 * np.pi))
    unfolded = float(np.hypot(turns * 2.0 * np.pi / step - omega, found.decay)) / (2.0 * np.pi)
    return [
        Claim(
            origin="theory",
            text=f"{label}: the frequency is also right with a step of {1e3 * step:g} ms, although samples at this "
            "interval alias it",
            quantity="natural frequency at 1 ms, computed from the aliased frequency",
            measured=unfolded,
            bound=near(wanted.frequency, 0.005 * wanted.frequency, "Hz"),
        ),
        Claim(
            origin="theory",
            text=f"{label}: the decay is also right with a step of {1e3 * step:g} ms",
            quantity="decay rate at 1 ms",
            measured=found.decay,
            bound=near(wanted.decay, 0.005 * wanted.decay, "1/s"),
        ),
    ]


def _paper(results: dict[tuple[str, str], Result]) -> list[Claim]:
    """Claims of the paper about its plots: soft AwAS-II and qbMove sag under gravity, stiff AwAS-II and qbMove hardly sag."""
    sag = {case: STEP - float(result["joint_1"].link_position[-1]) for case, result in results.items()}
    claims = []
    for name in ("awas_ii", "qbmove"):
        ratio = sag[name, "soft"] / sag[name, "stiff"]
        claims.append(
            Claim(
                text=f"the soft {ACTUATORS[name]} sags under gravity far more than the stiff {ACTUATORS[name]}",
                quantity="sag soft / sag stiff",
                measured=ratio,
                bound=above(5.0),
            )
        )
        claims.append(
            Claim(
                text=f"the stiff {ACTUATORS[name]} reaches its reference",
                quantity="reference - rest position",
                measured=sag[name, "stiff"],
                bound=below(0.02, "rad"),
            )
        )
    return claims


def _figure(results: dict[tuple[str, str], Result]) -> Figure:
    from asrsim.plots.figures import new_figure
    from asrsim.plots.legends import legend
    from asrsim.plots.panels import draw_panel

    figure = new_figure(12.5, 4.4)
    axes = figure.subplots(2, len(ACTUATORS), squeeze=False, sharex=True, sharey="col")
    drawn: dict[str, None] = {}
    for column, (name, title) in enumerate(ACTUATORS.items()):
        for row, variant in enumerate(("soft", "stiff")):
            ax = axes[row, column]
            runs = curves({variant: results[name, variant]}, start=0.08, end=0.5)
            drawn |= dict.fromkeys(draw_panel(ax, link_panel(), runs, "joint_1"))
            ax.set_ylabel(f"{variant}: position (rad)" if not column else "")
        axes[0, column].set_title(title, loc="left")
        axes[1, column].set_xlabel("time (s)")
    names = ("reference_position", "equilibrium_position", "link_position")
    legend(axes[0, -1], [name for name in names if name in drawn])
    return figure


FIGURE = PaperFigure(
    number=8,
    title="Step responses of four compliant actuators",
    section="4.1",
    paper="Four actuators hold a hanging weight, each with a soft and a stiff setting, and their references step by 0.8 rad. "
    "Soft AwAS-II and qbMove sag under gravity, but stiff AwAS-II and qbMove reach their references.",
    parts=parts,
    cost=5.0,
)
