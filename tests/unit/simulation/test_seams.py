"""Where parts of the core meet: nothing depends on where a block, a chunk or a step begins."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import asrsim
from asrsim import make_scenario
from asrsim.actuators import ACTUATORS, Actuator
from asrsim.actuators.vectorised import energy_law, over_arrays
from asrsim.errors import SimulationError
from asrsim.scenario.data import Effects, Scenario, Wrench
from asrsim.signals import PulseTrain, Signal, Sinusoid, Step
from asrsim.simulation.prepare import prepare
from asrsim.simulation.prepared import Prepared, make_engine
from asrsim.simulation.run import simulate
from asrsim.simulation.simulation import Simulation
from asrsim.simulation.worlds import Start, Worlds
from support.hanging_chain import INERTIA, MASS, REACH
from support.paths import EXAMPLES
from validation.conservation import motors
from validation.models import INSTALLED, Body, chain, column, run

BODY = Body(actuator="sea", mass=MASS, reach=REACH, inertia=INERTIA)
H = 1e-3
PULSES = PulseTrain(high=0.4, period=0.00437, width=0.0013)
"""Jumps all over the steps, in the first and the second half of them."""


def prepared(**fields: Any) -> Prepared:
    """A joint in mode 6."""
    robot = chain(BODY)
    keys = {"modes": {"*": 6}, "references": {"*": {"equilibrium_position": PULSES}}, "duration": 0.2, **fields}
    return prepare(Scenario(name="seams", robot=robot.path, **keys), robot)


def test_a_force_moves_a_link_as_the_same_external_torque_does() -> None:
    body = replace(BODY, actuator=None, prismatic=True, axis="1 0 0")
    force = Wrench(link="link_1", force=(PULSES, None, None), point=(0.0, 0.0, 0.0))
    keys: tuple[dict[str, Any], ...] = {"wrenches": (force,)}, {"external": {"joint_1": PULSES}}
    found = [column(run(chain(body), duration=0.2, compiled=False, **more), "link_position") for more in keys]
    assert np.abs(found[0]).max() > 1e-4
    np.testing.assert_allclose(*found, rtol=1e-12)


def test_late_sensors_of_motors_are_of_second_order() -> None:
    """Position and velocity belong to one moment, where the motors' velocity is that of half a step before."""
    free = motors("sea", {"motor_1_friction_torque": 0.0, "motor_1_max_velocity": 1e3, "motor_1_max_torque": 1e3})
    found = []
    for substeps in (1, 4, 32):
        result = run(
            chain(replace(BODY, inertia=1e-2)), mode=6, duration=0.2, substeps=substeps, motor_substeps=1, compiled=False,
            references={"equilibrium_position": Sinusoid(amplitude=0.4, frequency=3.0)},
            parameters={"spring_stiffness": 20.0, **free}, sensor_effects={"*": Effects(delay=4e-3)},
        )  # fmt: skip
        found.append(column(result, "motor_1_position"))
    coarse, fine = (np.abs(one - found[2]).max() for one in found[:2])
    assert coarse < 2e-4
    assert np.log2(coarse / fine) / 2.0 > 1.8


def test_the_link_s_controller_in_the_released_order() -> None:
    """Torque = P e + I times the sum of e dt, this step's with it, - D v, with the link as it is at the step."""
    gains = {"controller_1_proportional": 3.0, "controller_1_integral": 40.0, "controller_1_derivative": 0.02}
    result = run(
        chain(replace(BODY, inertia=1e-2)), mode=1, duration=0.05, stepping="toolbox", gravity=0.0,
        references={"link_position": 0.3}, parameters=gains,
    )  # fmt: skip
    error, v = 0.3 - column(result, "link_position"), column(result, "link_velocity")
    expected = 3.0 * error + 40.0 * H * np.cumsum(error) - 0.02 * v
    np.testing.assert_allclose(column(result, "link_torque"), expected, rtol=1e-12)


