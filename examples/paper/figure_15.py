"""Figure 15: iterative learning of a vertical arm, and a test on perturbed plants in place of the hardware test."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

import asrsim
from asrsim.reproduce import Claim, FigurePart, FigureTable, PaperFigure, above, at_most, below, near
from paper.lab import Lab
from paper.newton import IDENTIFIED, hanging, motion_claims
from paper.pictures import films, picture

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from asrsim.learning.plant import Plant
    from asrsim.learning.session import LearningSession
    from asrsim.samples import Samples

SCENARIO = "ilc_2dof"
GOAL, TOLERANCE = 0.8, 0.08
"""Final position of the paper's motion, and largest error at which the paper calls the motion learned, rad."""
DRAWS = 16
"""Number of perturbed plants on which the learned input is played."""


def parts(folder: Path) -> tuple[FigurePart, ...]:
    """Parts of the figure: learning as in the paper, and a test on perturbed plants in place of the hardware."""
    lab = Lab(folder)
    session, log = _session(lab)
    result, joints = session.result, session.prepared.plant.joints
    rows = tuple(
        (
            str(trial.number),
            *(f"{value:.4f}" for value in trial.largest),
            f"{trial.norm:.4f}",
            "" if before is None else f"{trial.norm / before.norm:.3f}",
        )
        for before, trial in zip((None, *result.trials), result.trials, strict=False)
    )
    headings = (
        "iteration",
        *(f"largest error, {joint} (rad)" for joint in joints),
        "largest 2-norm (rad)",
        "ratio",
    )
    drawn = picture(
        "figure_15",
        "Errors over the iterations; trajectories and inputs from the first iteration (faint) to the last.",
        lambda: _figure(session),
    )
    strip = films(log, "figure_15_film", "The arm with the learned input.")
    first = FigurePart(
        title="Learning 0 to 0.8 rad in 20 s",
        text="Equation 13 has the gain K = 0.5 exp(-n / 10); the first input is zero, and the preset is 0.2 rad. The springs "
        "are the identified springs. The text of the paper exchanges their labels a and k; with the values as printed, "
        "learning never converges. The last column shows the ratio of each 2-norm to the 2-norm of the previous iteration.",
        claims=tuple(_claims(session, log)),
        tables=(FigureTable(caption="Errors over the iterations", headings=headings, rows=rows),),
        pictures=(drawn, *strip),
    )
    return first, _hardware(session)


def _session(lab: Lab) -> tuple[LearningSession, Path]:
    """Learning session, and log of a run with the learned input."""
    from asrsim.learning import learn

    folder = lab.folder / f"{SCENARIO}_learned"
    session, played = learn(lab.scenario(SCENARIO), folder, picture=False, overwrite=True), folder / "played"
    asrsim.run(folder / "learned.yaml", out=played)
    return session, played / "log.mcap"


def _claims(session: LearningSession, log: Path) -> list[Claim]:
    from asrsim.log import open_log

    result = session.result
    norms = [trial.norm for trial in result.trials]
    last = open_log(log).read(quantities=["link_position", "motor_1_position", "motor_2_position"]).samples
    return [
        Claim(
            text="learning converges after 11 iterations",
            quantity="iterations",
            measured=float(result.iterations) if result.converged else float("nan"),
            bound=near(11.0, 1.0),
        ),
        Claim(
            text="with the learned input, the two joints stay within 0.08 rad of the minimum-jerk motion",
            quantity="largest error of the two joints in the log of the last run",
            measured=_error(last),
            bound=at_most(TOLERANCE, "rad"),
        ),
        Claim(
            text="the error falls in every iteration",
            quantity="largest ratio of the errors of two successive iterations",
            measured=max((after / before for before, after in pairwise(norms)), default=float("nan")),
            bound=below(1.0),
        ),
        *motion_claims({"with the learned input": last}, hanging, IDENTIFIED),
    ]


