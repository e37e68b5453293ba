"""One simulation: start, inputs that jump or are set from outside, observation, and release of the engine."""

import gc
import time as clock
import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import asrsim
from asrsim.compiled.compiling import compile_function, time_spent
from asrsim.scenario import Scenario
from asrsim.signals import Sinusoid
from asrsim.simulation.prepare import prepare
from asrsim.simulation.run import simulate
from asrsim.simulation.simulation import Simulation
from support.hanging_chain import INERTIA, MASS, NEVER, REACH, joint, plan, samples, truth
from support.paths import EXAMPLES
from validation.models import INSTALLED, Body, chain, column, run

BODY = Body(actuator="sea", mass=MASS, reach=REACH, inertia=INERTIA)
TOTAL = INERTIA + MASS * REACH**2
"""Inertia about the joint, kg m^2."""


@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
def test_the_first_velocity_is_the_initial_velocity(tmp_path, stepping):
    given = plan([joint(start=0.5, speed=1.25)], 0.02)
    speed = samples(given, tmp_path, stepping=stepping).values["link_velocity"][:, 0]
    assert speed[0] == 1.25
    # One step of gravity later. Centred differences are of second order.
    assert (speed[1] - speed[0]) / 1e-3 == pytest.approx(-MASS * 9.81 * REACH * np.sin(0.5) / TOTAL, rel=0.02)


def test_an_equilibrium_start_respects_the_stop_of_a_motor():
    """The reference is beyond the motor's stop, so the link rests on the spring of the stopped motor."""
    result = run(
        chain(BODY),
        mode=6,
        duration=0.1,
        initial_equilibrium=True,
        references={"equilibrium_position": 0.4},
        parameters={"spring_stiffness": 20.0, "motor_1_max_position": 0.05, "motor_1_min_position": -1.0},
    )
    q = column(result, "link_position")
    np.testing.assert_allclose(column(result, "motor_1_position"), 0.05, atol=1e-12)
    assert np.ptp(q) < 1e-9
    assert 20.0 * (0.05 - q[0]) == pytest.approx(MASS * 9.81 * REACH * np.sin(q[0]), rel=1e-6)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("at", [0.0002, 0.0004, 0.0006, 0.05, 0.0503])
@pytest.mark.parametrize("mode", [0, 1, 3])
def test_a_jump_anywhere_in_a_step_is_of_second_order(tmp_path, engine, at, mode):
    """Jumps in the first half step, in the second, on a step and between steps move a damped joint as the equations do."""
    jump = replace(NEVER, at=at, jump=1.0 if mode == 0 else 0.4)
    parameters = {
        1: {"controller_1_proportional": 6.0, "controller_1_integral": 200.0, "controller_1_derivative": 0.3},
        3: {"spring_stiffness": 5.0, "max_deflection": 1.5},
    }.get(mode, {})
    first = joint(damping=0.4, actuator="sea", mode=mode, parameters=parameters, references=(jump,))
    given = plan((first, joint(damping=0.4)), 0.1, jumps=(at,))
    runs = [samples(given, tmp_path, engine=engine, substeps=substeps) for substeps in (2, 8)]
    exact = truth(given, runs[0].time)
    coarse, fine = (float(np.abs(found.values["link_position"] - exact).max()) for found in runs)
    assert coarse < 2e-4
    assert fine < coarse / 8.0


