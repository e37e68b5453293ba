"""The learning as a picture like the paper's figure 15: error against iteration, trajectories, learned inputs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asrsim.errors import OutputError
from asrsim.learning.iterate import LearningProblem, LearningResult
from asrsim.learning.settings import LearningSettings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def learning_figure(problem: LearningProblem, result: LearningResult, settings: LearningSettings) -> Figure:
    """Left: errors over the iterations (2-norm and each joint's largest); right: every joint's trajectories, faint to dark."""
    from matplotlib.figure import Figure

    joints = problem.joints
    figure = Figure(figsize=(10.0, 1.2 + 2.6 * len(joints)), layout="constrained")
    grid = figure.add_gridspec(len(joints), 2, width_ratios=(1.0, 1.4))
    left = figure.add_subplot(grid[:, 0])
    numbers = [trial.number for trial in result.trials]
    left.semilogy(numbers, [trial.norm for trial in result.trials], "o-", color="black", label=r"largest $\|e\|_2$")
    predicted = [np.nan if trial.predicted is None else trial.predicted for trial in result.trials]
    norms = np.array([np.nan, *(trial.norm for trial in result.trials[:-1])]) * np.array(predicted)
    if np.isfinite(norms).any():
        left.semilogy(numbers, norms, "x", color="grey", label="as the model predicted")
    for column, joint in enumerate(joints):
        left.semilogy(numbers, [trial.largest[column] for trial in result.trials], ".--", label=f"largest |e|, {joint}")
    left.axhline(settings.tolerance, color="tab:red", linewidth=0.8, label="tolerance")
    left.set(xlabel="iteration", ylabel="error [rad]")
    left.legend(fontsize="small")
    for row, joint in enumerate(joints):
        axis = figure.add_subplot(grid[row, 1])
        axis.fill_between(
            problem.time,
            problem.reference[:, row] - settings.tolerance,
            problem.reference[:, row] + settings.tolerance,
            color="tab:red",
            alpha=0.12,
            linewidth=0,
            label="tolerance",
        )
        for trial in result.trials:
            shade = 0.15 + 0.85 * (trial.number + 1) / len(result.trials)
            label = r"$q$" if trial is result.trials[-1] else None
            axis.plot(problem.time, trial.outputs[:, row], color="tab:orange", alpha=shade, linewidth=1.0, label=label)
        axis.plot(problem.time, problem.reference[:, row], "k--", linewidth=1.0, label="desired")
        axis.plot(problem.time, result.inputs[:, row], color="tab:blue", linewidth=1.0, label=r"learned $\theta_{eq}$")
        axis.set(ylabel=f"{joint} [rad]", xlabel="time [s]" if row == len(joints) - 1 else "")
        axis.legend(fontsize="small", loc="upper left")
    return figure


def write_figure(path: Path, problem: LearningProblem, result: LearningResult, settings: LearningSettings) -> None:
    """Write the picture; the suffix says the format. Raises OutputError where it cannot be written."""
    try:
        learning_figure(problem, result, settings).savefig(path, dpi=150)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}") from error
