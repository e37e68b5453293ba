"""Trajectories and inverse kinematics in space, where turns do not commute."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from asrsim.kinematics import PoseTrajectory, follow
from asrsim.kinematics.path import INTERPOLATIONS
from asrsim.robot import load_robot
from asrsim.robot.dynamics import RobotModel
from asrsim.robot.poses import roll_pitch_yaw
from asrsim.scenario.data import CartesianPose

POSES = (
    CartesianPose(time=1.0, position=(0.3, 0.1, 0.2), rpy=(0.4, -0.3, 1.2)),
    CartesianPose(time=1.8, position=(0.2, 0.2, 0.3), rpy=(-0.5, 0.6, 0.7)),
    CartesianPose(time=3.0, position=(0.25, 0.0, 0.4), rpy=(0.9, 0.2, -0.4)),
)
START = (np.array([0.35, 0.05, 0.25]), (0.1, 0.5, 0.9))
AXES = "0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"
ORIGINS = "0 0 0.2", "0 0 0", "0 0 0.3", "0.25 0 0", "0 0 0", "0.08 0 0"
"""Axes and origins of the joints of an arm with a wrist."""
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'


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


def test_an_arm_of_six_joints_reaches_the_orientation(tmp_path):
    text = '<robot name="six"><link name="link_0"/>'
    for i, (axis, origin) in enumerate(zip(AXES, ORIGINS, strict=True)):
        text += f'<joint name="joint_{i}" type="continuous"><parent link="link_{i}"/><child link="link_{i + 1}"/>'
        text += f'<origin xyz="{origin}"/><axis xyz="{axis}"/></joint><link name="link_{i + 1}">{INERTIAL}</link>'
    (tmp_path / "arm.urdf").write_text(text + "</robot>")
    model, point = RobotModel(load_robot(tmp_path / "arm.urdf")), (0.05, 0.02, -0.01)
    start = np.array([0.3, 0.4, 0.6, -0.5, 1.1, 0.2])
    knots = {1.0: (0.6, 0.2, 0.9, -0.1, 0.9, 0.7), 1.8: (-0.1, 0.5, 0.5, -0.6, 1.3, -0.4), 3.0: (0.3, 0.6, 0.4, 0.2, 1.0, -0.9)}
    poses = []
    for time, angles in knots.items():
        place, turned = model.pose(np.array(angles), "link_6", point)
        poses.append(CartesianPose(time=time, position=tuple(map(float, place)), rpy=roll_pitch_yaw(turned)))
    trajectory = PoseTrajectory.through(tuple(poses), "minimum_jerk", model.pose(start, "link_6", point))
    worst = []
    for step in (4e-3, 2e-3):
        time = np.arange(0.0, 3.3, step)
        path = follow(model, "link_6", point, trajectory, start, time, damping=1e-5)
        wanted, rotations = trajectory.at(time)
        places, turns = model.pose(path.positions, "link_6", point)
        distance = np.linalg.norm(places - wanted, axis=1)
        worst.append(max(np.abs(places - wanted).max(), np.abs(turns - rotations).max()))
        # Away from singular postures, only one posture near the previous posture has the pose.
        assert path.positions[-1] == pytest.approx(knots[3.0], abs=1e-6)
        # Matrices of two rotations with an angle between them differ by 2 sqrt(2) sin(angle / 2).
        chord = 2.0 * np.sqrt(2.0) * np.sin(0.5 * path.orientation_error)
        assert path.position_error == pytest.approx(distance, abs=1e-12)
        assert chord == pytest.approx(np.linalg.norm(turns - rotations, axis=(1, 2)), abs=1e-12)
    assert worst[0] < 1e-3
    assert worst[0] / worst[1] == pytest.approx(2.0, rel=0.1)