def _error(samples: Samples) -> float:
    """Largest error of the last trial, rad: the positions in its log minus the closed form of the desired motion.

    Learning uses neither this log nor this closed form.
    """
    s = samples.time / samples.time[-1]
    wanted = GOAL * (10 * s**3 - 15 * s**4 + 6 * s**5)
    return float(np.max(np.abs(samples.values["link_position"] - wanted[:, None])))


def _hardware(session: LearningSession) -> FigurePart:
    plant, joints = session.prepared.plant, session.prepared.problem.joints
    outputs = [_other(plant, number).outputs(session.result.inputs) for number in range(DRAWS)]
    largest = np.array([np.abs(plant.reference - one).max(axis=0) for one in outputs])
    worst = largest.max(axis=1)
    quantiles = np.quantile(worst, (0.05, 0.5, 0.95))
    rows = (
        ("plants", str(DRAWS)),
        ("within the tolerance", f"{100 * np.mean(worst <= TOLERANCE):.0f} %"),
        ("largest error, 5 / 50 / 95 % of plants (rad)", " / ".join(f"{value:.3f}" for value in quantiles)),
        *(
            (f"largest error of {joint}, median (rad)", f"{np.median(column):.3f}")
            for joint, column in zip(joints, largest.T, strict=True)
        ),
    )
    left = np.mean(largest > TOLERANCE, axis=0)
    claim = Claim(
        text="on perturbed plants, the first joint exceeds its tolerance more often than the second joint",
        quantity="fraction of the plants, first joint - second joint",
        measured=float(left[0] - left[1]),
        bound=above(0.25),
    )
    return FigurePart(
        title="Perturbed plants in place of the hardware test",
        text=f"The learned input is played without feedback on {DRAWS} plants that differ from the model by up to 5 % in the "
        "masses, 10 % and 5 % in the parameters k and a of the springs, and 50 % in damping and friction. Their commands are "
        "delayed by up to 20 ms. The first joint of the paper's real arm temporarily exceeded the tolerance. The first joint "
        "of most of these plants exceeds the tolerance, too.",
        claims=(claim,),
        tables=(FigureTable(caption="Errors on the perturbed plants", headings=("", ""), rows=rows),),
    )


def _other(plant: Plant, number: int) -> Plant:
    """Plant number `number`, randomly perturbed."""
    draw, robot = np.random.default_rng([1, number]), plant.prepared.robot
    numbers: dict[str, dict[str, float]] = {}
    for block in robot.actuators:
        joint, values = robot.joint(block.joint), block.values()
        changes = {"damping": joint.damping * draw.uniform(0.5, 1.5), "friction": joint.friction * draw.uniform(0.5, 1.5)}
        for name, share in {"spring_k": 0.1, "spring_a": 0.05, "motor": 0.5}.items():
            for i in (1, 2):
                key = f"{name}_{i}" if name != "motor" else f"motor_{i}_friction_torque"
                changes[key] = values[key] * draw.uniform(1.0 - share, 1.0 + share)
        numbers[block.joint] = changes
        mass = next(link.mass for link in robot.links if link.name == joint.child)
        numbers[joint.child] = {"mass": (mass or 0.0) * draw.uniform(0.95, 1.05)}
    return plant.varied(numbers, draw.uniform(0.0, 0.02))


def _figure(session: LearningSession) -> Figure:
    from asrsim.learning.figure import learning_charts
    from asrsim.plots.charts import chart_figure

    return chart_figure(learning_charts(session.prepared.problem, session.result, session.prepared.settings), width=3.3)


FIGURE = PaperFigure(
    number=15,
    title="Iterative learning control",
    section="4.3",
    paper="The equilibrium trajectories with which a vertical arm follows a minimum-jerk motion are learned in simulation. "
    "After 11 iterations, the errors of the two joints are within 0.08 rad. On the real arm, only the error of the first joint "
    "temporarily exceeds this limit.",
    parts=parts,
    cost=12.0,
)
