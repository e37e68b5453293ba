"""Substeps and motor substeps have second order. For the order of random robots see test_random_robots.py."""

from dataclasses import replace

import numpy as np

from asrsim.signals import PulseTrain
from validation.fitting import orders
from validation.models import Body, chain, column, run

LINK = Body(actuator="sea", mass=0.5, reach=0.08, inertia=6e-4, length=0.1)


def test_motor_substeps_keep_the_order():
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


def test_motors_that_need_substeps_have_them_in_split_kicks_too():
    """A light motor, 2500 rad/s with its controller, whose reference jumps twice in each step."""
    jumps = PulseTrain(start=0.0023, period=0.0009, width=0.0004, low=0.3, high=0.32)
    found = []
    for step in (1e-3, 1e-3 / 32):
        result = run(
            chain(replace(LINK, damping=0.05)), mode=6, duration=0.1, step=step, references={"equilibrium_position": jumps},
            parameters={
                "spring_stiffness": 50.0, "motor_1_inertia": 2e-5, "motor_1_damping": 0.002, "motor_1_friction_torque": 0.0,
                "motor_1_max_velocity": 1e4, "motor_1_max_torque": 100.0, "controller_1_derivative": 0.02,
            },
        )  # fmt: skip
        found.append(np.asarray(column(result, "motor_1_position"))[:: round(1e-3 / step)])
    assert np.abs(found[0] - found[1]).max() < 5e-3
