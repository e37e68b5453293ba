"""The linearised joints against closed forms, and predictions of convergence against what then happens."""

from __future__ import annotations

import math

import numpy as np
import pytest
from asrsim.learning.prediction import predictor

from asrsim.actuators import QbMove, Sea
from asrsim.kinematics import JointDrive
from asrsim.learning import LearningProblem, LearningSettings, choose_gains, learn, linearise

MASS, LENGTH, GRAVITY = 0.5, 0.08, 9.81
INERTIA = MASS * LENGTH**2


class Pendulum:
    """One link that hangs at q = 0."""

    joints = ("one",)

    def mass_matrix(self, positions):
        return np.array([[INERTIA]])

    def gravity_torques(self, positions):
        return np.array([MASS * GRAVITY * LENGTH * math.sin(positions[0])])


def sea(mode=3, k=2.0):
    motors = {"proportional": (125.0,), "integral": (0.0,), "derivative": (4.5,), "max_torque": (6.0,)}
    motors |= {"motor_inertia": (0.0233,), "motor_damping": (0.27,)}
    return JointDrive(joint="one", actuator=Sea, mode=mode, spring=(k, 0.8), **(motors if mode == 6 else {}))


def test_response_of_a_pendulum_on_a_spring_is_the_second_order_system():
    dynamics = linearise(Pendulum(), [sea()], {"one": 0.3}, [0.5], [0.0], {"one": 0.02})
    slope = MASS * GRAVITY * LENGTH * math.cos(0.3)
    for omega in (0.0, 3.0, 40.0):
        expected = 2.0 / (-(omega**2) * INERTIA + 1j * omega * 0.02 + 2.0 + slope)
        assert dynamics.response(omega)[0, 0] == pytest.approx(expected, rel=1e-6)


def test_motor_and_spring_in_series_at_rest():
    dynamics = linearise(Pendulum(), [sea(mode=6)], {"one": 0.0}, [0.0], [0.0], {})
    series = 2.0 * 125.0 / (2.0 + 125.0)
    assert dynamics.response(0.0)[0, 0].real == pytest.approx(series / (series + MASS * GRAVITY * LENGTH), rel=1e-6)


def test_response_of_motor_and_link_satisfies_both_equations_of_motion():
    dynamics = linearise(Pendulum(), [sea(mode=6)], {"one": 0.0}, [0.0], [0.0], {"one": 0.02})
    omega = 25.0
    q = complex(dynamics.response(omega)[0, 0])
    s = 1j * omega
    theta = (125.0 + 2.0 * q) / (0.0233 * s**2 + (0.27 + 4.5) * s + 125.0 + 2.0)
    left = (INERTIA * s**2 + 0.02 * s + MASS * GRAVITY * LENGTH) * q
    assert left == pytest.approx(2.0 * (theta - q), rel=1e-6)


def test_slopes_of_two_springs_are_those_of_the_law():
    spring = (11.0, 0.02, 7.0, 0.05, 0.8)
    drive = JointDrive(joint="one", actuator=QbMove, mode=3, spring=spring)
    dynamics = linearise(Pendulum(), [drive], {"one": 0.1}, [0.3], [0.2], {})
    assert sum(dynamics.springs[0]) == pytest.approx(QbMove.stiffness(0.1, 0.5, 0.1, spring), rel=1e-8)


def test_the_chosen_gain_levels_the_slowest_errors():
    soft = linearise(Pendulum(), [sea(k=1.0)], {"one": 0.0}, [0.0], [0.0], {})
    stiff = linearise(Pendulum(), [sea(k=5.0)], {"one": 0.0}, [0.0], [0.0], {})
    gains = choose_gains([soft, stiff], largest=10.0)
    assert soft.contraction(gains, 0.0) == pytest.approx(stiff.contraction(gains, 0.0))
    assert choose_gains([soft, stiff]) == (1.0,)


def test_errors_beyond_the_learnable_band_do_not_shrink():
    dynamics = linearise(Pendulum(), [sea()], {"one": 0.0}, [0.0], [0.0], {"one": 0.005})
    band = dynamics.learnable((0.5,))
    assert 0.0 < band < 20.0
    assert dynamics.contraction((0.5,), 2 * math.pi * (band - 0.1)) < 1.0
    assert dynamics.contraction((0.5,), 2 * math.pi * (band + 0.2)) >= 1.0


def hanging(drive, preset):
    """Statics of the pendulum on its springs: the link position at each input, by bisection."""

    def outputs(inputs):
        low, high = np.full(len(inputs), -2.0), np.full(len(inputs), 2.0)
        for _ in range(60):
            middle = 0.5 * (low + high)
            lift = np.array(
                [
                    sum(drive.actuator.elastic_torques(q, *drive.actuator.motor_references(u, preset), drive.spring))
                    for q, u in zip(middle, inputs[:, 0], strict=True)
                ]
            )
            up = lift > MASS * GRAVITY * LENGTH * np.sin(middle)
            low, high = np.where(up, middle, low), np.where(up, high, middle)
        return middle[:, None]

    return outputs


def slow_problem():
    time = np.linspace(0.0, 20.0, 101)
    s = time / 20.0
    wanted = 0.8 * (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None]
    return LearningProblem(joints=("one",), time=time, reference=wanted, first_guess=np.zeros_like(wanted))


def test_the_predicted_rate_is_the_measured_one_where_the_spring_is_linear():
    drive = sea()
    problem = slow_problem()
    settings = LearningSettings(gains=(0.6,), gain_decay=None, tolerance=1e-3, max_iterations=6)
    result = learn(problem, hanging(drive, 0.0), settings, predict=predictor(problem, Pendulum(), [drive], [0.0], {"one": 0.0}))
    for trial in result.trials[2:]:
        assert trial.predicted == pytest.approx(trial.ratio, abs=0.02)


def test_the_predicted_rate_is_close_for_hyperbolic_springs_too():
    drive = JointDrive(joint="one", actuator=QbMove, mode=3, spring=(6.257, 0.01038, 3.9, 0.08918, 0.8))
    problem = slow_problem()
    result = learn(
        problem,
        hanging(drive, 0.2),
        LearningSettings(gains=(0.5,), tolerance=0.04, max_iterations=15),
        predict=predictor(problem, Pendulum(), [drive], [0.2], {"one": 0.0}),
    )
    assert result.converged
    assert all(trial.predicted == pytest.approx(trial.ratio, abs=0.08) for trial in result.trials[1:])
