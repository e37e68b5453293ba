"""The linearised joints against closed forms and against the simulation."""

import math
from dataclasses import replace

import numpy as np
import pytest

from asrsim.actuators import QbMove, Sea
from asrsim.kinematics.drive_inverse import DesiredMotion
from asrsim.learning.linear import linearise_along, spring_slopes
from asrsim.learning.optimal import EVERY, InputSplines, lift
from asrsim.learning.prepared import learning_model
from support.lessons import plant_of
from support.robots import drive_with
from support.soft_arm import random_arm

MASS, LENGTH, GRAVITY = 0.5, 0.08, 9.81
INERTIA = MASS * LENGTH**2


class Pendulum:
    """One link that hangs at q = 0."""

    joints = ("one",)

    def inverse_dynamics(self, positions, velocities, accelerations):
        return INERTIA * accelerations + MASS * GRAVITY * LENGTH * np.sin(positions)


def sea(mode=3, k=2.0, **changes):
    motors = {"proportional": (125.0,), "integral": (0.0,), "derivative": (4.5,), "max_torque": (6.0,)}
    motors |= {"inertia": (0.0233,), "damping": (0.27,), "friction_torque": (0.0,), "max_velocity": (6.0,)}
    return drive_with(Sea, mode=mode, joint="one", spring=(k, 0.8), **({**motors, **changes} if mode == 6 else {}))


def linear_at(drive, position=0.0, motors=(0.0, 0.0), damping=0.0, count=41, end=2.0):
    time = np.linspace(0.0, end, count)
    still = np.zeros((count, 1))
    motion = DesiredMotion(time=time, positions=still + position, velocities=still, accelerations=still)
    springs = spring_slopes(drive, motion.positions[:, 0], np.tile(motors, (count, 1)))[:, None]
    return linearise_along(Pendulum(), [drive], motion, springs, [damping])


def response(linear, omega):
    change, inputs = (values[0] for values in linear.continuous)
    return complex(np.linalg.solve(1j * omega * np.eye(len(change)) - change, inputs)[0, 0])


def test_a_pendulum_on_a_spring_responds_as_second_order_system():
    linear = linear_at(sea(), 0.3, (0.5, 0.0), 0.02)
    slope = MASS * GRAVITY * LENGTH * math.cos(0.3)
    for omega in (0.0, 3.0, 40.0):
        expected = 2.0 / (-(omega**2) * INERTIA + 1j * omega * 0.02 + 2.0 + slope)
        assert response(linear, omega) == pytest.approx(expected, rel=1e-6)


def test_a_controller_of_the_link_responds_as_a_spring_and_a_damper():
    drive = drive_with(Sea, mode=1, joint="one", spring=(2.0, 0.8), proportional=(5.0,), integral=(0.0,), derivative=(0.3,))
    omega = 12.0
    expected = 5.0 / (-(omega**2) * INERTIA + 1j * omega * (0.02 + 0.3) + 5.0 + MASS * GRAVITY * LENGTH)
    assert response(linear_at(drive, damping=0.02), omega) == pytest.approx(expected, rel=1e-6)


def test_response_of_motor_and_link_satisfies_both_equations_of_motion():
    omega = 25.0
    q = response(linear_at(sea(mode=6), damping=0.02), omega)
    s = 1j * omega
    theta = (125.0 + 2.0 * q) / (0.0233 * s**2 + (0.27 + 4.5) * s + 125.0 + 2.0)
    left = (INERTIA * s**2 + 0.02 * s + MASS * GRAVITY * LENGTH) * q
    assert left == pytest.approx(2.0 * (theta - q), rel=1e-6)


def test_two_unequal_motors_and_springs_satisfy_their_equations_of_motion():
    """At rest, with both motors at the link, the slope of k sinh(a x) is k a."""
    stiffness, masses, losses = np.array([9.0 * 0.2, 6.0 * 0.5]), np.array([0.02, 0.05]), np.array([0.3, 0.7])
    gains, rates = np.array([80.0, 125.0]), np.array([2.0, 4.5])
    motors = {"inertia": masses, "damping": losses, "proportional": gains, "derivative": rates, "integral": (0.0, 0.0)}
    limits = {"max_torque": (6.0, 6.0), "max_velocity": (6.0, 6.0), "friction_torque": (0.0, 0.0)}
    drive = drive_with(QbMove, (9.0, 0.2, 6.0, 0.5, 0.8), mode=6, joint="one", **motors, **limits)
    omega = 25.0
    s = 1j * omega
    motor = masses * s**2 + (losses + rates) * s + gains + stiffness
    link = INERTIA * s**2 + 0.02 * s + MASS * GRAVITY * LENGTH + stiffness.sum()
    expected = (stiffness * gains / motor).sum() / (link - (stiffness**2 / motor).sum())
    assert response(linear_at(drive, damping=0.02), omega) == pytest.approx(expected, rel=1e-6)


