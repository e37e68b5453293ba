"""Cubic term of the series elastic actuator's spring."""

import numpy as np
import pytest
from scipy.integrate import quad

import asrsim
from asrsim.actuators import ACTUATORS

SEA = ACTUATORS.get("sea")
VALUES = (10.0, 40.0, 0.5)
"""10 N m/rad, 40 N m/rad^3, at most 0.5 rad."""


def torque(deflection, values=VALUES):
    return SEA.elastic_torques(0.2, 0.2 + deflection, 0.0, values)[0]


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_torque_is_cubic_until_the_largest_deflection(sign):
    assert torque(0.25 * sign) == pytest.approx(sign * (10.0 * 0.25 + 40.0 * 0.25**3))
    for deflection in (0.5, 0.9):
        assert torque(deflection * sign) == pytest.approx(sign * (10.0 * 0.5 + 40.0 * 0.5**3))
    assert SEA.stiffness(0.2, 0.2 + 0.25 * sign, 0.0, VALUES) == pytest.approx(10.0 + 3.0 * 40.0 * 0.25**2)


@pytest.mark.parametrize("deflection", [-0.8, -0.3, 0.02, 0.4, 0.7])
def test_the_energy_is_the_work_of_the_torque(deflection):
    work = quad(torque, 0.0, deflection, points=[-0.5, 0.5], limit=200)[0]
    assert SEA.elastic_energy(0.2, 0.2 + deflection, 0.0, VALUES) == pytest.approx(work, abs=1e-9)


def test_without_a_cubic_term_the_spring_is_linear():
    for deflection in (-0.3, 0.0, 0.4):
        assert torque(deflection, (10.0, 0.0, 0.5)) == 10.0 * (0.2 + deflection - 0.2)
        assert SEA.stiffness(0.2, 0.2 + deflection, 0.0, (10.0, 0.0, 0.5)) == 10.0


def test_a_negative_cubic_term_softens_the_spring_of_a_run(tiny):
    step = {"elbow": {"equilibrium_position": 0.5}}
    softer = {"elbow": {"spring_cubic": -5.0}}
    run = asrsim.run(asrsim.make_scenario(tiny.robot, references=step, parameters=softer, duration=0.3, compiled=False))[
        "elbow"
    ]
    deflection = run.motor_1_position - run.link_position
    assert np.abs(deflection).max() > 0.05
    np.testing.assert_allclose(run.elastic_torque_1, 10.0 * deflection - 5.0 * deflection**3, atol=1e-12)
