"""Damaged robots: whatever is changed in a good file gives a checked robot or a RobotError, and what `check` passes runs."""

import random
import warnings
from collections import Counter

import pytest

from asrsim.cli.findings import robot_report
from asrsim.errors import AsrsimError, RobotError
from asrsim.robot import load_robot, merge_fixed
from asrsim.robot.meshes import usable_shapes
from asrsim.scenario import make_scenario
from asrsim.simulation.run import simulate
from support.damage import damaged
from support.paths import ROOT
from support.tiny import PENDULUM

URDFS = sorted((ROOT / "examples/urdf").glob("dof*.urdf"))
TEXTS = [PENDULUM, *(path.read_text() for path in URDFS)]


def write(seed, folder):
    source = random.Random(seed)
    path = folder / "damaged.urdf"
    path.write_bytes(damaged(source.choice(TEXTS), source))
    return path


def read(seed, folder):
    """robot or error; another exception, or a warning of NumPy's, is a fault of ours."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            robot = load_robot(write(seed, folder))
            usable_shapes(robot, visuals=True)
            merge_fixed(robot)
        except RobotError:
            return "error"
    return "robot"


def run(seed, folder):
    """refused by `check`, refused by the run alone, or ran."""
    path = write(seed, folder)
    if robot_report(path).errors:
        return "refused"
    try:
        simulate(make_scenario(path, duration=0.02))
    except AsrsimError as error:
        return f"seed {seed}: {error}"
    return "ran"


@pytest.mark.parametrize(("first", "count"), [(0, 300), pytest.param(10_000, 5000, marks=pytest.mark.slow)])
def test_damaged_files_give_robots_or_robot_errors(first, count, tmp_path):
    outcomes = Counter(read(seed, tmp_path) for seed in range(first, first + count))
    assert set(outcomes) == {"robot", "error"}
    assert outcomes["robot"] > count // 10


@pytest.mark.parametrize(("first", "count"), [(1000, 60), pytest.param(50_000, 1000, marks=pytest.mark.slow)])
def test_what_check_passes_runs(first, count, tmp_path):
    outcomes = Counter(run(seed, tmp_path) for seed in range(first, first + count))
    assert set(outcomes) == {"refused", "ran"}