@pytest.mark.parametrize(("asked", "taken"), [(1, 1), (2, 3), (3, 3), (4, 5)])
def test_a_substep_has_an_odd_number_of_motor_steps(asked: int, taken: int) -> None:
    """One of them stands for the substep's own time."""
    assert prepared(motor_substeps=asked).resolution.motor_substeps == taken


def test_an_equilibrium_start_respects_the_motor_s_stop() -> None:
    """A start at equilibrium with a reference beyond the motor's stop: the link rests on the spring of the stopped motor."""
    result = run(
        chain(BODY), mode=6, duration=0.1, initial_equilibrium=True, references={"equilibrium_position": 0.4},
        parameters={"spring_stiffness": 20.0, "motor_1_max_position": 0.05, "motor_1_min_position": -1.0},
    )  # fmt: skip
    q = column(result, "link_position")
    np.testing.assert_allclose(column(result, "motor_1_position"), 0.05, atol=1e-12)
    assert np.ptp(q) < 1e-9
    assert 20.0 * (0.05 - q[0]) == pytest.approx(MASS * 9.81 * REACH * np.sin(q[0]), rel=1e-6)


def test_what_is_observed_is_what_is_logged() -> None:
    given = prepared(references={"*": {"equilibrium_position": Sinusoid(amplitude=0.4, frequency=5.0)}}, substeps=1)
    with Simulation(given, record=True, compiled=False) as simulation:
        simulation.advance(40)
        seen = simulation.observe()
    result = run(
        chain(BODY), mode=6, duration=0.05, substeps=1, motor_substeps=given.resolution.motor_substeps,
        references={"equilibrium_position": Sinusoid(amplitude=0.4, frequency=5.0)},
    )  # fmt: skip
    for name in ("link_position", "motor_1_position"):
        assert getattr(seen, name)[0] == pytest.approx(column(result, name)[40], rel=1e-12)


@pytest.mark.parametrize(("name", "mode"), [("deflection", 3), ("effort", 3), ("saturation", 6)])
def test_limits_are_counted_on_both_sides(name: str, mode: int) -> None:
    found = []
    limits = '<limit lower="-3" upper="3" effort="1" velocity="100"/>'
    for goal in (0.8, -0.8):
        result = run(
            chain(replace(BODY, inertia=1e-3, limits=limits)), mode=mode, duration=0.1, gravity=0.0, compiled=False,
            references={"equilibrium_position": Step(at=0.01, after=goal)},
            parameters={"max_deflection": 0.1, "motor_1_max_torque": 3.0, "spring_stiffness": 80.0},
        )  # fmt: skip
        found.append(int(getattr(result.counts, name)[0]))
    assert found[0] == found[1] > 10


@pytest.mark.parametrize("engine", INSTALLED)
def test_the_links_energy_is_that_of_motion_and_height(engine: str) -> None:
    given = prepared(engine=engine, modes={"*": 3}, substeps=1)
    inertia = INERTIA + MASS * REACH**2
    found = []
    with Simulation(given, compiled=False) as simulation:
        for q, v in ((0.0, 0.0), (0.0, 3.0), (1.0, 0.0), (1.0, -2.0)):
            simulation.reset({"joint_1": q}, velocities={"joint_1": v})
            found.append(simulation.model.energy([q], [v]))
    height = MASS * 9.81 * REACH * (1.0 - np.cos(1.0))
    wanted = [0.0, 4.5 * inertia, height, height + 2.0 * inertia]
    np.testing.assert_allclose(np.array(found) - found[0], wanted, atol=1e-12)


@pytest.mark.parametrize("name", ACTUATORS.names())
def test_energies_without_a_law_are_integrated(name: str) -> None:
    law = ACTUATORS.get(name)
    bare = type("Bare", (law,), {"elastic_energy": Actuator.elastic_energy})
    values = tuple(parameter.default for parameter in law.parameters)
    q = np.array([-0.1, 0.0, 0.05])
    second = np.full(3, law.typical_preset) if law.adjuster else np.array([0.02, -0.1, 0.1])
    pair = (q, np.array([0.1, 0.05, -0.1]), second)
    np.testing.assert_allclose(
        over_arrays(energy_law(bare))(*pair, values), over_arrays(energy_law(law))(*pair, values), rtol=1e-6
    )


