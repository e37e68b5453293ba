"""Engine of a test bench: links follow prescribed motions, and motors start at rest."""

import math

import numpy as np
import pytest

import asrsim
from asrsim.engines import bench
from asrsim.engines.base import POSITION, VELOCITY
from asrsim.robot import load_robot
from asrsim.signals.sines import Sinusoid
from support.paths import EXAMPLES

INERTIA, DAMPING, TORQUE = 0.0233, 0.2698, 6.0
FREE = {"spring_stiffness": 1e-9, "motor_1_friction_torque": 0.0, "motor_1_max_velocity": 1000.0}


def on_bench(**keys):
    return asrsim.make_scenario(EXAMPLES / "urdf" / "dof1_sea.urdf", engine="bench", modes=5, **keys)


def test_a_motor_starts_from_rest_at_second_order():
    duration, lag = 0.01, INERTIA / DAMPING
    position = TORQUE / DAMPING * (duration - lag * (1 - math.exp(-duration / lag)))
    errors = []
    for step in (1e-3, 5e-4):
        references = {"joint_1": {"reference_1": 5.0}}
        start = {"joint_1": {"motor_positions": [0.0]}}
        scenario = on_bench(duration=duration, step=step, parameters={"*": FREE}, references=references, initial=start)
        found = asrsim.run(scenario)["joint_1"]
        assert (found["motor_1_position"][0], found["motor_1_velocity"][0]) == (0.0, 0.0)
        errors.append(abs(found["motor_1_position"][-1] - position))
    assert errors[0] < 4e-5
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)


def test_motors_start_at_the_start_of_a_prescribed_motion():
    """So the springs are undeflected."""
    scenario = on_bench(duration=0.01, motion={"joint_1": 0.3}, references={"joint_1": {"reference_1": 0.3}})
    found = asrsim.run(scenario)["joint_1"]
    assert found["motor_1_position"][0] == 0.3
    assert found["link_torque"][0] == 0.0


def test_the_links_follow_their_signals_in_any_order_of_steps():
    sine = {"sinusoid": {"amplitude": 0.5, "frequency": 7.0, "phase": 0.3}}
    scenario = on_bench(duration=0.1, motion={"joint_1": sine})
    signal = Sinusoid(amplitude=0.5, frequency=7.0, phase=0.3)
    engine = bench.BenchEngine(scenario, load_robot(scenario.robot))
    engine.start([0.0], [0.0], step=scenario.step, staggered=True, implicitness=0.5)
    exchange = np.zeros((1, 1, 6))
    for row in (*range(1, 20), 3, 4, 90, 89, 1, 31, 32):
        engine.state = row - 1
        engine.step(exchange, np.zeros((1, 0, 6)), np.ones(1))
        before, here = signal.values(np.array([row - 1, row]) * scenario.step)
        assert exchange[0, 0, POSITION] == pytest.approx(here, abs=1e-12)
        assert exchange[0, 0, VELOCITY] == pytest.approx((here - before) / scenario.step, abs=1e-9)


def test_a_motion_too_long_for_the_memory_is_refused(monkeypatch):
    monkeypatch.setattr(bench, "LONGEST", 20)
    with pytest.raises(asrsim.SimulationError, match="shorten the run"):
        asrsim.run(on_bench(duration=0.02))


def test_the_links_stand_still_after_the_scenario():
    scenario = on_bench(duration=0.02, motion={"joint_1": {"sinusoid": {"amplitude": 0.5, "frequency": 7.0}}})
    ends = []
    for compiled in (True, False):
        with asrsim.Simulation(scenario, compiled=compiled) as simulation:
            simulation.advance(np.int8(100))
            ends.append((simulation.time, *simulation.observe().link_position, *simulation.observe().link_velocity))
    assert ends[0] == ends[1]
    assert ends[0][::2] == (0.1, 0.0)
