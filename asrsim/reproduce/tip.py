"""Where a point of the robot went, from the link positions of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from asrsim.api import Result
    from asrsim.samples import Array

KNOTS = 400
"""Samples at which the pose is computed; between, straight lines."""


def tip_path(result: Result) -> Array:
    """(n, 3) m, world frame: the point of the run's Cartesian task at each sample. ValueError if the run has no task."""
    from asrsim.kinematics.engine_model import model_of

    run = result.run
    task = run.scenario.task
    if task is None:
        raise ValueError("the scenario has no Cartesian task")
    rows = np.unique(np.linspace(0, len(result.time) - 1, KNOTS).round().astype(int))
    with model_of(run.scenario, run.robot) as model:
        positions = np.column_stack([result[joint].link_position for joint in model.joints])
        points = np.array([model.pose(positions[row], task.link, task.point)[0] for row in rows])
    return np.column_stack([np.interp(result.time, result.time[rows], axis) for axis in points.T])
