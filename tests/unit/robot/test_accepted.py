"""A robot that `check` accepts runs: `init` writes a scenario for it, and both engines agree."""

import pytest

from asrsim.cli.findings import robot_report
from support.accepted import ACTUATORS, faults_of
from support.robot_grammar import random_file

pytest.importorskip("pybullet")
pytest.importorskip("mujoco")


@pytest.mark.parametrize("seed", range(4, 12))
def test_an_accepted_file_runs_in_both_engines(tmp_path, seed):
    """Each seed with another actuator; `tests/slow/test_accepted_robots.py` has many more."""
    robot = tmp_path / "robot.urdf"
    robot.write_text(random_file(seed, joints=4))
    assert faults_of(robot, tmp_path, ACTUATORS[seed % 4], duration=0.02, compiled=False) in ([], None)


def test_most_files_of_the_grammar_are_accepted(tmp_path):
    """Otherwise the tests of accepted files would test nothing."""
    robot, accepted = tmp_path / "robot.urdf", 0
    for seed in range(20):
        robot.write_text(random_file(seed))
        accepted += not robot_report(robot).errors
    assert accepted >= 14
