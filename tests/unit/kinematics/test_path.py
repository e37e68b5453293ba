"""Inverse kinematics on a planar arm with two links, whose kinematics is known in closed form."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from asrsim.actuators import QbMove
from asrsim.errors import ScenarioError
from asrsim.kinematics import PoseTrajectory, follow, plan
from asrsim.kinematics.path import minimum_jerk
from asrsim.robot import load_robot
from asrsim.robot.dynamics import RobotModel
from asrsim.scenario.data import CartesianPose, CartesianTask
from asrsim.signals import MinimumJerk
from support.robots import drive_with, write_plain_arm

A, B = 0.3, 0.2
"""m, lengths of the two links."""
TIP = (0.0, 0.0, B)
"""Point on the last link, m."""


@pytest.fixture
def model(tmp_path):
    """Upright arm, whose joints turn about y: (x, y) of the plane are z and x of the world."""
    robot = load_robot(write_plain_arm(tmp_path, lengths=(A, B), masses=(0.6, 0.4)))
    return RobotModel(robot, base_position=(0.0, 0.0, -0.1), gravity=(0.0, 0.0, -9.81))


def elbow(x, y):
    """The closed-form solution with the second joint bent to the positive side."""
    second = math.acos((x * x + y * y - A * A - B * B) / (2 * A * B))
    return np.array([math.atan2(y, x) - math.atan2(B * math.sin(second), A + B * math.cos(second)), second])


def line(*poses):
    return tuple(CartesianPose(time=time, position=(y, 0.0, x)) for time, x, y in poses)


def qbmove(joint, mode=3, **changes):
    return drive_with(QbMove, mode=mode, joint=joint, spring=(11.0, 0.02, 11.0, 0.02, 0.8), **changes)


def test_the_loop_tracks_the_closed_form_solution(model):
    trajectory = PoseTrajectory.through(line((0.0, 0.35, 0.1), (2.0, 0.2, 0.3)), "minimum_jerk")
    time = np.arange(0, 2.5, 2e-3)
    path = follow(model, "link_2", TIP, trajectory, elbow(0.35, 0.1), time)
    wanted, _ = trajectory.at(time)
    exact = np.array([elbow(x, y) for y, _, x in wanted])
    assert np.abs(path.positions - exact).max() < 1e-4
    assert path.position_error.max() < 5e-5
    assert np.allclose(path.positions[-1], elbow(0.2, 0.3), atol=1e-9)


def test_an_initial_error_decays_with_the_gain(model):
    trajectory = PoseTrajectory.through(line((0.0, 0.35, 0.1)), "minimum_jerk")
    time = np.arange(0, 1.0, 1e-3)
    path = follow(model, "link_2", TIP, trajectory, elbow(0.349, 0.1), time, gain=5.0, damping=1e-6)
    assert np.allclose(path.position_error, 1e-3 * np.exp(-5.0 * time), atol=5e-6)


def test_stops_are_never_passed_and_the_free_joint_takes_over(model):
    start = elbow(0.35, 0.1)
    model.upper = np.array([math.pi, start[1] + 0.02])
    trajectory = PoseTrajectory.through(line((0.0, 0.35, 0.1), (1.0, 0.1, 0.25)), "linear")
    path = follow(model, "link_2", TIP, trajectory, start, np.arange(0, 3.0, 2e-3))
    assert path.positions[:, 1].max() <= model.upper[1]
    assert path.positions[-1, 1] == pytest.approx(model.upper[1])
    # The first joint ends where the tip is closest to the goal on its circle: in the goal's direction.
    tip, _ = model.pose(path.positions[-1], "link_2", TIP)
    assert math.atan2(tip[0], tip[2]) == pytest.approx(math.atan2(0.25, 0.1), abs=1e-6)


def test_minimum_jerk_of_a_path_is_that_of_the_signal():
    share = np.linspace(0.0, 1.0, 11)
    assert minimum_jerk(share) == pytest.approx(MinimumJerk(duration=1.0, final=1.0).values(share))


def task(*poses, **changes):
    return CartesianTask(link="link_2", point=TIP, poses=line(*poses), **changes)


def initial(q):
    return dict(zip(("joint_1", "joint_2"), map(float, q), strict=True))


def test_a_path_out_of_reach_names_where_the_reach_ends(model):
    drives = [qbmove("joint_1"), qbmove("joint_2")]
    with pytest.raises(ScenarioError, match=r"beyond (.*) s") as error:
        plan(task((0.0, 0.35, 0.1), (1.0, 0.6, 0.6)), model, drives, initial(elbow(0.35, 0.1)), 1.0)
    (problem,) = error.value.problems
    assert problem.code == "unreachable"
    x, y = re.search(r"s, \((.*), 0, (.*)\) m", problem.message).groups()
    assert np.hypot(float(x), float(y)) == pytest.approx(A + B, abs=5e-3)


def test_a_robot_off_the_path_gets_a_start_proposed(model):
    with pytest.raises(ScenarioError) as error:
        plan(task((0.0, 0.35, 0.1), (1.0, 0.3, 0.2)), model, [qbmove("joint_1"), qbmove("joint_2")], {}, 1.0)
    (problem,) = error.value.problems
    assert problem.code == "start-off-path"
    start = np.array([float(angle) for angle in re.findall(r"joint_[12]: (-?[\d.]+)", problem.hint)])
    assert model.pose(start, "link_2", TIP)[0] == pytest.approx([0.1, 0.0, 0.35], abs=1e-3)


def test_compensated_equilibria_hold_the_arm_exactly_on_the_path(model):
    drives = [qbmove("joint_1"), qbmove("joint_2")]
    path, planned = plan(
        task((0.0, 0.35, 0.1), (1.0, 0.3, 0.2), gravity_compensation=True, preset={"*": 0.2}),
        model,
        drives,
        initial(elbow(0.35, 0.1)),
        1.0,
    )
    for row in range(0, len(path.time), 50):
        q = path.positions[row]
        loads = model.gravity_torques(np.asarray(q))
        for index, drive in enumerate(drives):
            references = planned[drive.joint]
            motors = QbMove.motor_references(references["equilibrium_position"][row], references["stiffness_preset"][row])
            assert sum(QbMove.elastic_torques(q[index], *motors, drive.elastic)) == pytest.approx(loads[index], abs=1e-11)
    shifts = [planned[name]["equilibrium_position"] for name in ("joint_1", "joint_2")] - path.positions.T
    assert np.abs(shifts).max() > 0.1


def test_plans_of_motor_reference_modes_give_motor_positions(model):
    path, planned = plan(
        task((0.0, 0.35, 0.1), preset={"*": 0.3}),
        model,
        [qbmove("joint_1", mode=2), qbmove("joint_2", mode=3)],
        initial(elbow(0.35, 0.1)),
        0.1,
    )
    first = planned["joint_1"]
    assert first["reference_1"] - first["reference_2"] == pytest.approx(np.full(len(path.time), 0.6))
    assert set(planned["joint_2"]) == {"equilibrium_position", "stiffness_preset"}
    assert planned["joint_2"]["equilibrium_position"][25] == pytest.approx(elbow(0.35, 0.1)[1], abs=1e-6)


def test_joints_outside_the_task_do_not_move(model):
    start = elbow(0.35, 0.1)
    goal, _ = model.pose(start + np.array([0.1, 0.0]), "link_2", TIP)
    path, _ = plan(
        task((0.0, 0.35, 0.1), (1.0, goal[2], goal[0]), joints=("joint_1",), tolerance=0.02),
        model,
        [qbmove("joint_1"), qbmove("joint_2")],
        initial(start),
        2.0,
    )
    assert np.ptp(path.positions[:, 1]) == 0.0
    assert path.positions[-1, 0] == pytest.approx(start[0] + 0.1, abs=1e-4)
