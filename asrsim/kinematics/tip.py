"""Actual and desired pose of the point that a Cartesian task moves, the tip."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from asrsim.kinematics.path import PoseTrajectory
from asrsim.robot.chain import Chain, Pose
from asrsim.samples import TIP, TIP_GOAL, Array, Samples
from asrsim.scenario.data import for_joint

if TYPE_CHECKING:
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario


class TipPoses:
    """Function object that adds the actual and the desired pose of the tip to samples, as two bodies of the log."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        """The scenario must have a task."""
        task = scenario.task
        if task is None:
            raise ValueError("the scenario has no task")
        self._task = task
        self._chain = Chain(robot=robot, base_position=scenario.base_position, base_rpy=scenario.base_rpy)
        start = {
            joint.name: np.array([float(for_joint(scenario.initial_positions, joint.name, 0.0))])
            for joint in robot.moving_joints
        }
        position, rotation = self._tip(start, None)
        self._path = PoseTrajectory.through(task.poses, task.interpolation, (position[0], rotation[0]))

    def _tip(self, positions: dict[str, Array], base: Pose | None) -> tuple[Array, Array]:
        """Position (n, 3) in m and rotation (n, 3, 3) of the task's point."""
        rotation, position = self._chain.poses(positions, base)[self._task.link]
        return position + rotation @ np.array(self._task.point), rotation

    def added(self, samples: Samples) -> Samples:
        """Samples with the bodies `tip` and `tip_goal`. If the orientation is free, the goal has the orientation of the tip."""
        table = dict(zip(samples.joints, samples.values["link_position"].T, strict=True))
        root = self._chain.robot.root.name
        position, rotation = self._tip(table, _pose(samples.bodies[root]) if root in samples.bodies else None)
        goal, turned = self._path.at(samples.time)
        poses = {TIP: _row(position, rotation), TIP_GOAL: _row(goal, rotation if turned is None else turned)}
        return replace(samples, bodies={**samples.bodies, **poses})


def _row(position: Array, rotation: Array) -> Array:
    """Poses (n, 7): position in m, orientation as quaternion x, y, z, w."""
    from scipy.spatial.transform import Rotation

    return np.concatenate([position, Rotation.from_matrix(rotation).as_quat()], axis=1)


def _pose(rows: Array) -> Pose:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(rows[:, 3:]).as_matrix()), rows[:, :3]