def test_a_motion_that_is_held_keeps_its_time_step_and_its_last_joints():
    linear = linear_at(sea(), 0.3, (0.5, 0.0), count=41, end=2.0)
    held = linear.held(0.3)
    np.testing.assert_allclose(held.time, np.linspace(0.0, 2.3, 47), atol=1e-12)
    for name in ("mass", "rates", "slopes", "springs"):
        before, after = getattr(linear, name), getattr(held, name)
        assert np.array_equal(after[:41], before)
        assert np.array_equal(after[41:], np.repeat(before[-1:], 6, axis=0))


@pytest.mark.parametrize("mode", [3, 6])
def test_what_an_input_does_follows_the_motion(mode):
    """A spring that stiffens and an inertia that grows: each step has the joints as they are in its middle."""
    linear = linear_at(sea(mode), count=401)
    grows = np.linspace(1.0, 3.0, 401)
    changing = replace(linear, springs=linear.springs * grows[:, None, None], mass=linear.mass * grows[:, None, None])
    states, inputs = changing.steps
    for index in (0, 200, 399):
        factor = 0.5 * (grows[index] + grows[index + 1])
        there = replace(linear, springs=linear.springs * factor, mass=linear.mass * factor).steps
        np.testing.assert_allclose(states[index], there[0][index], rtol=1e-5, atol=1e-7)
        np.testing.assert_allclose(inputs[index], there[1][index], rtol=1e-5, atol=1e-7)


def test_slopes_of_two_springs_are_those_of_the_law():
    spring = (11.0, 0.02, 7.0, 0.05, 0.8)
    drive = drive_with(QbMove, mode=3, joint="one", spring=spring)
    slopes = spring_slopes(drive, np.array([0.1]), np.array([[0.5, 0.1]]))
    assert slopes.sum() == pytest.approx(QbMove.stiffness(0.1, 0.5, 0.1, spring), rel=1e-8)


@pytest.mark.parametrize("motor", [0.81, 3.0, -3.0])
def test_a_spring_beyond_its_limit_is_taken_just_before_it(motor):
    """At the limit it has no slope, and nothing could be learned from there."""
    assert spring_slopes(sea(), np.zeros(1), np.array([[motor, 0.0]]))[0, 0] == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize("mode", [3, 6])
def test_a_motion_from_rest_starts_at_the_equilibrium_of_its_first_input(mode):
    """Under a constant input, the pendulum stays where spring and gravity balance."""
    linear = linear_at(sea(mode))
    moved = lift(linear, InputSplines.over(2.0, 0.0), [0.0], from_rest=True).sum(axis=2)
    assert moved == pytest.approx(response(linear, 0.0).real, rel=1e-6)


@pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.slow), 2])
def test_the_simulated_arm_answers_as_its_linearisation(seed, tmp_path):
    """A small bump of the input changes the motion of arms without friction as predicted, within 3 %."""
    arm, *motion = random_arm(seed)
    plant = plant_of(tmp_path, arm.scaled(lambda name: 0.0 if "friction" in name else 1.0), *motion)
    bump = 0.02 * np.exp(-(((plant.time - 0.5 * plant.time[-1]) / 0.15) ** 2))[:, None] * np.ones(len(plant.joints))
    model = learning_model(plant)
    linear, band = model.linear, InputSplines.over(plant.time[-1], 0.0)
    splines = np.linalg.lstsq(band.at(plant.time).toarray(), bump, rcond=None)[0].ravel()
    expected = lift(linear, band, [0.0] * len(plant.joints)) @ splines
    rows = np.searchsorted(plant.time, linear.time[EVERY::EVERY] - 1e-9)
    inputs = model.guess
    moved = (plant.outputs(inputs + bump) - plant.outputs(inputs))[rows]
    assert np.abs(moved - expected).max() < 0.03 * np.abs(moved).max()
