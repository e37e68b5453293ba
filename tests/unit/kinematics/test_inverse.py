"""Demands of a motion on the parts of a joint."""

from types import SimpleNamespace

import numpy as np
import pytest

from asrsim.actuators import Actuator, QbMove, Sea
from asrsim.kinematics.drive_inverse import DriveMotion, drive_backwards
from asrsim.kinematics.inverse import demands_of
from support.robots import drive_with


def test_demands_on_a_spring_and_its_motor_are_those_of_the_closed_form():
    """All motions are the real parts of complex amplitudes times exp(i w t)."""
    stiffness, inertia, damping, w = 20.0, 0.02, 0.1, 2.0 * np.pi
    motor = {"inertia": inertia, "damping": damping, "friction_torque": 0.0, "max_torque": 2.0, "max_velocity": 4.0,
             "proportional": 50.0, "integral": 0.0, "derivative": 1.0}  # fmt: skip
    drive = drive_with(Sea, (stiffness, 0.05), mode=6, **{name: (value,) for name, value in motor.items()})
    q, torque = -0.5j, 0.8
    theta = q + torque / stiffness
    push = (-inertia * w**2 + 1j * w * damping) * theta + torque
    time = np.linspace(0.0, 3.0, 3001)

    def real(amplitude):
        return np.real(amplitude * np.exp(1j * w * time))

    found = drive_backwards(drive, time, real(q), real(1j * w * q), real(torque), 0.0 * time)
    np.testing.assert_allclose(found.inputs[500:2500], real(theta + (push + 1j * w * theta) / 50.0)[500:2500], atol=1e-3)
    joint = SimpleNamespace(most_effort=3.0, stops=(-0.4, 0.45), kind="prismatic")
    demands = {one.what: one for one in demands_of(drive, time, real(q), real(torque), found, joint)}
    wanted = {
        "joint effort": (0.8, 3.0, "N"),
        "motor torque": (abs(push), 2.0, "N"),
        "motor speed": (abs(w * theta), 4.0, "m/s"),
        "spring torque": (0.8, 1.0, "N"),
        "spring deflection": (0.04, 0.05, "m"),
        "joint stop": (0.5, 0.4, "m"),
    }
    assert demands.keys() == wanted.keys()
    for what, (needed, limit, unit) in wanted.items():
        one = demands[what]
        assert (abs(one.needed), abs(one.limit), one.unit) == (pytest.approx(needed, rel=0.01), pytest.approx(limit), unit), (
            what
        )


def test_of_two_springs_the_less_deflected_one_counts():
    drive = drive_with(QbMove, (9.0, 0.002, 9.0, 0.002, 0.8), mode=3)
    time, still = np.linspace(0.0, 1.0, 11), np.ones(11)
    item = DriveMotion(inputs=still, motors=np.outer(still, [0.5, -0.4]), motor_torques=np.empty((11, 0)), holdable=2.0 * still)
    joint = SimpleNamespace(most_effort=3.0, stops=(-1.0, 1.0), kind="revolute")
    demands = {one.what: one for one in demands_of(drive, time, 0.2 * still, 0.5 * still, item, joint)}
    assert demands.keys() == {"joint effort", "spring torque", "spring deflection"}
    assert demands["spring deflection"].needed == pytest.approx(0.3)


@pytest.mark.parametrize("on_housing", [0, 1])
def test_three_motors_with_unequal_gains_hold_a_link_as_their_static_balance_says(on_housing):
    """The laws and the reference map are linear here: four equations for three motors and the equilibrium. The torque of a
    motor on the housing does not act on the link."""
    stiffness, gains, preset, q, torque = np.array([5.0, 8.0, 12.0]), np.array([30.0, 60.0, 90.0]), 0.2, 0.3, 2.5

    class Three(Actuator):
        name, motors, housed = "three_unequal", 3, on_housing

        @staticmethod
        def elastic_torques(q, theta_1, theta_2, theta_3, parameters):
            return 5.0 * (theta_1 - q), 8.0 * (theta_2 - q), 12.0 * (theta_3 - q)

        @staticmethod
        def motor_references(equilibrium, preset):
            return equilibrium + preset, 2.0 * equilibrium, equilibrium - 3.0 * preset

    values = {
        "proportional": gains,
        "integral": np.zeros(3),
        "derivative": np.ones(3),
        "inertia": np.full(3, 0.01),
        "damping": np.full(3, 0.1),
        "friction_torque": np.zeros(3),
    }
    drive = drive_with(Three, (), mode=6, **{name: tuple(value) for name, value in values.items()})
    time = np.linspace(0.0, 1.0, 101)
    still = np.zeros(101)
    found = drive_backwards(drive, time, still + q, still, still + torque, still + preset)
    rho, offsets = np.array([1.0, 2.0, 1.0]), np.array([preset, 0.0, -3.0 * preset])
    # Unknown: theta_i and e; k_i (theta_i - q) = P_i (rho_i e + c_i - theta_i), sum k_i (theta_i - q) = torque on the link.
    link = stiffness * (np.arange(3) < 3 - on_housing)
    balance = np.block([[np.diag(stiffness + gains), -(gains * rho)[:, None]], [link, 0.0]])
    *motors, equilibrium = np.linalg.solve(balance, [*(gains * offsets + stiffness * q), torque + link.sum() * q])
    np.testing.assert_allclose(found.motors[50], motors, atol=1e-6)
    assert found.inputs[50] == pytest.approx(equilibrium, abs=1e-6)
