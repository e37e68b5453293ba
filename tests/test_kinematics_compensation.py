"""Gravity compensation: the elastic law inverted, for every actuator."""

from __future__ import annotations

import pytest

from asrsim.actuators import AwasII, Bavs, QbMove, Sea
from asrsim.kinematics import JointDrive, equilibrium_for_load, resting_motors
from asrsim.kinematics.compensation import LoadError

CASES = {
    "sea": (Sea, (200.0, 0.8), 0.0, (-120.0, -0.0785, 0.0, 3.0, 159.0)),
    "awas_ii": (AwasII, (10.0, 0.05, 0.015, 1.0, 0.3), 0.005, (-0.5, 0.0, 0.0785, 0.7)),
    "bavs": (Bavs, (1.21e-6, 2.38e-6, 1.6e5, 8.71, 0.27), 0.1, (-3.0, 0.0, 0.5, 2.0)),
    "qbmove": (QbMove, (6.257, 0.01038, 3.9, 0.08918, 0.8), 0.2, (-1.0, 0.0, 0.42, 1.0)),
}


@pytest.mark.parametrize("name", CASES)
def test_the_spring_carries_exactly_the_load(name):
    actuator, spring, preset, loads = CASES[name]
    drive = JointDrive(joint="j", actuator=actuator, mode=3, spring=spring)
    for load in loads:
        for position in (-0.4, 0.0, 0.8):
            equilibrium = equilibrium_for_load(drive, position, load, preset)
            motors = actuator.motor_references(equilibrium, preset)
            assert sum(actuator.elastic_torques(position, *motors, spring)) == pytest.approx(load, abs=1e-11)


def test_a_symmetric_spring_without_load_rests_at_the_link():
    drive = JointDrive(joint="j", actuator=QbMove, mode=3, spring=(11.0, 0.02, 11.0, 0.02, 0.8))
    assert equilibrium_for_load(drive, 0.3, 0.0, 0.2) == pytest.approx(0.3, abs=1e-14)


def test_the_spring_of_a_series_elastic_actuator_gives_load_over_stiffness():
    drive = JointDrive(joint="j", actuator=Sea, mode=3, spring=(200.0, 0.8))
    assert equilibrium_for_load(drive, 0.5, 10.0, 0.0) == pytest.approx(0.55, abs=1e-13)


def test_too_large_a_load_names_what_can_be_held():
    drive = JointDrive(joint="elbow", actuator=Sea, mode=3, spring=(10.0, 0.8))
    with pytest.raises(LoadError, match=r"elbow: the spring cannot hold 9 N m .* most it can hold that way is 8 N m") as error:
        equilibrium_for_load(drive, 0.0, 9.0, 0.0)
    assert error.value.largest == pytest.approx(8.0)
    with pytest.raises(LoadError) as error:
        equilibrium_for_load(drive, 0.0, -9.0, 0.0)
    assert error.value.largest == pytest.approx(-8.0)


def test_droop_of_a_series_elastic_actuator_adds_load_over_gain():
    drive = JointDrive(
        joint="j", actuator=Sea, mode=6, spring=(200.0, 0.8), proportional=(125.0,), integral=(0.0,), max_torque=(20.0,)
    )
    assert equilibrium_for_load(drive, 0.5, 10.0, 0.0, droop=True) == pytest.approx(0.5 + 10 / 200 + 10 / 125, abs=1e-12)


def test_motors_at_rest_balance_their_springs():
    spring = (11.0, 0.02, 11.0, 0.02, 0.8)
    drive = JointDrive(
        joint="j", actuator=QbMove, mode=6, spring=spring,
        proportional=(125.0, 125.0), integral=(0.0, 0.0), max_torque=(12.0, 12.0),
    )  # fmt: skip
    theta = resting_motors(drive, 0.1, 0.3, 0.6)
    torques = QbMove.elastic_torques(0.1, *theta, spring)
    for reference, resting, torque in zip((0.9, -0.3), theta, torques, strict=True):
        assert 125.0 * (reference - resting) == pytest.approx(torque, abs=1e-10)
    equilibrium = equilibrium_for_load(drive, 0.1, 1.5, 0.4, droop=True)
    theta = resting_motors(drive, 0.1, equilibrium, 0.4)
    assert sum(QbMove.elastic_torques(0.1, *theta, spring)) == pytest.approx(1.5, abs=1e-10)


def test_an_integral_term_leaves_no_droop():
    drive = JointDrive(
        joint="j", actuator=Sea, mode=6, spring=(200.0, 0.8), proportional=(125.0,), integral=(1.0,), max_torque=(20.0,)
    )
    assert resting_motors(drive, 0.0, 0.4, 0.0)[0] == 0.4


def test_a_motor_too_weak_for_the_pretension_is_named():
    """The paper's stiff preset 0.6 asks 7.35 N m of each motor with AlterEgo's springs."""
    drive = JointDrive(
        joint="j", actuator=QbMove, mode=6, spring=(11.0, 0.02, 11.0, 0.02, 0.8),
        proportional=(125.0, 125.0), integral=(0.0, 0.0), max_torque=(6.0, 6.0),
    )  # fmt: skip
    with pytest.raises(LoadError, match=r"motor 1 would have to hold 7\.351 N m") as error:
        equilibrium_for_load(drive, 0.0, 0.0, 0.6)
    assert error.value.largest == 6.0
