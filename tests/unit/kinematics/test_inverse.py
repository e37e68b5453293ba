"""Demands of a motion on the parts of a joint."""

from types import SimpleNamespace

import numpy as np
import pytest

from asrsim.actuators import Sea
from asrsim.kinematics.drive_inverse import drive_backwards
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
        "joint effort": (0.8, 3.0, "N"), "motor torque": (abs(push), 2.0, "N"), "motor speed": (abs(w * theta), 4.0, "m/s"),
        "spring torque": (0.8, 1.0, "N"), "spring deflection": (0.04, 0.05, "m"), "joint stop": (0.5, 0.4, "m"),
    }  # fmt: skip
    assert demands.keys() == wanted.keys()
    for what, (needed, limit, unit) in wanted.items():
        one = demands[what]
        assert (abs(one.needed), abs(one.limit), one.unit) == (pytest.approx(needed, rel=0.01), pytest.approx(limit), unit), (
            what
        )
