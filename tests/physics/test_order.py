"""Motor substeps keep the second order. For the order of random robots see test_random_robots.py."""

import numpy as np

from validation.fitting import orders
from validation.models import Body, chain, run


def test_motor_substeps_keep_the_order():
    """A stiff preset on a light link needs finer steps for the motors than for the world."""
    body = Body(actuator="qbmove", mass=0.5, reach=0.08, inertia=6e-4, damping=0.05)
    found = []
    for step in (1e-3, 2.5e-4, 1e-3 / 64.0):
        result = run(
            chain(body),
            mode=6,
            duration=0.3,
            step=step,
            substeps=1,
            motor_substeps=3,
            references={"equilibrium_position": 0.5, "stiffness_preset": 0.4},
            parameters={"motor_1_friction_torque": 0.0, "motor_2_friction_torque": 0.0},
        )
        assert result.samples is not None
        found.append(result.samples.values["link_position"][:: round(1e-3 / step), 0])
    coarse, fine = (float(np.max(np.abs(q - found[-1]))) for q in found[:2])
    assert orders([coarse, fine], 4.0)[0] > 1.7
