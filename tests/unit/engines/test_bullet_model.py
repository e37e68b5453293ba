"""PyBullet computes the dynamics of every possible link, however heavy; MuJoCo computes the same."""

from dataclasses import replace

import numpy as np
import pytest

from asrsim.engines import bullet_model
from asrsim.engines.base import DAMPING, TORQUE, VELOCITY
from asrsim.engines.bullet import BulletEngine
from asrsim.engines.bullet_model import BulletDynamics
from asrsim.engines.mujoco import MujocoEngine
from asrsim.errors import RobotError
from asrsim.robot import load_robot
from asrsim.scenario import Scenario
from support.random_robots import random_urdf


def change_of_velocity(engine, seed):
    """Change of velocity in one step from a random state under random torques."""
    source, n = np.random.default_rng(seed), len(engine.joints)
    q, v = source.uniform(-2.0, 2.0, n), source.normal(size=n)
    exchange = np.zeros((1, n, 6))
    exchange[0, :, TORQUE], exchange[0, :, DAMPING] = 100.0 * source.normal(size=n), source.uniform(0.0, 5.0, n)
    try:
        engine.start(q, v, step=1e-2, staggered=False, implicitness=0.5)
        engine.step(exchange, np.zeros((1, 0, 6)), np.ones(1))
    finally:
        engine.close()
    return exchange[0, :, VELOCITY] - v


@pytest.mark.parametrize("block", [0, 1, *(pytest.param(block, marks=pytest.mark.slow) for block in (2, 3))])
def test_random_links_of_20_to_160_kg_move_equally_in_both_engines(block, tmp_path):
    for seed in range(60 * block, 60 * block + 60):
        path = tmp_path / f"{seed}.urdf"
        path.write_text(random_urdf(seed, moving=4, fixed=1, mass=(20.0, 160.0), size=0.2 + 0.05 * (seed % 20)))
        robot, scenario = load_robot(path), Scenario(name="heavy", robot=path, fixed_base=seed % 3 > 0)
        changes = [change_of_velocity(kind(scenario, robot), seed) for kind in (BulletEngine, MujocoEngine)]
        np.testing.assert_allclose(*changes, rtol=1e-9, atol=1e-11)


def test_a_heavy_link_beside_one_whose_inertia_is_impossible(tmp_path):
    """The largest moment of the hand exceeds the sum of the others by rounding of its numbers; the torso is heavy."""
    path = tmp_path / "robot.urdf"
    path.write_text(random_urdf(5, moving=3, fixed=0, mass=(80.0, 90.0), size=0.7))
    robot = load_robot(path)
    hand = replace(robot.links[-1], mass=0.1, inertia=(1e-4, 2e-5, 0.0, 1e-4, 0.0, 2.1e-4))
    robot = replace(robot, links=(*robot.links[:-1], hand))
    changes = [change_of_velocity(kind(Scenario(name="r", robot=path), robot), 1) for kind in (BulletEngine, MujocoEngine)]
    np.testing.assert_allclose(*changes, rtol=1e-6)


def test_a_refused_link_is_named(tmp_path, monkeypatch):
    """No inertia that the reader accepts is refused: the test makes the correction of impossible ones too small."""
    correction = bullet_model._lift
    monkeypatch.setattr(bullet_model, "_lift", lambda link: 1e-6 * correction(link))
    path = tmp_path / "robot.urdf"
    path.write_text(random_urdf(5, moving=3, fixed=0))
    robot = load_robot(path)
    bad = replace(robot.links[2], inertia=(1.0, 0.0, 0.0, 1.0, 0.0, 9.0))
    robot = replace(robot, links=(*robot.links[:2], bad, *robot.links[3:]))
    with pytest.raises(RobotError, match=f"{bad.name}: PyBullet cannot"):
        BulletDynamics(Scenario(name="r", robot=path), robot)
