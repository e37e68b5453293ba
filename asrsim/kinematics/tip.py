"""Actual and desired pose of the tip, which is the point that a Cartesian task moves."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from asrsim.kinematics.path import PoseTrajectory
from asrsim.robot.dynamics import robot_model
from asrsim.robot.poses import frame
from asrsim.samples import TIP, TIP_GOAL, Array, Samples
from asrsim.scenario.starts import start_positions

if TYPE_CHECKING:
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario


class TipPoses:
    """Function object that adds the actual and the desired pose of the tip to samples, as two bodies of the log."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        """scenario: scenario with a task; robot: robot of the scenario."""
        task = scenario.task
        if task is None:
            raise ValueError("the scenario has no task")
        self._task = task
        self._model = robot_model(scenario, robot)
        start = np.array([*start_positions(scenario, robot).values()])
        self._path = PoseTrajectory.through(task.poses, task.interpolation, self._tip(start, None))

    def _tip(self, positions: Array, base: Array | None) -> tuple[Array, Array]:
        """Position (..., 3) in m and rotation (..., 3, 3) of the task's point."""
        return self._model.pose(positions, self._task.link, self._task.point, base)

    def goals(self, time: Array) -> Array:
        """Desired positions (n, 3) of the tip at `time` (n,) in s, m."""
        return self._path.at(time)[0]

    def added(self, samples: Samples) -> Samples:
        """Samples with the bodies `tip` and `tip_goal`. If the orientation is free, the goal has the orientation of the tip."""
        root = self._model.robot.root.name
        base = _frames(samples.bodies[root]) if root in samples.bodies else None
        position, rotation = self._tip(samples.values["link_position"], base)
        goal, turned = self._path.at(samples.time)
        poses = {TIP: _row(position, rotation), TIP_GOAL: _row(goal, rotation if turned is None else turned)}
        return replace(samples, bodies={**samples.bodies, **poses})


def _row(position: Array, rotation: Array) -> Array:
    """Poses (n, 7): position in m, orientation as quaternion x, y, z, w."""
    from scipy.spatial.transform import Rotation

    return np.concatenate([position, Rotation.from_matrix(rotation).as_quat()], axis=1)


def _frames(rows: Array) -> Array:
    """Frames (n, 4, 4) of poses (n, 7)."""
    from scipy.spatial.transform import Rotation

    return frame(rows[:, :3], Rotation.from_quat(rows[:, 3:]).as_matrix())
