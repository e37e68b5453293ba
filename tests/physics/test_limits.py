"""Velocity and effort limits of joints, also in substeps that are split by a jump of an input."""

import numpy as np
import pytest

from asrsim.signals import Constant, PulseTrain
from validation.models import INSTALLED, Body, chain, column, run

STIFFNESS, INERTIA, FASTEST = 4.0, 0.01, 1.0
SWINGS = {
    "whole": Constant(value=0.0),
    # Every kick contains a jump of negligible size.
    "cut": PulseTrain(low=0.0, high=1e-12, period=2e-3, width=1e-3, start=2.5e-4),
}


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("kicks", SWINGS)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_velocity_cutoff_lets_springs_brake_but_not_accelerate(engine, kicks, sign):
    """The joint starts at twice the limit. The spring alone stops it, then drives it back up to the limit."""
    limits = f'<limit lower="-30" upper="30" effort="1e6" velocity="{FASTEST}"/>'
    body = Body(actuator="sea", mass=1e-9, reach=0.0, inertia=INERTIA, limits=limits)
    result = run(
        chain(body), mode=3, gravity=0.0, duration=0.25, engine=engine, references={"equilibrium_position": SWINGS[kicks]},
        parameters={"spring_stiffness": STIFFNESS}, velocity_cutoff=True, initial_velocities={"joint_1": 2.0 * sign * FASTEST},
    )  # fmt: skip
    q, rate = sign * column(result, "link_position"), (STIFFNESS / INERTIA) ** 0.5
    speed = np.diff(q) / np.diff(result.samples.time)
    time = result.samples.time
    braked = time <= 0.5 * np.pi / rate
    np.testing.assert_allclose(q[braked], 2.0 * FASTEST / rate * np.sin(rate * time[braked]), atol=2e-4)
    # A kick may start below the limit and end above it.
    assert -FASTEST - 1e-3 * rate * 2.0 * FASTEST < speed.min() < -FASTEST
    crossed = (time[1:] > 0.5 * np.pi / rate) & (q[1:] > 0.0) & (speed < -FASTEST)
    assert np.ptp(speed[crossed]) < 1e-6


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("engine", INSTALLED)
def test_a_moving_link_starts_with_the_effort_limit_alone(engine, compiled):
    """The derivative action wants twice the limit E at the start and more than E until the end: q = v t - E t^2 / (2 I)."""
    effort, speed = 0.5, 1.0
    limits = f'<limit lower="-30" upper="30" effort="{effort}" velocity="1000"/>'
    result = run(
        chain(Body(actuator="sea", mass=1e-9, reach=0.0, inertia=INERTIA, limits=limits)), mode=1, gravity=0.0,
        duration=0.008, substeps=1, engine=engine, compiled=compiled, initial_velocities={"joint_1": speed},
        references={"link_position": 0.0},
        parameters={
            "controller_1_proportional": 0.0, "controller_1_integral": 0.0, "controller_1_derivative": 2.0 * effort / speed,
        },
    )  # fmt: skip
    time = result.samples.time
    moved = speed * time - 0.5 * effort / INERTIA * time**2
    np.testing.assert_allclose(column(result, "link_position"), moved, rtol=0.0, atol=1e-12)