def test_each_encoder_has_a_noise_of_its_own() -> None:
    result = run(
        chain(replace(BODY, actuator="qbmove")), mode=6, duration=0.1, gravity=0.0, compiled=False,
        references={"equilibrium_position": 0.0, "stiffness_preset": 0.0}, sensor_effects={"*": Effects(noise=0.01)},
    )  # fmt: skip
    first, second = column(result, "motor_1_torque"), column(result, "motor_2_torque")
    assert abs(np.corrcoef(first[1:], second[1:])[0, 1]) < 0.4
    assert np.std(first) == pytest.approx(np.std(second), rel=0.4)


@pytest.mark.parametrize("engine", INSTALLED)
def test_an_engine_goes_with_its_simulation(engine: str) -> None:
    """By itself: Python's collector of circles comes late, and an engine is megabytes."""
    robot = chain(BODY, BODY)
    given = prepare(Scenario(name="held", robot=robot.path, modes={"*": 6}, engine=engine), robot)
    gc.disable()
    try:
        for _ in range(2):  # the first of a process is held by what it imports
            with Simulation(given, compiled=False) as simulation:
                simulation.advance(3)
            held = weakref.ref(simulation.engine)
            del simulation
        assert held() is None
    finally:
        gc.enable()


@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
def test_a_rollout_gives_what_a_run_records(stepping: str) -> None:
    """All channels agree bit for bit, for an electric motor in mode 6 and for ideal motors in mode 3."""
    electric = {"motor_1_torque_constant": 0.05, "motor_1_gear_ratio": 30.0, "motor_1_resistance": 1.5, "motor_1_inertia": 0.01}
    scenario = make_scenario(
        EXAMPLES / "urdf" / "dof2_horizontal.urdf", duration=0.02, engine="mujoco", compiled=False, stepping=stepping,
        modes={"joint_1": 6, "joint_2": 3}, parameters={"joint_1": electric}, substeps=3,
        initial={"joint_1": {"position": 0.1, "velocity": 0.3}},
        references={"joint_1": {"equilibrium_position": {"sinusoid": {"amplitude": 0.2, "frequency": 3}}}},
    )  # fmt: skip
    recorded = asrsim.run(scenario)
    samples = recorded.run.samples
    assert samples is not None
    with Worlds(prepare(scenario), 1) as worlds:
        found = worlds.rollout(tuple(samples.values))
    for name, values in samples.values.items():
        np.testing.assert_array_equal(found[name][0], values, err_msg=name)


def test_unwatched_worlds_have_the_same_bits() -> None:
    """Energies and counts follow from the motion, so what is not asked for changes no bit of it; counts are refused."""
    scenario = make_scenario(
        EXAMPLES / "urdf" / "dof2_horizontal.urdf", duration=0.05, engine="mujoco", compiled=False, modes=6,
        parameters={"*": {"hysteresis_torque": 0.2, "motor_1_max_velocity": 0.5}},
        references={"*": {"equilibrium_position": {"sinusoid": {"amplitude": 0.4, "frequency": 5.0}}}},
    )  # fmt: skip
    names = ["link_position", "link_torque", "motor_1_velocity"]
    with Worlds(scenario, 1, names=names, watched=False) as bare, Worlds(scenario, 1, names=names) as watched:
        found, expected = bare.rollout(names), watched.rollout(names)
        for name in names:
            np.testing.assert_array_equal(found[name], expected[name], err_msg=name)
        assert watched.counts(0).motor_speed[0] > 0
        for question in (bare.counts, bare.sane):
            with pytest.raises(SimulationError, match="watched=True"):
                question(0)


