"""Charts of iterative learning: errors, positions and inputs over the iterations, as in figure 15 of the paper."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asrsim.learning.trial import LearningProblem, LearningResult, Trial
from asrsim.outfile import make_folder
from asrsim.plots import style
from asrsim.plots.chart import Chart, Line, Shade
from asrsim.plots.charts import save_charts
from asrsim.samples import Array
from asrsim.scenario.goals import Learning

MOST_POINTS = 1000
"""Largest number of points that are drawn for a curve."""
TOLERANCE, DESIRED, BEST = "tolerance", "desired position", "best trial"


def learning_charts(problem: LearningProblem, result: LearningResult, settings: Learning) -> list[list[Chart]]:
    """Rows of charts, one row for each joint. A row shows the errors over the iterations, and the positions and inputs of all
    trials over time. Early trials are drawn faintly.
    """
    rows = []
    for column, joint in enumerate(problem.joints):
        unit = (problem.units or ["rad"] * len(problem.joints))[column]
        rows.append(
            [_errors(problem, result, settings, column, head=joint), *_motions(problem, result, settings, column, unit=unit)]
        )
    return rows


def _errors(problem: LearningProblem, result: LearningResult, settings: Learning, column: int, *, head: str) -> Chart:
    numbers = np.array([float(trial.number) for trial in result.trials])
    norms = np.array([trial.norm for trial in result.trials])
    largest = np.array([trial.largest[column] for trial in result.trials])
    reach = (-0.3, float(numbers[-1]) + 0.3)
    known = np.concatenate([values[np.isfinite(values) & (values > 0.0)] for values in (norms, largest)])
    low, high = (float(known.min()), float(known.max())) if len(known) else (settings.tolerance, settings.tolerance)
    span = 0.6 * min(low, settings.tolerance), 1.6 * max(high, settings.tolerance)
    ends = np.array(reach)
    band = Shade(label=TOLERANCE, x=ends, low=np.full(2, span[0]), high=np.full(2, settings.tolerance), colour=style.GREEN)
    return Chart(
        words="largest error",
        unit=problem.unit,
        head=head,
        across="iteration",
        across_unit="",
        lines=[
            Line(label="norm of all joints", x=numbers, y=norms, colour=style.GREY, kind="both", dash=1, width=0.9),
            Line(label="", x=numbers, y=largest, colour=style.VERMILION, kind="both"),
        ],
        bands=[band],
        logarithmic="y",
        span=span,
        reach=reach,
    )


def _motions(problem: LearningProblem, result: LearningResult, settings: Learning, column: int, *, unit: str) -> list[Chart]:
    rows = np.unique(np.linspace(0, len(problem.time) - 1, MOST_POINTS).round().astype(int))
    time, wanted = problem.time[rows], problem.reference[rows, column]
    near = wanted - settings.tolerance, wanted + settings.tolerance
    band = Shade(label=TOLERANCE, x=time, low=near[0], high=near[1], colour=style.GREEN, opacity=0.13)
    desired = Line(label=DESIRED, x=time, y=wanted, colour=style.BLACK, dash=1, width=1.0)

    def trials(values: str, colour: str, label: str) -> list[Line]:
        def line(trial: Trial) -> Line:
            best = trial is result.best
            strength = 1.0 if best else 0.15 + 0.5 * (trial.number + 1) / len(result.trials)
            drawn: Array = getattr(trial, values)[rows, column]
            width = 1.6 if best else 0.9
            return Line(label=label if best else "", x=time, y=drawn, colour=colour, width=width, opacity=strength)

        return [line(trial) for trial in (*(trial for trial in result.trials if trial is not result.best), result.best)]

    return [
        Chart(
            words="link position",
            unit=unit,
            bands=[band],
            lines=[*trials("outputs", style.colour("link_position"), f"link position,\n{BEST}"), desired],
        ),
        Chart(
            words="learned input",
            unit=unit,
            lines=[*trials("inputs", style.BLUE, f"input, {BEST}"), desired],
        ),
    ]


def write_figure(path: Path, problem: LearningProblem, result: LearningResult, settings: Learning, *, title: str) -> None:
    """Write the picture of a learning run, in the format that the suffix of the path states. Raises OutputError if the file
    cannot be written.
    """
    make_folder(path.parent)
    save_charts(path, learning_charts(problem, result, settings), title=title, width=3.3)
