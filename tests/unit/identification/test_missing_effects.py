"""A fit names the effect that its model lacks; recordings are from an independent integrator."""

import pytest

from asrsim.identification import identify
from asrsim.identification.flexible import with_elastic_link
from asrsim.robot import load_robot
from asrsim.robot.dynamics import RobotModel
from support.odd_arm import drawn, record
from support.soft_arm import SEA

NAMED = {
    "backlash": "backlash of joint_1",
    "cubic spring": "a cubic term in the spring of joint_1",
    "second mode": "a second mode, such as an elastic link_1",
    "hysteresis": "hysteresis of the springs of joint_1",
    "stribeck": "static friction of joint_1",
    "torque limit": "a limit motor_1_max_torque of joint_1",
    "speed limit": "a limit motor_1_max_velocity of joint_1",
    "load": "another mass of link_1",
}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [20, 21])
@pytest.mark.parametrize("effect", NAMED)
def test_the_effect_that_a_robot_has_is_named_first(tmp_path, effect, seed):
    scenario, recording, truth = record(effect, seed, tmp_path)
    found = identify(scenario, [recording], free=list(truth))
    assert not found.fits
    assert found.causes[0].startswith(NAMED[effect])


@pytest.mark.slow
def test_nothing_is_named_in_right_models(tmp_path):
    for seed in range(20, 26):
        scenario, recording, truth = record("", seed, tmp_path / str(seed))
        found = identify(scenario, [recording], free=list(truth))
        assert (found.fits, found.causes) == (True, ())


@pytest.mark.slow
@pytest.mark.parametrize(("effect", "key"), [("backlash", "backlash"), ("cubic spring", "spring_cubic")])
def test_a_free_effect_is_identified(tmp_path, effect, key):
    """The intervals of the effect and of the spring contain the truth."""
    scenario, recording, truth = record(effect, 22, tmp_path)
    (true,) = drawn(effect, 22)[1].values()
    found = identify(scenario, [recording], free=[*truth, f"joint_1.{key}={0.8 * true}"])
    assert found.fits, found.misfit
    for name, value in ((f"joint_1.{key}", true), ("joint_1.spring_stiffness", truth["joint_1.spring_stiffness"])):
        one = found.find(name)
        assert one.low < value < one.high
        assert one.margin < 0.1


def test_an_elastic_link_has_the_inertia_of_the_rigid_link_and_its_own_frequency(tmp_path):
    """With the spring locked, the mass matrix is that of the rigid robot; the second body has the wanted frequency."""
    SEA.write(tmp_path)
    rigid = load_robot(tmp_path / "arm.urdf")
    elastic = with_elastic_link(rigid, "joint_1", 50.0)
    matrix = RobotModel(elastic).mass_matrix([0.0, 0.0])
    assert matrix[0, 0] == pytest.approx(RobotModel(rigid).mass_matrix([0.0])[0, 0], rel=1e-12)
    assert elastic.joint("joint_1_bend").spring_stiffness == pytest.approx(50.0**2 * matrix[1, 1], rel=1e-12)
    assert sum(link.mass or 0.0 for link in elastic.links) == pytest.approx(0.5)


@pytest.mark.parametrize("effect", ["backlash", pytest.param("torque limit", marks=pytest.mark.slow)])
def test_an_adopted_cause_is_identified_and_the_springs_are_right(tmp_path, effect):
    """Without the cause, the stiffness is only weakly known; with it, the model fits and the intervals contain the truth."""
    scenario, recording, truth = record(effect, 23, tmp_path)
    (true,) = drawn(effect, 23)[1].values()
    found = identify(scenario, [recording], free=list(truth), adopt=True)
    assert found.fits, found.misfit
    assert not found.causes
    key = {"backlash": "joint_1.backlash", "torque limit": "joint_1.motor_1_max_torque"}[effect]
    assert any(text.startswith(f"{key}: adopted") for text in found.remarks)
    for name, value in ((key, true), ("joint_1.spring_stiffness", truth["joint_1.spring_stiffness"])):
        one = found.find(name)
        assert one.low < value < one.high
        assert one.verdict == "identified"
