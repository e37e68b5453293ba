"""Substeps and motor substeps have second order. For the order of random robots see test_random_robots.py."""

from __future__ import annotations

import numpy as np

from validation.fitting import orders
from validation.models import Body, chain, run

LINK = Body(actuator="sea", mass=0.5, reach=0.08, inertia=6e-4, length=0.1)


def test_substeps_equal_smaller_steps() -> None:
    """A step of 1 ms with four substeps moves as steps of 0.25 ms do, within 5 % of the difference to a step of 1 ms."""
    arguments = {
        "mode": 3, "references": {"equilibrium_position": 0.5}, "parameters": {"spring_stiffness": 20.0},
        "initial": [-0.3, 0.4], "duration": 0.6,
    }  # fmt: skip
    runs = [
        run(chain(LINK, LINK), step=step, substeps=substeps, **arguments)
        for step, substeps in ((1e-3, 4), (2.5e-4, 1), (1e-3, 1))
    ]
    split, small, coarse = (np.asarray(result.samples.values["link_position"]) for result in runs)
    small = small[::4]
    assert np.abs(split - small).max() < 0.05 * np.abs(coarse - small).max()


def test_motor_substeps_keep_the_order() -> None:
    """A stiff preset on a light link needs finer steps for the motors than for the world."""
    body = Body(actuator="qbmove", mass=0.5, reach=0.08, inertia=6e-4, damping=0.05)
    found = []
    for step in (1e-3, 2.5e-4, 1e-3 / 64.0):
        result = run(
            chain(body), mode=6, duration=0.3, step=step, substeps=1, motor_substeps=3,
            references={"equilibrium_position": 0.5, "stiffness_preset": 0.4},
            parameters={"motor_1_friction_torque": 0.0, "motor_2_friction_torque": 0.0},
        )  # fmt: skip
        assert result.samples is not None
        found.append(result.samples.values["link_position"][:: round(1e-3 / step), 0])
    coarse, fine = (float(np.max(np.abs(q - found[-1]))) for q in found[:2])
    assert orders([coarse, fine], 4.0)[0] > 1.7
