"""Figure 11: the frequency response of one joint to a chirp, soft and stiff."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from asrsim.metrics.frequency import FrequencyResponse, frequency_response
from asrsim.reproduce import Claim, FigurePart, PaperFigure, at_least, below, near
from paper.friction import held_by_friction
from paper.lab import Lab
from paper.law import RATIO, damping_overrides
from paper.motors import qbmove_claims
from paper.newton import hanging
from paper.pictures import joints_figure, picture
from paper.response import BAND, JOINT, WIDER, from_equilibrium, response, response_figure, response_table

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from asrsim import Result

SCENARIO, PRESETS = "chirp_1dof_qbmove", ("soft", "stiff")


def parts(folder: Path) -> tuple[FigurePart, ...]:
    """Parts of the figure: AlterEgo's springs, the toolbox's default springs, and damping that grows with the stiffness."""
    lab = Lab(folder)
    results = lab.pairs(SCENARIO, PRESETS)
    wide = {name: lab.run(SCENARIO, name, overrides=WIDER, label=f"{name}_wider") for name in PRESETS}
    found = {name: response(result) for name, result in wide.items()}
    pictures = (
        picture(
            "figure_11",
            "The chirp: positions of link (solid) and equilibrium (dashed) for the two presets.",
            lambda: joints_figure(results, ("link", "deflection")),
        ),
        picture(
            "figure_11_response",
            "Gain, phase and coherence from the position reference to the link position.",
            lambda: response_figure(wide),
        ),
    )
    first = FigurePart(
        title="Chirp of 0.15 rad from 0.5 to 6 Hz",
        text="A qbMove carries a second qbMove, which hangs below it. It is in mode 6 and has AlterEgo's springs, a joint "
        "damping of 0.065 N m s/rad and a joint friction of 0.025 N m. The paper does not state the law of the chirp, its "
        "duration and the load. Here the chirp is linear and lasts 20 s, and the load is one cube. Gain and phase are computed "
        "from a chirp with the same sweep rate and a slightly wider band, since the power of a chirp is small at the ends of "
        "its band.",
        claims=(
            *_of_the_sweep(wide, found),
            *_of_resonance(results, wide, found),
            *qbmove_claims(results, hanging),
        ),
        tables=(response_table(found),),
        pictures=pictures,
    )
    return first, _nominal(lab), _damped(lab, wide, found)


def _of_the_sweep(wide: Mapping[str, Result], found: Mapping[str, FrequencyResponse]) -> list[Claim]:
    """Claims about the chirp: the coherence is high with each preset, and the motors follow the chirp up to their bandwidth."""
    claims: list[Claim] = []
    for name in PRESETS:
        series, one = wide[name][JOINT], found[name]
        low, high = one.band
        motor = frequency_response(wide[name].time, series.reference_1, series.equilibrium_position, band=BAND)
        claims += [
            Claim(
                origin="theory",
                text=f"{name}: the coherence is high over the whole band of the chirp",
                quantity=f"smallest coherence, {low:.2g} to {high:.2g} Hz",
                measured=float(np.min(one.coherence)),
                bound=at_least(0.9),
            ),
            Claim(
                origin="simulation",
                text=f"{name}: the equilibrium follows the chirp up to the bandwidth of the motors",
                quantity="frequency at which the gain of the equilibrium is -3 dB",
                measured=motor.bandwidth or float("nan"),
                bound=near(4.6, 0.3, "Hz"),
            ),
        ]
    return claims


def _of_resonance(
    results: Mapping[str, Result], wide: Mapping[str, Result], found: Mapping[str, FrequencyResponse]
) -> list[Claim]:
    """Claims about the resonance of the soft joint, and about the two presets at the low end of the chirp's band."""
    through = {name: from_equilibrium(wide[name]) for name in PRESETS}
    soft = through["soft"].resonance
    peak = {name: float(np.max(np.abs(results[name][JOINT].link_position))) for name in PRESETS}
    return [
        Claim(
            origin="simulation",
            text="the soft joint has its resonance within the band of the chirp",
            quantity="frequency of the peak of the gain from equilibrium to link",
            measured=soft[0] if soft else float("nan"),
            bound=near(4.55, 0.3, "Hz"),
        ),
        Claim(
            origin="simulation",
            text="at its resonance, the soft link has a larger amplitude than its equilibrium",
            quantity="gain from equilibrium to link at the peak",
            measured=soft[1] if soft else float("nan"),
            bound=near(1.49, 0.1),
        ),
        Claim(
            text="the stiff link follows its equilibrium, since its resonance is above the band of the chirp",
            quantity="largest gain from equilibrium to link, stiff",
            measured=float(np.max(through["stiff"].gain)),
            bound=below(1.1),
        ),
        Claim(
            text="at the lowest frequency, the stiff link follows its reference",
            quantity="gain from reference to link at the lowest frequency, stiff",
            measured=float(found["stiff"].gain[0]),
            bound=near(1.0, 0.03),
        ),
        Claim(
            text="at the lowest frequency, gravity and friction reduce the amplitude of the soft link",
            quantity="gain from reference to link at the lowest frequency, soft",
            measured=float(found["soft"].gain[0]),
            bound=below(0.9),
        ),
        Claim(
            origin="simulation",
            text="the largest position of the link is about the same with the two presets",
            quantity="largest position, soft / stiff",
            measured=peak["soft"] / peak["stiff"],
            bound=near(1.09, 0.08),
        ),
    ]


