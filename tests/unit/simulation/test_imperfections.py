"""Imperfections of sensors, and counts of the steps at a limit."""

from dataclasses import replace

import numpy as np
import pytest

from asrsim.scenario.data import Imperfections
from asrsim.signals import Sinusoid, Step
from asrsim.simulation.imperfections import Imperfect
from support.hanging_chain import INERTIA, MASS, NEVER, REACH, joint, plan, samples
from validation.conservation import motors
from validation.models import Body, chain, column, run

LIMITS = '<limit lower="{0}" upper="{1}" effort="{2}" velocity="100"/>'
BODY = Body(actuator="sea", mass=MASS, reach=REACH, inertia=INERTIA)
PROPORTIONAL = joint(
    actuator="sea",
    mode=1,
    references=(NEVER,),
    parameters={"controller_1_proportional": 5.0, "controller_1_integral": 0.0, "controller_1_derivative": 0.0},
)
"""Joint whose torque in N m is -5 times its measured position in rad."""


def test_until_its_delay_has_passed_a_signal_has_its_first_value():
    """Not the value that its law would have before the start."""
    sine = Sinusoid(amplitude=1.0, frequency=5.0, offset=0.2, phase=0.4)
    late = Imperfect(of=sine, imperfections=Imperfections(delay=0.02), step=1e-3, seed=(0,))
    time = np.array([0.0, 0.01, 0.02, 0.05])
    np.testing.assert_allclose(late.values(time), sine.values(np.array([0.0, 0.0, 0.0, 0.03])), atol=1e-12)


def test_readings_are_held_between_the_samples_of_a_sensor(tmp_path):
    """A sensor of 250 Hz in steps of 1 ms."""
    given = plan([replace(PROPORTIONAL, start=0.3, speed=1.0)], 0.05)
    found = samples(given, tmp_path, imperfections={"sensors": {"*": {"rate": 250}}}, substeps=1)
    q, torque = found.values["link_position"][:, 0], found.values["link_torque"][:, 0]
    np.testing.assert_allclose(torque, -5.0 * q[np.arange(len(q)) // 4 * 4], atol=1e-12)


@pytest.mark.parametrize("start", [0.34, -0.36])
def test_readings_are_rounded_to_the_nearest_quantum(tmp_path, start):
    given = plan([replace(PROPORTIONAL, start=start)], 0.01)
    found = samples(given, tmp_path, imperfections={"sensors": {"*": {"quantum": 0.1}}})
    assert found.values["link_torque"][0, 0] == pytest.approx(-5.0 * 0.1 * round(start / 0.1))


def test_each_encoder_has_its_own_noise():
    result = run(
        chain(replace(BODY, actuator="qbmove")),
        mode=6,
        duration=0.1,
        gravity=0.0,
        compiled=False,
        references={"equilibrium_position": 0.0, "stiffness_preset": 0.0},
        sensor_imperfections={"*": Imperfections(noise=0.01)},
    )
    first, second = column(result, "motor_1_torque"), column(result, "motor_2_torque")
    assert abs(np.corrcoef(first[1:], second[1:])[0, 1]) < 0.4
    assert np.std(first) == pytest.approx(np.std(second), rel=0.4)


def test_late_sensors_of_motors_are_of_second_order():
    """Position and velocity belong to one moment, although the motors' velocity is that of half a step before."""
    free = motors("sea", {"motor_1_friction_torque": 0.0, "motor_1_max_velocity": 1e3, "motor_1_max_torque": 1e3})
    found = []
    for substeps in (1, 4, 32):
        result = run(
            chain(replace(BODY, inertia=1e-2)),
            mode=6,
            duration=0.2,
            substeps=substeps,
            motor_substeps=1,
            compiled=False,
            references={"equilibrium_position": Sinusoid(amplitude=0.4, frequency=3.0)},
            parameters={"spring_stiffness": 20.0, **free},
            sensor_imperfections={"*": Imperfections(delay=4e-3)},
        )
        found.append(column(result, "motor_1_position"))
    coarse, fine = (np.abs(positions - found[2]).max() for positions in found[:2])
    assert coarse < 2e-4
    assert np.log2(coarse / fine) / 2.0 > 1.8


@pytest.mark.parametrize(("name", "mode"), [("deflection", 3), ("effort", 3), ("saturation", 6)])
def test_limits_are_counted_on_both_sides(name, mode):
    found = []
    for goal in (0.8, -0.8):
        result = run(
            chain(replace(BODY, inertia=1e-3, limits=LIMITS.format(-3, 3, 1))),
            mode=mode,
            duration=0.1,
            gravity=0.0,
            references={"equilibrium_position": Step(at=0.01, after=goal)},
            compiled=False,
            parameters={"max_deflection": 0.1, "motor_1_max_torque": 3.0, "spring_stiffness": 80.0},
        )
        found.append(int(getattr(result.counts, name)[0]))
    assert found[0] == found[1] > 10


@pytest.mark.parametrize(("start", "rows"), [(0.3, 11), (-0.2, 11), (0.1, 0)])
def test_a_link_exactly_on_its_stop_is_counted(start, rows):
    body = replace(BODY, actuator=None, limits=LIMITS.format(-0.2, 0.3, 100))
    assert run(chain(body), duration=0.01, gravity=0.0, initial=[start]).counts.stop[0] == rows


@pytest.mark.parametrize(("torque", "rows"), [(0.5, 0), (0.5000001, 11), (-0.6, 11)])
def test_a_torque_equal_to_the_effort_limit_is_not_counted(torque, rows):
    body = replace(BODY, limits=LIMITS.format(-30, 30, 0.5))
    result = run(chain(body), mode=0, duration=0.01, gravity=0.0, references={"link_torque": torque})
    assert result.counts.effort[0] == rows
