"""MACCEPA, AwAS and the cam VSA against the geometry of their mechanisms; a spring between the motors of a custom actuator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import asrsim
from asrsim.actuators import ACTUATORS, Antagonistic, Parameter
from asrsim.actuators.awas import Awas
from asrsim.actuators.checker import check_actuator
from asrsim.actuators.maccepa import Maccepa
from asrsim.actuators.quadratic_cam import QuadraticCam


@pytest.mark.parametrize("name", ["maccepa", "awas", "quadratic_cam"])
def test_the_classics_are_certified_by_the_checker(name):
    report = check_actuator(ACTUATORS.get(name))
    assert [check.name for check in report.checks if not check.passed] == []


@pytest.mark.parametrize("d", [-0.9, -0.2, 0.05, 0.6])
def test_the_torque_of_maccepa_is_that_of_a_cable_at_a_lever(d):
    k, lever, hole, tension = 4000.0, 0.05, 0.09, 0.02
    tip, end = lever * np.array([np.cos(d), np.sin(d)]), np.array([hole, 0.0])  # in the link's frame
    cable = np.linalg.norm(tip - end)
    pull = k * (cable - (hole - lever) + tension) * (tip - end) / cable  # force of the cable on the link, at its hole
    torque = end[0] * pull[1] - end[1] * pull[0]
    assert Maccepa.elastic_torques(0.0, d, tension, (k, lever, hole, 1.0))[0] == pytest.approx(torque, rel=1e-12)


def test_the_stiffness_of_maccepa_has_the_range_that_edinburgh_published_for_its_joint():
    """-0.657894 to 0.415422 N m/rad: libmaccepa (Howard 2010) for 323 N/m, a lever of 0.03 m, and half a turn of a drum of
    7.5 mm, over sampled positions. The distance of the hole, 0.13 m, is not stated: one number for two."""
    constants, tension = (323.0, 0.03, 0.13, 4.0), 7.5e-3 * np.pi
    stiffness = [
        Maccepa.stiffness(0.0, d, pull, constants) for d in np.linspace(-np.pi, np.pi, 1001) for pull in (0.0, tension)
    ]
    assert min(stiffness) == pytest.approx(-0.657894, abs=1e-6)
    assert max(stiffness) == pytest.approx(0.415422, rel=1e-4)


@pytest.mark.parametrize("d", [-0.25, 0.1, 0.29])
def test_the_torque_of_awas_is_that_of_two_springs_at_a_lever(d):
    k, r = 6000.0, 0.07
    tip = r * np.array([np.cos(d), np.sin(d)])
    forces = [-k * tip[1], -k * tip[1]]  # both springs, tensed and released by r sin(d), along the tangent at rest
    assert Awas.elastic_torques(0.0, d, r, (k, 0.3))[0] == pytest.approx(-sum(forces) * tip[0], rel=1e-12)


@pytest.mark.parametrize("preset", [0.1, 0.3])
def test_the_stiffness_of_the_quadratic_cam_is_linear_in_the_preset_at_any_deflection(preset):
    a, b, r = 1.5e5, 400.0, 0.02
    expected = 4 * a * r**3 * preset + 2 * b * r**2
    for q in np.linspace(-0.9, 0.9, 7) * preset:
        motors = QuadraticCam.motor_references(0.0, preset)
        assert QuadraticCam.stiffness(q, *motors, (a, b, r, 0.8)) == pytest.approx(expected, rel=1e-12)
        assert sum(QuadraticCam.elastic_torques(q, *motors, (a, b, r, 0.8))) == pytest.approx(-expected * q, rel=1e-9)


def test_a_slack_cable_does_not_push():
    assert QuadraticCam.elastic_torques(0.0, -0.2, 0.2, (1e5, 400.0, 0.02, 0.8)) == (0.0, 0.0)


class Coupled(Antagonistic):
    """Linear springs, and one between the motors: g(theta_1, theta_2) = c (theta_1 - theta_2), below eq. 6 of the paper."""

    name = "coupled_for_test"
    title = "Coupled motors"
    source = "Mengacci et al. (2021), below eq. 6"
    parameters = (
        Parameter(name="spring", default=6.0, unit="N m/rad", doc="k", source="test"),
        Parameter(name="coupling", default=4.0, unit="N m/rad", doc="c", source="test"),
    )

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, parameters):
        k, c = parameters
        between = c * (theta_1 - theta_2)
        return k * (theta_1 - q) + between, k * (theta_2 - q) - between

    @staticmethod
    def stiffness(q, theta_1, theta_2, parameters):
        return 2.0 * parameters[0]

    @staticmethod
    def elastic_energy(q, theta_1, theta_2, parameters):
        k, c = parameters
        return 0.5 * k * ((theta_1 - q) ** 2 + (theta_2 - q) ** 2) + 0.5 * c * (theta_1 - theta_2) ** 2


def test_a_spring_between_the_motors_is_a_law_that_the_checker_certifies():
    assert check_actuator(Coupled).passed


def test_motors_coupled_by_a_spring_move_as_the_equations_say(tiny):
    ACTUATORS.add(Coupled.name, Coupled)
    k, c, inertia, damping, motor, drag = 6.0, 4.0, 6e-3, 0.2, 0.02, 0.1
    values = {"inertia": motor, "damping": drag, "friction_torque": 0.0, "max_velocity": 1e3}
    scenario = asrsim.make_scenario(
        robot=tiny.robot,
        duration=0.5,
        step=0.0005,
        gravity=[0, 0, 0],
        actuators={"elbow": {"type": Coupled.name, "mode": 4}},
        parameters={"elbow": {f"motor_{i}_{name}": value for i in (1, 2) for name, value in values.items()}},
        references={"elbow": {"motor_1_torque": 0.5, "motor_2_torque": -0.2}},
    )
    samples = asrsim.run(scenario).samples

    def slope(_, y):
        q, t1, t2, v, w1, w2 = y
        s1, s2, g = k * (t1 - q), k * (t2 - q), c * (t1 - t2)
        pulls = (s1 + s2 - damping * v) / inertia, (0.5 - drag * w1 - s1 - g) / motor, (-0.2 - drag * w2 - s2 + g) / motor
        return [v, w1, w2, *pulls]

    exact = solve_ivp(slope, (0, 0.5), np.zeros(6), rtol=1e-10, atol=1e-12).y[:3, -1]
    last = [samples.values[name][-1, 0] for name in ("link_position", "motor_1_position", "motor_2_position")]
    np.testing.assert_allclose(last, exact, atol=2e-5)