def test_the_controller_of_the_link_in_toolbox_stepping():
    """Torque = P e + I times the sum of e dt, including this step, - D v."""
    gains = {"controller_1_proportional": 3.0, "controller_1_integral": 40.0, "controller_1_derivative": 0.02}
    result = run(
        chain(replace(BODY, inertia=1e-2)),
        mode=1,
        duration=0.05,
        stepping="toolbox",
        gravity=0.0,
        references={"link_position": 0.3},
        parameters=gains,
    )
    error, v = 0.3 - column(result, "link_position"), column(result, "link_velocity")
    expected = 3.0 * error + 40.0 * 1e-3 * np.cumsum(error) - 0.02 * v
    np.testing.assert_allclose(column(result, "link_torque"), expected, rtol=1e-12)


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_reference_that_is_set_acts_from_the_next_step(tmp_path, engine):
    given = plan([joint(actuator="sea", mode=0, references=(NEVER,))], 0.1)
    scenario = asrsim.make_scenario(given.write(tmp_path), engine=engine, **(given.keys() | {"gravity": [0, 0, 0]}))
    with Simulation(replace(scenario, reference_ranges={"*": {"link_torque": (-0.5, 0.5)}}), compiled=False) as simulation:
        simulation.advance(10)
        assert simulation.observe().link_velocity[0] == 0.0
        assert simulation.set_reference("joint_1", "link_torque", 2.0) == 0.5
        simulation.advance(20)
        assert simulation.observe().link_position[0] == pytest.approx(0.5 * 0.5 / TOTAL * 0.02**2, rel=0.06)
        assert simulation.time == 0.03
        assert simulation.set_reference("joint_1", "link_torque", -9.0) == -0.5
        simulation.set_reference("joint_1", "link_torque", None)
        before = simulation.observe().link_velocity[0]
        simulation.advance(5)
        assert simulation.observe().link_velocity[0] == pytest.approx(before, rel=0.06)


def scenario_of(**fields):
    return Scenario(
        name="one joint",
        robot=Path("arm.urdf"),
        modes={"*": 6},
        duration=0.1,
        substeps=1,
        motor_substeps=1,
        references={"*": {"equilibrium_position": Sinusoid(amplitude=0.4, frequency=5.0)}},
        **fields,
    )


def test_observed_positions_are_the_logged_positions():
    with Simulation(prepare(scenario_of(), chain(BODY)), record=True, compiled=False) as simulation:
        simulation.advance(40)
        seen = simulation.observe()
        simulation.advance(1)
        simulation.flush()
        logged = simulation.samples.values
        assert seen.link_position[0] == pytest.approx(logged["link_position"][40, 0], rel=1e-12)
        assert seen.motor_position[0, 0] == pytest.approx(logged["motor_1_position"][40, 0], rel=1e-12)


@pytest.mark.parametrize("engine", INSTALLED)
def test_energy_of_the_links_is_that_of_motion_and_height(engine):
    found = []
    with Simulation(prepare(scenario_of(engine=engine), chain(BODY)), compiled=False) as simulation:
        for q, v in ((0.0, 0.0), (0.0, 3.0), (1.0, 0.0), (1.0, -2.0)):
            simulation.reset({"joint_1": q}, velocities={"joint_1": v})
            found.append(simulation.model.energy([q], [v]))
    height = MASS * 9.81 * REACH * (1.0 - np.cos(1.0))
    np.testing.assert_allclose(np.array(found) - found[0], [0.0, 4.5 * TOTAL, height, height + 2.0 * TOTAL], atol=1e-12)


@pytest.mark.parametrize("engine", INSTALLED)
def test_an_engine_is_released_with_its_simulation(engine):
    """Without the cyclic garbage collector, which runs late: an engine takes megabytes."""
    given = prepare(scenario_of(engine=engine), chain(BODY, BODY))
    gc.disable()
    try:
        for _ in range(2):  # Imports keep the first engine of a process.
            with Simulation(given, compiled=False) as simulation:
                simulation.advance(3)
            engine_left = weakref.ref(simulation.engine)
            del simulation
        assert engine_left() is None
    finally:
        gc.enable()


def test_samples_may_be_read_after_the_first_substep_of_a_hard_start():
    """The spring is stretched by half a rad at the start. The energy balance of one substep is not known yet (a divergence was
    reported)."""
    arm = asrsim.make_scenario(
        EXAMPLES / "urdf" / "dof1_sea.urdf", duration=1.0, references={"joint_1": {"equilibrium_position": 0.5}}
    )
    with asrsim.Simulation(arm, record=True) as simulation:
        simulation.advance_to(1)
        assert len(simulation.samples.time) == 1


def _doubled(number):
    return 2.0 * number


def test_the_time_of_a_run_excludes_what_is_compiled_in_it(tiny, tmp_path, monkeypatch):
    pytest.importorskip("numba")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    before, began = time_spent(), clock.perf_counter()
    result = simulate(str(tiny.scenario), progress=lambda _: compile_function(_doubled, (1.0,)))
    lasted, spent = clock.perf_counter() - began, time_spent() - before
    assert spent > 1e-3
    assert 0.0 < result.wall_time <= lasted - spent
