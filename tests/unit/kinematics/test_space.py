"""Trajectories and inverse kinematics in space, where turns do not commute."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from asrsim.kinematics import PoseTrajectory, follow
from asrsim.kinematics.path import INTERPOLATIONS
from asrsim.robot.poses import roll_pitch_yaw
from asrsim.scenario.data import CartesianPose

POSES = (
    CartesianPose(time=1.0, position=(0.3, 0.1, 0.2), rpy=(0.4, -0.3, 1.2)),
    CartesianPose(time=1.8, position=(0.2, 0.2, 0.3), rpy=(-0.5, 0.6, 0.7)),
    CartesianPose(time=3.0, position=(0.25, 0.0, 0.4), rpy=(0.9, 0.2, -0.4)),
)
START = (np.array([0.35, 0.05, 0.25]), (0.1, 0.5, 0.9))
AXES = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]], dtype=float)
OFFSETS = np.array([[0, 0, 0.2], [0, 0, 0], [0, 0, 0.3], [0.25, 0, 0], [0, 0, 0], [0.08, 0, 0]], dtype=float)


@dataclass
class SixJoints:
    """An arm with a wrist: each joint turns what follows about its axis."""

    joints: tuple[str, ...] = tuple("abcdef")
    links: tuple[str, ...] = ("tool",)
    lower: np.ndarray = field(default_factory=lambda: np.full(6, -np.pi))
    upper: np.ndarray = field(default_factory=lambda: np.full(6, np.pi))

    def frames(self, positions):
        place, turned, frames = np.zeros(3), np.eye(3), []
        for axis, offset, angle in zip(AXES, OFFSETS, positions, strict=True):
            place = place + turned @ offset
            frames.append((place, turned @ axis))
            turned = turned @ Rotation.from_rotvec(angle * axis).as_matrix()
        return frames, place, turned

    def pose(self, positions, link, point):
        _, place, turned = self.frames(positions)
        return place + turned @ np.asarray(point), turned

    def jacobian(self, positions, link, point):
        frames, place, turned = self.frames(positions)
        tip = place + turned @ np.asarray(point)
        return np.array([[*np.cross(axis, tip - origin), *axis] for origin, axis in frames]).T

    def gravity_torques(self, positions):
        return np.zeros(6)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_orientations_between_poses_follow_the_great_circle(interpolation):
    begin = Rotation.from_euler("xyz", START[1])
    trajectory = PoseTrajectory.through(POSES, interpolation, (START[0], begin.as_matrix()))
    times = [0.0, *(pose.time for pose in POSES)]
    turns = Rotation.concatenate([begin, *(Rotation.from_euler("xyz", pose.rpy) for pose in POSES)])
    places = [START[0], *(np.array(pose.position) for pose in POSES)]
    for i in range(3):
        share = np.linspace(0.0, 1.0, 9)
        positions, rotations = trajectory.at(times[i] + share * (times[i + 1] - times[i]))
        way = INTERPOLATIONS[interpolation](share)
        assert positions == pytest.approx(np.outer(1 - way, places[i]) + np.outer(way, places[i + 1]), abs=1e-12)
        assert rotations == pytest.approx(Slerp([0.0, 1.0], turns[i : i + 2])(way).as_matrix(), abs=1e-12)
    _, beyond = trajectory.at(np.array([-1.0, 9.0]))
    assert beyond == pytest.approx(turns[[0, -1]].as_matrix(), abs=1e-12)


def test_an_arm_of_six_joints_reaches_the_orientation():
    model, point = SixJoints(), (0.05, 0.02, -0.01)
    start = np.array([0.3, 0.4, 0.6, -0.5, 1.1, 0.2])
    knots = {1.0: (0.6, 0.2, 0.9, -0.1, 0.9, 0.7), 1.8: (-0.1, 0.5, 0.5, -0.6, 1.3, -0.4), 3.0: (0.3, 0.6, 0.4, 0.2, 1.0, -0.9)}
    poses = []
    for time, angles in knots.items():
        place, turned = model.pose(np.array(angles), "tool", point)
        poses.append(CartesianPose(time=time, position=tuple(map(float, place)), rpy=roll_pitch_yaw(turned)))
    trajectory = PoseTrajectory.through(tuple(poses), "minimum_jerk", model.pose(start, "tool", point))
    worst = []
    for step in (4e-3, 2e-3):
        time = np.arange(0.0, 3.3, step)
        path = follow(model, "tool", point, trajectory, start, time, damping=1e-5)
        wanted, rotations = trajectory.at(time)
        reached = [model.pose(q, "tool", point) for q in path.positions]
        error = np.array([np.r_[p - w, (r - m).ravel()] for (p, r), w, m in zip(reached, wanted, rotations, strict=True)])
        worst.append(np.abs(error).max())
        # Away from singular postures, only one posture near the previous posture has the pose.
        assert path.positions[-1] == pytest.approx(knots[3.0], abs=1e-6)
        # Matrices of two rotations with an angle between them differ by 2 sqrt(2) sin(angle / 2).
        chord = 2.0 * np.sqrt(2.0) * np.sin(0.5 * path.orientation_error)
        assert path.position_error == pytest.approx(np.linalg.norm(error[:, :3], axis=1), abs=1e-12)
        assert chord == pytest.approx(np.linalg.norm(error[:, 3:], axis=1), abs=1e-12)
    assert worst[0] < 1e-3
    assert worst[0] / worst[1] == pytest.approx(2.0, rel=0.1)
