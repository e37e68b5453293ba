"""Engines of one process do not affect each other; a kick that they cannot divide has the mean of its pieces."""

import numpy as np
import pytest

from asrsim.engines.base import VELOCITY, whole_kick
from asrsim.engines.bullet import BulletEngine
from asrsim.robot import load_robot
from asrsim.scenario import Scenario
from support.random_robots import random_urdf

LINK = """<link name="l{i}"><inertial><origin xyz="0 0 0.1"/><mass value="{mass}"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j{i}" type="revolute"><origin xyz="0 0 0.2"/><parent link="l{before}"/><child link="l{i}"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="100" velocity="100"/></joint>"""


def make(folder, joints, mass):
    path = folder / f"robot_{joints}_{mass}.urdf"
    links = "".join(LINK.format(i=i, before=i - 1, mass=mass) for i in range(1, joints + 1))
    path.write_text(f'<robot name="chain"><link name="l0"/>{links}</robot>')
    robot = load_robot(path)
    return BulletEngine(Scenario(name="engine", robot=path), robot)


def coriolis(engine):
    n = len(engine.joints)
    speeds, found = np.array([1.0, -2.0, 0.5][:n]), []
    for velocity in (speeds, 0.0 * speeds):
        exchange = np.zeros((1, n, 6))
        engine.start([0.3] * n, velocity, step=1.0, staggered=False, implicitness=0.5)
        engine.step(exchange, np.zeros((1, 0, 6)), np.ones(1))
        found.append(exchange[0, :, VELOCITY] - velocity)
    return (found[0] - found[1]).tolist()


def test_velocity_torques_are_those_of_the_engines_own_robot(tmp_path):
    alone = make(tmp_path, 3, 0.5)
    expected = coriolis(alone)
    alone.close()
    other = make(tmp_path, 2, 0.7)
    second = make(tmp_path, 3, 0.5)
    try:
        assert coriolis(second) == pytest.approx(expected, abs=1e-14)
        assert len(coriolis(other)) == 2
    finally:
        second.close()
        other.close()


@pytest.mark.parametrize("fixed", [True, False])
def test_bullet_keeps_its_opinion_of_axes_to_itself(fixed, tmp_path, capfd):
    """Axes of unit length but for rounding: Bullet prints of one in hundred or so, these two, and that would break --json."""
    for seed in (12, 52007, 0):
        path = tmp_path / f"{seed}.urdf"
        path.write_text(random_urdf(seed, moving=5, fixed=3))
        engine = BulletEngine(Scenario(name="engine", robot=path, fixed_base=fixed), load_robot(path))
        zero = np.zeros(len(engine.joints))
        engine.start(zero, zero, step=1e-3, staggered=False, implicitness=0.5)
        engine.step(np.zeros((1, len(zero), 6)), np.zeros((1, 0, 6)), np.ones(1))
        engine.close()
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("lengths", [(1.0,), (0.25, 0.75), (0.2, 0.3)])
def test_a_whole_kick_has_the_mean_of_its_pieces(lengths):
    source, shares = np.random.default_rng(0), np.array(lengths) / sum(lengths)
    exchange, wrenches = source.normal(size=(len(lengths), 3, 6)), source.normal(size=(len(lengths), 2, 6))
    mean, wrench, whole = whole_kick(exchange, wrenches, np.array(lengths))
    np.testing.assert_allclose(mean, np.einsum("p,pnc->nc", shares, exchange))
    np.testing.assert_allclose(wrench[0], np.einsum("p,pwc->wc", shares, wrenches))
    assert whole == pytest.approx(sum(lengths))
