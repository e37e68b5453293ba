"""Gravity compensation: the elastic law inverted, for every actuator."""

import numpy as np
import pytest

from asrsim.actuators import Actuator, AwasII, Bavs, Parameter, QbMove, Sea
from asrsim.actuators.rest import MotorsAtRest, increasing_roots, resting_motors, spring_torques
from asrsim.errors import ScenarioError
from asrsim.kinematics import equilibria_for_loads
from support.robots import drive_with


def equilibrium_for_load(drive, position, load, preset, *, droop=False):
    """Equilibrium of one instant."""
    return equilibria_for_loads(drive, *np.array([[position], [load], [preset]]), droop=droop)[0]


def rest(drive, position, references):
    """Positions of the motors of one instant."""
    return resting_motors([drive], np.array([[position]]), np.array(references)[:, None, None], limited=False)[0][:, 0, 0]


class Three(Actuator):
    """Three motors with one linear spring each, and a reference map that is not linear."""

    name, title, source, motors = "three", "Three", "test", 3
    parameters = (Parameter(name="k", default=2.0, unit="N m/rad", doc="stiffness"),)

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, theta_3, parameters):
        return tuple(parameters[0] * (theta - q) for theta in (theta_1, theta_2, theta_3))

    @staticmethod
    def motor_references(equilibrium, preset):
        return equilibrium, equilibrium + preset, equilibrium + equilibrium**3


CASES = {
    "three": (Three, (2.0,), 0.3, (-2.0, 0.0, 3.0)),
    "sea": (Sea, (200.0, 0.8), 0.0, (-120.0, -0.0785, 0.0, 3.0, 159.0)),
    "awas_ii": (AwasII, (10.0, 0.05, 0.015, 1.0, 0.3), 0.005, (-0.5, 0.0, 0.0785, 0.7)),
    "bavs": (Bavs, (1.21e-6, 2.38e-6, 1.6e5, 8.71, 0.27), 0.1, (-3.0, 0.0, 0.5, 2.0)),
    "qbmove": (QbMove, (6.257, 0.01038, 3.9, 0.08918, 0.8), 0.2, (-1.0, 0.0, 0.42, 1.0)),
}


@pytest.mark.parametrize("name", CASES)
def test_the_spring_carries_exactly_the_load(name):
    actuator, spring, preset, loads = CASES[name]
    drive = drive_with(actuator, mode=3, spring=spring)
    for load in loads:
        for position in (-0.4, 0.0, 0.8):
            equilibrium = equilibrium_for_load(drive, position, load, preset)
            motors = actuator.motor_references(equilibrium, preset)
            assert sum(actuator.elastic_torques(position, *motors, drive.elastic)) == pytest.approx(load, abs=1e-11)


def test_springs_of_many_joints_are_those_of_each_joint_alone():
    drives = [drive_with(CASES[name][0], mode=6, spring=CASES[name][1]) for name in ("sea", "qbmove", "bavs", "sea")]
    place, goals = np.full((4, 1), 0.3), [drive.goals(np.full((2, 1), 0.1)) for drive in drives]
    alone = [spring_torques([drive], place[:1], [goal])[0] for drive, goal in zip(drives, goals, strict=True)]
    assert spring_torques(drives, place, goals) == pytest.approx(np.array(alone), abs=1e-12)


@pytest.mark.parametrize("name", sorted(CASES))
def test_motors_that_follow_their_link_come_to_rest_where_a_search_finds_them(name):
    """Also where motors give their largest torques, and where they no longer do, back at their references."""
    actuator, spring, preset, _ = CASES[name]
    for limits in ({}, {"max_torque": 0.05}, {"integral": 1.0, "max_torque": 0.05}):
        drive = drive_with(actuator, mode=6, spring=spring, **{name: (limits[name],) * actuator.motors for name in limits})
        goals = np.array(actuator.motor_references(0.1, preset))[:, None, None]
        motors = MotorsAtRest([drive], goals)
        for position in (0.3, 0.31, -0.4, 0.8, 0.1):
            link = np.array([[position]])
            torque, change = motors.follow(link)
            rest = [resting_motors([drive], link + step, goals)[1].sum() for step in (-1e-5, 0.0, 1e-5)]
            assert torque.item() == pytest.approx(rest[1], rel=1e-3, abs=1e-4)
            assert change.item() == pytest.approx((rest[2] - rest[0]) / 2e-5, rel=0.02, abs=4e-3)


def test_roots_do_not_depend_on_the_estimated_slope():
    roots = [increasing_roots(np.sinh, np.array([-2.0, 5.0]), slope=slope) for slope in (0.0, 1e-6, 1e9)]
    assert np.abs(roots).max() < 1e-14


