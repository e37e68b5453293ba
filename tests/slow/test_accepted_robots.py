"""Accepted is runnable: what `check` accepts, `init` writes for every actuator, and runs in both engines, at rest or moving."""

import pytest

from support.accepted import ACTUATORS, faults_of
from support.robot_grammar import random_file

pytestmark = pytest.mark.slow
pytest.importorskip("pybullet")
pytest.importorskip("mujoco")


@pytest.mark.parametrize("actuator", ACTUATORS)
@pytest.mark.parametrize("seed", range(100, 130))
def test_accepted_files_run_in_both_engines(tmp_path, seed, actuator):
    robot = tmp_path / "robot.urdf"
    robot.write_text(random_file(seed))
    for at_rest in (False, True):
        assert faults_of(robot, tmp_path, actuator, at_rest=at_rest) in ([], None)


@pytest.mark.parametrize("actuator", ACTUATORS)
def test_robots_beside_the_project_run_in_both_engines(tmp_path, shared, actuator):
    robots = sorted((shared / "robots").rglob("*.urdf"))
    assert robots
    for robot in robots:
        for at_rest in (False, True):
            assert faults_of(robot, tmp_path, actuator, at_rest=at_rest) in ([], None), robot
