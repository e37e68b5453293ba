"""Damaged robots: whatever is changed in a good file gives a checked robot or a RobotError, and what `check` passes runs."""

from __future__ import annotations

import random
import warnings
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from asrsim.cli.findings import robot_report
from asrsim.errors import AsrsimError, RobotError
from asrsim.robot import engine_urdf, load_robot, merge_fixed, step_figures, step_findings
from asrsim.robot.engine_text import usable_shapes
from asrsim.scenario import make_scenario
from asrsim.simulation.run import simulate
from support.damage import damaged
from support.paths import ROOT
from support.tiny import PENDULUM

pytestmark = pytest.mark.once

URDFS = sorted((ROOT / "examples/urdf").glob("dof*.urdf"))
TEXTS = [PENDULUM, *(path.read_text() for path in URDFS)]


def write(seed: int, folder: Path) -> Path:
    source = random.Random(seed)
    path = folder / "damaged.urdf"
    path.write_bytes(damaged(source.choice(TEXTS), source))
    return path


def read(seed: int, folder: Path) -> str:
    """robot or error; another exception, or a warning of NumPy's, is a fault of ours."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            robot = load_robot(write(seed, folder))
            usable_shapes(robot, visuals=True)
            engine_urdf(merge_fixed(robot).robot)
            step_findings(robot, step_figures(robot, step=1e-3), step=1e-3)
        except RobotError:
            return "error"
    return "robot"


def run(seed: int, folder: Path) -> str:
    """refused by `check`, refused by the run alone, or ran."""
    path = write(seed, folder)
    if robot_report(path, step=1e-3).errors:
        return "refused"
    try:
        simulate(make_scenario(path, duration=0.02))
    except AsrsimError as error:
        return f"seed {seed}: {error}"
    return "ran"


def test_damaged_files_give_robots_or_robot_errors(tmp_path: Path) -> None:
    outcomes = Counter(read(seed, tmp_path) for seed in range(300))
    assert set(outcomes) == {"robot", "error"}
    assert outcomes["robot"] > 30


def test_what_check_passes_runs(tmp_path: Path) -> None:
    outcomes = Counter(run(seed, tmp_path) for seed in range(1000, 1060))
    assert set(outcomes) == {"refused", "ran"}


@pytest.mark.slow
@pytest.mark.parametrize("block", range(20))
def test_many_damaged_files(block: int, tmp_path: Path) -> None:
    outcomes = Counter(read(seed, tmp_path) for seed in range(10_000 + 250 * block, 10_250 + 250 * block))
    assert set(outcomes) == {"robot", "error"}


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_many_that_check_passes_run(block: int, tmp_path: Path) -> None:
    outcomes = Counter(run(seed, tmp_path) for seed in range(50_000 + 100 * block, 50_100 + 100 * block))
    assert set(outcomes) == {"refused", "ran"}


number = st.floats(-1e6, 1e6, allow_nan=False)


@given(st.tuples(number, number, number), st.tuples(number, number, number), st.floats(1e-6, 1e6), number)
def test_every_number_reaches_the_engine_to_the_bit(
    tmp_path_factory: pytest.TempPathFactory, xyz: tuple, rpy: tuple, mass: float, lower: float
) -> None:
    path = tmp_path_factory.getbasetemp() / "numbers.urdf"
    place = f'xyz="{" ".join(map(repr, xyz))}" rpy="{" ".join(map(repr, rpy))}"'
    text = PENDULUM.replace('<axis xyz="0 1 0"/>', f'<origin {place}/><axis xyz="0 1 0"/>')
    text = text.replace('mass value="0.5"', f'mass value="{mass!r}"').replace(
        'lower="-3" upper="3"', f'lower="{lower!r}" upper="2e6"'
    )
    path.write_text(text)
    root = etree.fromstring(engine_urdf(load_robot(path))[0])
    origin, limit = root.find("joint/origin"), root.find("joint/limit")
    assert tuple(map(float, origin.get("xyz").split())) == xyz
    assert tuple(map(float, origin.get("rpy").split())) == rpy
    assert float(root.find("link[@name='arm']/inertial/mass").get("value")) == mass
    assert float(limit.get("lower")) == lower