def test_too_large_a_load_names_what_can_be_held():
    drive = drive_with(Sea, mode=3, joint="elbow", spring=(10.0, 0.8))
    for side in (9.0, -9.0):
        with pytest.raises(
            ScenarioError, match=rf"compensated: the spring cannot hold {side:g} N m .* is {side - side / 9:g} N m"
        ):
            equilibrium_for_load(drive, 0.0, side, 0.0)


@pytest.mark.parametrize(("integral", "droop"), [(0.0, 10 / 125), (1.0, 0.0)])
def test_droop_is_load_over_gain_without_integral_action(integral, droop):
    drive = drive_with(Sea, mode=6, spring=(200.0, 0.8), proportional=(125.0,), integral=(integral,), max_torque=(20.0,))
    assert equilibrium_for_load(drive, 0.5, 10.0, 0.0, droop=True) == pytest.approx(0.5 + 10 / 200 + droop, abs=1e-12)


def test_a_motion_beyond_a_spring_names_the_time():
    drive = drive_with(Sea, mode=3, joint="elbow", spring=(10.0, 0.8))
    time, nothing = np.linspace(0.0, 1.0, 11), np.zeros(11)
    with pytest.raises(ScenarioError, match=r"at 0.9 s: the spring cannot hold 9 N m"):
        equilibria_for_loads(drive, nothing, 10.0 * time, nothing, droop=False, time=time)


def test_a_motor_too_weak_for_the_pretension_is_named():
    """The paper's stiff preset 0.6 asks 7.35 N m of each motor with AlterEgo's springs."""
    drive = drive_with(QbMove, mode=6, spring=(11.0, 0.02, 11.0, 0.02, 0.8), max_torque=(6.0, 6.0))
    with pytest.raises(ScenarioError, match=r"motor 1 would have to hold 7\.351 N m .* limit is 6 N m"):
        equilibrium_for_load(drive, 0.0, 0.0, 0.6)


def random_drive(generator):
    """An actuator with random springs behind motors that droop."""
    scales = generator.uniform(0.5, 1.5, 4)
    actuator, spring, preset = [
        (Sea, (generator.uniform(2.0, 200.0), generator.uniform(0.1, 0.8)), 0.0),
        (QbMove, (*(scales * (6.257, 0.01038, 3.9, 0.08918)).tolist(), generator.uniform(0.2, 0.8)), 0.2),
        (Bavs, (1.21e-6, 2.38e-6, 1.6e5, generator.uniform(6.0, 11.0), generator.uniform(0.15, 0.4)), 0.1),
        (AwasII, (10.0, 0.05, 0.015, 1.0, 0.3), generator.uniform(0.003, 0.02)),
    ][generator.integers(4)]
    count = actuator.motors
    return drive_with(
        actuator, mode=6, spring=spring, proportional=(generator.uniform(20.0, 200.0),) * count, max_torque=(1e6,) * count
    ), preset


def test_springs_at_their_deflection_limit_still_have_statics():
    """Loads from zero to the largest torque of the springs, with the steady-state error of the motors."""
    generator = np.random.default_rng(11)
    for _ in range(12):
        drive, preset = random_drive(generator)
        law = drive.actuator.elastic_torques
        for side in (-1.0, 1.0):
            far = drive.actuator.motor_references(side * 5.0, preset)
            most = sum(law(0.0, far[0], preset if drive.actuator.adjuster else far[1], drive.elastic))
            for share in (0.0, generator.uniform(0.0, 1.0), 0.9, 0.999999, 1.0):
                equilibrium = equilibrium_for_load(drive, 0.0, share * most, preset, droop=True)
                motors = rest(drive, 0.0, drive.actuator.motor_references(equilibrium, preset))
                assert sum(law(0.0, *motors, drive.elastic)) == pytest.approx(share * most, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("wanted", [0.5, 3.0, 90.0])
def test_motors_rest_in_balance_however_far_their_references_are(wanted):
    """sinh(11 x 90) overflows; the motor yields until its torque equals the spring's, in both directions."""
    spring = (11.0, 0.02, 11.0, 0.02, 300.0)
    drive = drive_with(QbMove, mode=6, spring=spring, proportional=(125.0,) * 2, max_torque=(1e9,) * 2)
    found = [rest(drive, 0.0, (side * wanted, side * wanted)) for side in (1.0, -1.0)]
    assert found[0] == pytest.approx((-found[1][0], -found[1][1]))
    torques = QbMove.elastic_torques(0.0, *found[0], spring)
    assert max(torques) < 125.0 * wanted
    for theta, torque in zip(found[0], torques, strict=True):
        assert 125.0 * (wanted - theta) == pytest.approx(torque, rel=1e-6)
