"""Picture of iterative learning: errors, positions and inputs over the iterations, like the paper's figure 15."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asrsim.learning.trial import LearningProblem, LearningResult
from asrsim.outfile import make_folder
from asrsim.scenario.blocks import Learning

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_POINTS = 1000
"""Largest number of points drawn for a curve."""


def learning_figure(problem: LearningProblem, result: LearningResult, settings: Learning, title: str = "") -> Figure:
    """Figure with errors over the iterations, and positions and inputs of each joint in all iterations (early iterations
    faint).
    """
    from asrsim.plots.figures import new_figure
    from asrsim.plots.style import plain

    joints = problem.joints
    figure = new_figure(11.5, 1.0 + 2.4 * max(len(joints), 1))
    if title:
        figure.suptitle(plain(title), fontsize="medium", x=0.01, ha="left")
    grid = figure.add_gridspec(len(joints), 3, width_ratios=(1.1, 1.0, 1.0))
    _draw_errors(figure.add_subplot(grid[:, 0]), problem, result, settings)
    shared: Axes | None = None
    for row, joint in enumerate(joints):
        trajectory = figure.add_subplot(grid[row, 1], sharex=shared)
        shared = shared or trajectory
        inputs = figure.add_subplot(grid[row, 2], sharex=shared)
        _draw_joint(trajectory, inputs, problem, result, settings, row)
        trajectory.set_ylabel(f"{plain(joint)} ({(problem.units or ['rad'] * len(joints))[row]})")
        if row == 0:
            trajectory.legend(loc="best")
            inputs.legend(loc="best")
            trajectory.set_title("link position", loc="left")
            inputs.set_title("learned input", loc="left")
        if row == len(joints) - 1:
            trajectory.set_xlabel("time (s)")
            inputs.set_xlabel("time (s)")
    return figure


def _draw_errors(ax: Axes, problem: LearningProblem, result: LearningResult, settings: Learning) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator

    from asrsim.plots import style

    numbers = [trial.number for trial in result.trials]
    norms = np.array([trial.norm for trial in result.trials])
    ax.semilogy(numbers, norms, "o-", color=style.BLACK, label=r"largest $\|e\|_2$")
    for column, joint in enumerate(problem.joints):
        largest = [trial.largest[column] for trial in result.trials]
        ax.semilogy(
            numbers,
            largest,
            ".",
            linestyle="--",
            color=style.variant_colour(column),
            label=f"largest |e|, {style.plain(joint)}",
        )
    ax.axhspan(0.0, settings.tolerance, color=style.GREEN, alpha=0.13, linewidth=0, label="tolerance")
    ax.set(xlabel="iteration", ylabel=f"error ({problem.unit})")
    ax.set_title("error over the iterations", loc="left")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_formatter(FuncFormatter(lambda *_: ""))
    ax.set_xlim(-0.3, max(numbers) + 0.3)
    ax.legend(loc="best")


def _draw_joint(
    trajectory: Axes, inputs: Axes, problem: LearningProblem, result: LearningResult, settings: Learning, column: int
) -> None:
    from asrsim.plots import style

    rows = np.unique(np.linspace(0, len(problem.time) - 1, MOST_POINTS).round().astype(int))
    time, wanted = problem.time[rows], problem.reference[rows, column]
    trajectory.fill_between(
        time,
        wanted - settings.tolerance,
        wanted + settings.tolerance,
        color=style.GREEN,
        alpha=0.13,
        linewidth=0,
        label="tolerance",
    )
    for trial in (*(trial for trial in result.trials if trial is not result.best), result.best):
        last = trial is result.best
        strength = 1.0 if last else 0.15 + 0.5 * (trial.number + 1) / len(result.trials)
        for ax, values, shade, label in (
            (trajectory, trial.outputs, style.VERMILION, "$q$, best of all iterations"),
            (inputs, trial.inputs, style.BLUE, r"$\theta_{eq}$, best of all iterations"),
        ):
            width = 1.6 if last else 0.9
            ax.plot(time, values[rows, column], color=shade, alpha=strength, linewidth=width, label=label if last else None)
    for ax in (trajectory, inputs):
        ax.plot(time, wanted, "--", color=style.BLACK, linewidth=1.0, label="desired $q$")


def write_figure(path: Path, problem: LearningProblem, result: LearningResult, settings: Learning, *, title: str) -> None:
    """Write the picture of learning in the format of the suffix. Raises OutputError if it cannot be written."""
    from asrsim.plots.output import save_figure, styled

    make_folder(path.parent)
    with styled():
        save_figure(learning_figure(problem, result, settings, title), path.parent, path.stem, [path.suffix[1:]])
