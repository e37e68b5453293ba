"""Inverse kinematics on a planar arm with two links, whose kinematics is known in closed form."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

import numpy as np
import pytest

from asrsim.actuators import QbMove
from asrsim.errors import ScenarioError
from asrsim.kinematics import PoseTrajectory, follow, plan
from asrsim.kinematics.path import minimum_jerk
from asrsim.scenario.data import CartesianPose, CartesianTask
from asrsim.signals import MinimumJerk
from support.robots import drive_with

A, B = 0.3, 0.2
"""m, lengths of the two links."""
ORIGIN = (0.0, 0.0, 0.0)


@dataclass
class Planar2R:
    """Two links in the x-y plane, axes along z; gravity pulls along -y with weight[i] (N) at the end of link i."""

    limit: float = math.pi
    weight: tuple[float, float] = (2.0, 1.0)
    joints: tuple[str, ...] = ("one", "two")
    links: tuple[str, ...] = ("tip",)
    lower: np.ndarray = field(init=False)
    upper: np.ndarray = field(init=False)

    def __post_init__(self):
        self.lower, self.upper = np.full(2, -self.limit), np.full(2, self.limit)

    def pose(self, positions, link, point):
        first, last = positions[0], positions[0] + positions[1]
        c, s = math.cos(last), math.sin(last)
        place = np.array([A * math.cos(first) + B * c, A * math.sin(first) + B * s, 0.0])
        return place, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def jacobian(self, positions, link, point):
        first, last = positions[0], positions[0] + positions[1]
        jacobian = np.zeros((6, 2))
        jacobian[0] = [-A * math.sin(first) - B * math.sin(last), -B * math.sin(last)]
        jacobian[1] = [A * math.cos(first) + B * math.cos(last), B * math.cos(last)]
        jacobian[5] = 1.0
        return jacobian

    def gravity_torques(self, positions):
        first, last = positions[..., 0], positions[..., 0] + positions[..., 1]
        inner = self.weight[1] * B * np.cos(last)
        return np.stack([(self.weight[0] + self.weight[1]) * A * np.cos(first) + inner, inner], axis=-1)


def elbow(x, y):
    """The closed-form solution with the second joint bent to the positive side."""
    second = math.acos((x * x + y * y - A * A - B * B) / (2 * A * B))
    return np.array([math.atan2(y, x) - math.atan2(B * math.sin(second), A + B * math.cos(second)), second])


def line(*poses):
    return tuple(CartesianPose(time=time, position=(x, y, 0.0)) for time, x, y in poses)


def qbmove(joint, mode=3, **changes):
    return drive_with(QbMove, mode=mode, joint=joint, spring=(11.0, 0.02, 11.0, 0.02, 0.8), **changes)


def test_the_loop_tracks_the_closed_form_solution():
    trajectory = PoseTrajectory.through(line((0.0, 0.35, 0.1), (2.0, 0.2, 0.3)), "minimum_jerk")
    time = np.arange(0, 2.5, 2e-3)
    path = follow(Planar2R(), "tip", ORIGIN, trajectory, elbow(0.35, 0.1), time)
    wanted, _ = trajectory.at(time)
    exact = np.array([elbow(x, y) for x, y, _ in wanted])
    assert np.abs(path.positions - exact).max() < 1e-4
    assert path.position_error.max() < 5e-5
    assert np.allclose(path.positions[-1], elbow(0.2, 0.3), atol=1e-9)


def test_an_initial_error_decays_with_the_gain():
    trajectory = PoseTrajectory.through(line((0.0, 0.35, 0.1)), "minimum_jerk")
    time = np.arange(0, 1.0, 1e-3)
    path = follow(Planar2R(), "tip", ORIGIN, trajectory, elbow(0.349, 0.1), time, gain=5.0, damping=1e-6)
    assert np.allclose(path.position_error, 1e-3 * np.exp(-5.0 * time), atol=5e-6)


def test_stops_are_never_passed_and_the_free_joint_takes_over():
    model = Planar2R()
    start = elbow(0.35, 0.1)
    model.upper = np.array([math.pi, start[1] + 0.02])
    trajectory = PoseTrajectory.through(line((0.0, 0.35, 0.1), (1.0, 0.1, 0.25)), "linear")
    path = follow(model, "tip", ORIGIN, trajectory, start, np.arange(0, 3.0, 2e-3))
    assert path.positions[:, 1].max() <= model.upper[1]
    assert path.positions[-1, 1] == pytest.approx(model.upper[1])
    # The first joint ends where the tip is closest to the goal on its circle: in the goal's direction.
    tip, _ = model.pose(path.positions[-1], "tip", ORIGIN)
    assert math.atan2(tip[1], tip[0]) == pytest.approx(math.atan2(0.25, 0.1), abs=1e-6)


def test_minimum_jerk_of_a_path_is_that_of_the_signal():
    share = np.linspace(0.0, 1.0, 11)
    assert minimum_jerk(share) == pytest.approx(MinimumJerk(duration=1.0, final=1.0).values(share))


def task(*poses, **changes):
    return CartesianTask(link="tip", poses=line(*poses), **changes)


def initial(q):
    return dict(zip(("one", "two"), map(float, q), strict=True))


def test_a_path_out_of_reach_names_where_the_reach_ends():
    with pytest.raises(ScenarioError, match=r"beyond (.*) s") as error:
        plan(
            task((0.0, 0.35, 0.1), (1.0, 0.6, 0.6)), Planar2R(), [qbmove("one"), qbmove("two")], initial(elbow(0.35, 0.1)), 1.0
        )
    (problem,) = error.value.problems
    assert problem.code == "unreachable"
    x, y = re.search(r"s, \((.*), (.*), 0\) m", problem.message).groups()
    assert np.hypot(float(x), float(y)) == pytest.approx(A + B, abs=5e-3)


def test_a_robot_off_the_path_gets_a_start_proposed():
    with pytest.raises(ScenarioError) as error:
        plan(task((0.0, 0.35, 0.1), (1.0, 0.3, 0.2)), Planar2R(), [qbmove("one"), qbmove("two")], {}, 1.0)
    (problem,) = error.value.problems
    assert problem.code == "start-off-path"
    start = np.array([float(angle) for angle in re.findall(r"(?:one|two): (-?[\d.]+)", problem.hint)])
    assert Planar2R().pose(start, "tip", ORIGIN)[0] == pytest.approx([0.35, 0.1, 0.0], abs=1e-3)


def test_compensated_equilibria_hold_the_arm_exactly_on_the_path():
    model = Planar2R()
    drives = [qbmove("one"), qbmove("two")]
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
    shifts = [planned[name]["equilibrium_position"] for name in ("one", "two")] - path.positions.T
    assert np.abs(shifts).max() > 0.1


def test_plans_of_motor_reference_modes_give_motor_positions():
    path, planned = plan(
        task((0.0, 0.35, 0.1), preset={"*": 0.3}),
        Planar2R(),
        [qbmove("one", mode=2), qbmove("two", mode=3)],
        initial(elbow(0.35, 0.1)),
        0.1,
    )
    first = planned["one"]
    assert first["reference_1"] - first["reference_2"] == pytest.approx(np.full(len(path.time), 0.6))
    assert set(planned["two"]) == {"equilibrium_position", "stiffness_preset"}
    assert planned["two"]["equilibrium_position"][25] == pytest.approx(elbow(0.35, 0.1)[1], abs=1e-6)


def test_joints_outside_the_task_do_not_move():
    start = elbow(0.35, 0.1)
    goal, _ = Planar2R().pose(start + np.array([0.1, 0.0]), "tip", ORIGIN)
    path, _ = plan(
        task((0.0, 0.35, 0.1), (1.0, goal[0], goal[1]), joints=("one",), tolerance=0.02),
        Planar2R(),
        [qbmove("one"), qbmove("two")],
        initial(start),
        2.0,
    )
    assert np.ptp(path.positions[:, 1]) == 0.0
    assert path.positions[-1, 0] == pytest.approx(start[0] + 0.1, abs=1e-4)
