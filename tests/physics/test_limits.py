"""Limits of joints: torque beyond the velocity limit, in kicks that are cut, too; a brake beyond the effort limit."""

from __future__ import annotations

import numpy as np
import pytest

from asrsim.signals import Constant, PulseTrain
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
