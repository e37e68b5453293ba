"""Limits of joints: torque beyond the velocity limit, in kicks that are cut, too; a brake beyond the effort limit."""

from __future__ import annotations

import numpy as np
import pytest

from asrsim.signals import Constant, PulseTrain, Sinusoid, Sum
from validation.models import INSTALLED, Body, chain, column, run

STIFFNESS, INERTIA, FASTEST = 4.0, 0.01, 1.0
SWINGS = {
    "whole": Constant(value=0.0),
    # Each kick has a jump, of no size that counts.
    "cut": PulseTrain(low=0.0, high=1e-12, period=2e-3, width=1e-3, start=2.5e-4),
}


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("kicks", SWINGS)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_spring_brakes_a_joint_that_is_too_fast_and_drives_it_no_faster(engine: str, kicks: str, sign: float) -> None:
    """Thrown at twice the limit: stopped as by the spring alone, then driven back up to the limit and not beyond."""
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
    # One kick may begin below the limit and end beyond it.
    assert -FASTEST - 1e-3 * rate * 2.0 * FASTEST < speed.min() < -FASTEST
    crossed = (time[1:] > 0.5 * np.pi / rate) & (q[1:] > 0.0) & (speed < -FASTEST)
    assert np.ptp(speed[crossed]) < 1e-6


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("kicks", SWINGS)
@pytest.mark.parametrize("effort", [0.4, 1e6])
@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_a_braking_controller_moves_the_link_by_the_torque_that_is_logged(
    engine: str, kicks: str, effort: float, damping: float
) -> None:
    """I (v_n+1 - v_n) = h tau, to rounding, within the effort limit and at it.

    Where a kick has a jump the row is of the time after it, up to 0.6 of a kick off, in which this torque changes by 0.05 N m.
    """
    limits = f'<limit lower="-30" upper="30" effort="{effort}" velocity="1000"/>'
    body = Body(actuator="sea", mass=1e-9, reach=0.0, inertia=INERTIA, limits=limits, damping=damping)
    wanted = Sum(terms=(Sinusoid(amplitude=0.5, frequency=3.0), SWINGS[kicks]))
    result = run(
        chain(body), mode=1, gravity=0.0, duration=0.3, engine=engine, references={"link_position": wanted}, substeps=1,
        parameters={"controller_1_proportional": 20.0, "controller_1_integral": 30.0, "controller_1_derivative": 0.2},
    )  # fmt: skip
    torque, q = column(result, "link_torque"), column(result, "link_position")
    momentum = INERTIA * np.diff(q) / 1e-3
    pushed = torque + (column(result, "damping_torque") if damping else 0.0)
    assert (np.abs(torque).max() == effort) == (effort < 1.0)
    near = 1e-12 if kicks == "whole" else 5e-5
    np.testing.assert_allclose(momentum[1:] - momentum[:-1], 1e-3 * pushed[1:-1], rtol=0.0, atol=near)
