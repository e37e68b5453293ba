"""Accepted is runnable: what `check` accepts, `init` writes for every actuator, and runs in both engines, at rest or moving.

`ASRSIM_SEED` draws other random files. `ASRSIM_ROBOTS=FOLDER` names a folder with clones of repositories: of the robots in them
that have masses and moving joints, `ASRSIM_DRAW` (20) are drawn.
"""

import os
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from asrsim.cli.findings import robot_report
from asrsim.errors import AsrsimError
from support.accepted import ACTUATORS, faults_of
from support.robot_grammar import random_file

pytestmark = pytest.mark.slow
pytest.importorskip("pybullet")
pytest.importorskip("mujoco")


SEED = int(os.environ.get("ASRSIM_SEED", "100"))


@pytest.mark.parametrize("actuator", ACTUATORS)
@pytest.mark.parametrize("seed", range(SEED, SEED + 30))
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


def drawn(folder, seed):
    """Robot files that `check` accepts, in random order; of one repository, one file for each name of a robot."""
    files, seen = sorted(folder.rglob("*.urdf")), set()
    for index in np.random.default_rng(seed).permutation(len(files)):
        path = files[index]
        report = robot_report(path) if path.is_file() else None
        if report and report.robot and not report.errors:
            key = (path.relative_to(folder).parts[0], report.robot.name)
            if key not in seen:
                seen.add(key)
                yield path


@pytest.mark.skipif("ASRSIM_ROBOTS" not in os.environ, reason="ASRSIM_ROBOTS names no folder of robots")
def test_public_robots_run_in_both_engines(tmp_path):
    folder, faults = Path(os.environ["ASRSIM_ROBOTS"]), {}
    for number, robot in enumerate(islice(drawn(folder, SEED), int(os.environ.get("ASRSIM_DRAW", "20")))):
        own = tmp_path / str(number)
        own.mkdir()
        try:
            found = faults_of(robot, own, ACTUATORS[number % len(ACTUATORS)])
        except AsrsimError as error:
            found = [str(error)]
        print(robot.relative_to(folder), ACTUATORS[number % len(ACTUATORS)], found or "agree", flush=True)
        faults |= {str(robot): found} if found else {}
    assert not faults