def test_a_rollout_takes_references_and_external_torques_of_its_own() -> None:
    """As a scenario with these has them, bit by bit; what is not given stays the scenario's."""
    waves = {name: Sinusoid(amplitude=0.1 * i, frequency=2.0 + i) for i, name in enumerate(("a", "b", "c"), 1)}
    keys = {"duration": 0.05, "engine": "mujoco", "compiled": False, "modes": 3, "substeps": 2}
    urdf = EXAMPLES / "urdf" / "dof2_horizontal.urdf"
    push = {"joint_2": {"sinusoid": {"amplitude": 0.3, "frequency": 7.0}}}
    prepared = prepare(make_scenario(urdf, external_torques=push, **keys))
    equilibria = {"joint_1": {"equilibrium_position": waves["a"]}}
    given: list[tuple[dict[str, dict[str, Signal]], dict[str, Signal]]] = [
        ({}, {}), ({}, {"joint_1": waves["b"]}), (equilibria, {"joint_2": waves["c"]}), (equilibria, {}),
    ]  # fmt: skip
    seen = []
    with Worlds(prepared, 1) as worlds:
        for references, torques in given:
            both = {j: {**references.get(j, {}), **({"external_torque": torques[j]} if j in torques else {})}
                    for j in (*references, *torques)}  # fmt: skip
            found = worlds.rollout(["link_position"], start=Start(references=both))["link_position"][0]
            scenario = prepared.scenario
            scenario = replace(
                scenario, references={**scenario.references, **references},
                external_torques={**scenario.external_torques, **torques},
            )  # fmt: skip
            recorded = simulate(scenario).samples
            assert recorded is not None
            np.testing.assert_array_equal(found, recorded.values["link_position"])
            seen.append(found[-1].tolist())
    assert len({tuple(one) for one in seen}) == len(given)


@pytest.mark.parametrize("engine", INSTALLED)
def test_the_model_of_a_world_has_its_own_inertias(engine: str) -> None:
    """Whichever was there before, and whatever else differs: friction and damping are no part of it."""
    prepared = prepare(make_scenario(EXAMPLES / "urdf" / "dof2_horizontal.urdf", duration=0.02, engine=engine, modes={"*": 1}))
    worlds, robot = Worlds(prepared, 1, compiled=False), prepared.robot
    rubbing = replace(robot, joints=tuple(replace(joint, friction=0.1) for joint in robot.joints))
    heavier = [
        replace(one, links=tuple(replace(link, mass=2.0 * (link.mass or 0.0)) for link in one.links))
        for one in (robot, rubbing)
    ]
    motion = [0.3, -0.4], [1.0, 2.0], [3.0, -1.0]
    at_first = None
    for varied in (robot, heavier[0], rubbing, heavier[1], robot):
        fresh, _ = make_engine(prepared.scenario, varied)
        assert fresh.model is not None
        expected = fresh.model.inverse_dynamics(*motion)
        fresh.close()
        model = worlds.model_of(varied)
        assert model is not None
        found = model.inverse_dynamics(*motion)
        np.testing.assert_allclose(found, expected, rtol=1e-9)
        at_first = found if at_first is None else at_first
        assert np.allclose(found, at_first) == (varied in (robot, rubbing))
    worlds.close()


def test_repeated_parameters_give_the_same_bits() -> None:
    """Other numbers in between, in the other world or in the same one, leave nothing behind."""
    scenario = make_scenario(
        EXAMPLES / "urdf" / "dof2_vertical.urdf", duration=0.1, initial="equilibrium",
        references={"*": {"equilibrium_position": 0.2, "stiffness_preset": 0.2}},
    )  # fmt: skip
    light, heavy = (Start(parameters={"link_1": {"mass": mass}, "joint_1": {"spring_k_1": 0.03}}) for mass in (0.4, 0.6))
    with Worlds(scenario, 2) as worlds:
        first, again = (worlds.rollout(["link_position"], start=[light, heavy])["link_position"] for _ in range(2))
        turned = worlds.rollout(["link_position"], start=[heavy, light])["link_position"][::-1]
    assert np.array_equal(first, again)
    assert np.array_equal(first, turned)
    assert not np.array_equal(first[0], first[1])