def _nominal(lab: Lab) -> FigurePart:
    names = ("nominal_soft", "nominal_stiff")
    results = lab.pairs(SCENARIO, names)
    soft = results[names[0]]
    held = held_by_friction(soft)
    one = response(lab.run(SCENARIO, names[1], overrides=WIDER, log=False))
    friction = soft.run.robot.joint(JOINT).friction
    torque = float(np.max(np.abs(soft[JOINT].link_torque)))
    claims = [
        Claim(
            origin="theory",
            text="the torque of the soft springs is smaller than the friction of the joint",
            quantity=f"largest torque of the springs (friction: {friction:g} N m)",
            measured=torque,
            bound=below(friction, "N m"),
        ),
        Claim(
            origin="theory",
            text="the soft link does not move",
            quantity="amplitude of the soft link",
            measured=0.5 * float(np.ptp(soft[JOINT].link_position)),
            bound=below(1e-6, "rad"),
        ),
        Claim(
            text="the stiff link follows the chirp",
            quantity="median coherence",
            measured=float(np.median(one.coherence)),
            bound=at_least(0.9),
        ),
    ]
    text = "Friction holds no link at rest."
    if held:
        text = f"Soft preset: {'; '.join(str(item) for item in held)}. Such a joint has no frequency response."
    return FigurePart(
        title="With the toolbox's default springs",
        text=text,
        claims=tuple(claims),
        tables=(response_table({"nominal stiff": one}),),
        pictures=(
            picture(
                "figure_11_nominal",
                "The same chirp with the default springs: the soft link does not move.",
                lambda: joints_figure(results, ("link", "torque")),
            ),
        ),
    )


def _damped(lab: Lab, plain: Mapping[str, Result], before: Mapping[str, FrequencyResponse]) -> FigurePart:
    results = {
        name: lab.run(SCENARIO, name, overrides=[*WIDER, *damping_overrides(plain[name])], label=f"{name}_damped")
        for name in PRESETS
    }
    found = {name: response(result) for name, result in results.items()}
    peaks = [float(np.max(one.gain)) for one in (before["soft"], found["soft"])]
    claim = Claim(
        origin="beyond",
        text="damping that grows with the stiffness reduces the peak of the soft joint's gain",
        quantity="largest gain with / without this damping",
        measured=peaks[1] / peaks[0],
        bound=below(0.95),
    )
    return FigurePart(
        title="With link damping that grows with the stiffness",
        text=f"The same chirp, with an additional damping that has the damping ratio {RATIO} at the present stiffness.",
        claims=(claim,),
        tables=(response_table(found),),
        pictures=(
            picture(
                "figure_11_damped", "Response with damping that grows with the stiffness.", lambda: response_figure(results)
            ),
        ),
    )


FIGURE = PaperFigure(
    number=11,
    title="Frequency response of one joint",
    section="4.2.1",
    paper="A joint follows a chirp with a soft and a stiff preset. The largest positions of the link are similar with the two "
    "presets, the equilibrium follows the chirp as in the real joint, and the two presets have different bandwidths.",
    parts=parts,
    cost=4.0,
)
