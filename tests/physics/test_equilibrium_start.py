"""`initial: equilibrium`: a run starts at rest and stays at rest for every actuator, mode and stop."""

from dataclasses import replace

import numpy as np
import pytest

import asrsim
from asrsim.actuators import ACTUATORS, MODES, Actuator, Parameter
from asrsim.scenario.data import Scenario
from asrsim.signals import Constant
from asrsim.simulation.prepare import prepare
from asrsim.simulation.run import simulate
from asrsim.simulation.simulation import Simulation
from support.random_runs import random_run
from validation.models import INSTALLED, Body, chain, column, run

ARM = {"mass": 0.2, "reach": 0.05, "inertia": 1e-4, "damping": 0.01}
HELD = tuple(mode for mode in MODES.values() if (mode.spring or mode.controller) and not mode.direct)
FIRST, PRESET = 0.5, 0.004
"""First reference (rad) and preset (rad or m)."""


class Coupled(Actuator):
    """Actuator with two motors, a spring between the motors, and a spring from each motor to the link."""

    name, title, source, motors = "coupled", "Coupled", "test", 2
    parameters = (Parameter(name="k", default=20.0, unit="N m/rad", doc="of all springs"),)

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, parameters):
        (k,) = parameters
        return k * (theta_1 - q) + k * (theta_1 - theta_2), k * (theta_2 - q) - k * (theta_1 - theta_2)

    @staticmethod
    def stiffness(q, theta_1, theta_2, parameters):
        return 2.0 * parameters[0]

    @staticmethod
    def elastic_energy(q, theta_1, theta_2, parameters):
        return 0.5 * parameters[0] * ((theta_1 - q) ** 2 + (theta_2 - q) ** 2 + (theta_1 - theta_2) ** 2)


@pytest.fixture(autouse=True)
def coupled():
    ACTUATORS.add(Coupled.name, Coupled, replace=True)


def start(actuator, mode, stepping="leapfrog", **parameters):
    """Motion of links and motors of an arm with two joints in 50 ms, and distance of the first link from its reference."""
    second = 0.0 if not mode.mapped else PRESET if ACTUATORS.get(actuator).adjuster else 0.1
    values = (FIRST, second if mode.mapped or ACTUATORS.get(actuator).adjuster else FIRST + 0.05)
    robot = chain(*[Body(actuator=actuator, **ARM)] * 2)
    result = run(
        robot,
        mode=mode.number,
        duration=0.05,
        initial_equilibrium=True,
        compiled=False,
        stepping=stepping,
        parameters=parameters,
        references=dict(zip(mode.references, values, strict=False)),
    )
    names = [name for name in ("link_position", "motor_1_position", "motor_2_position") if name in result.samples.values]
    return {name: max(float(np.ptp(column(result, name, j))) for j in (0, 1)) for name in names} | {
        "droop": float(FIRST - column(result, "link_position")[0])
    }


@pytest.mark.parametrize("actuator", [*(name for name in ACTUATORS.names() if name != "coupled"), "coupled"])
@pytest.mark.parametrize("mode", HELD, ids=lambda mode: mode.name)
@pytest.mark.parametrize(("stepping", "integral"), [("leapfrog", 0.0), ("leapfrog", 30.0), ("euler", 0.0), ("toolbox", 0.0)])
def test_equilibrium_start_stays_at_rest(actuator, mode, integral, stepping):
    gains = {f"controller_{i}_integral": integral for i in range(1, ACTUATORS.get(actuator).motors + 1) if mode.controller}
    moved = start(actuator, mode, stepping, **gains)
    droop = moved.pop("droop")
    assert max(moved.values()) < 1e-8
    # Only integral action on the link removes the sag.
    assert (abs(droop) > 1e-5) == (mode.number != 1 or integral == 0.0)


@pytest.mark.parametrize("pressed", [(1,), (2,), (1, 2)])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("engine", INSTALLED)
def test_equilibrium_start_may_rest_on_a_stop(pressed, side, engine):
    """The references are 0.3 rad and the stops 0.2 rad, so the equilibrium of the springs alone is beyond the stops."""
    stops = f'<limit lower="{min(0.2 * side, 0)}" upper="{max(0.2 * side, 0)}" effort="9" velocity="9"/>'
    bodies = [Body(actuator="sea", **ARM, limits=stops if number in pressed else "") for number in (1, 2)]
    result = run(
        chain(*bodies),
        mode=6,
        duration=0.05,
        initial_equilibrium=True,
        compiled=False,
        engine=engine,
        references={"equilibrium_position": 0.3 * side},
    )
    for number, body in enumerate(bodies):
        position = column(result, "link_position", number)
        assert np.ptp(position) < 1e-8
        assert (position[0] == 0.2 * side) == bool(body.limits)


@pytest.mark.parametrize("seed", [310, 315, 319, 326])
def test_a_robot_in_free_fall_keeps_its_posture(seed, tmp_path):
    given = random_run(seed, moving=3, fixed=False, passive=0.0, jumps=False)
    still = [replace(wave, amplitude=0.0) for joint in given.joints for wave in joint.references]
    assert all(joint.mode not in (0, 4) for joint in given.joints)
    joints = tuple(
        replace(joint, references=tuple(still.pop(0) for _ in joint.references), external=None) for joint in given.joints
    )
    keys = {**replace(given, joints=joints).keys(), "initial": "equilibrium", "duration": 0.1}
    result = simulate(asrsim.make_scenario(given.write(tmp_path), compiled=False, **keys))
    assert np.ptp(result.samples.values["link_position"], axis=0).max() < 1e-8


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("parameters", [{"joint_1": {"spring_stiffness": 31.0}}, {"link_2": {"mass": 0.35}}], ids=str)
def test_worlds_start_at_the_equilibrium_of_their_parameters_and_references(parameters, engine):
    robot = chain(*[Body(actuator="sea", **ARM)] * 2)
    scenario = Scenario(
        name="other", engine=engine, robot=robot.path, gravity=(0.0, 0.0, -9.81), modes={"*": 6}, duration=0.05,
        initial_equilibrium=True, references={"*": {"equilibrium_position": Constant(value=FIRST)}}, compiled=False,
    )  # fmt: skip
    given = prepare(scenario, robot)
    with Simulation(given) as simulation, Simulation(given.vary(parameters)) as fresh:
        before = simulation.observe().link_position
        simulation.advance(20)
        simulation.reset(parameters=parameters)
        assert np.array_equal(simulation.observe().link_position, fresh.observe().link_position)
        assert not np.array_equal(simulation.observe().link_position, before)
        simulation.advance(50)
        np.testing.assert_allclose(simulation.observe().link_position, fresh.observe().link_position, atol=1e-8)
    moved = {"joint_1": {"equilibrium_position": Constant(value=FIRST + 0.2)}}
    other = prepare(replace(scenario, references={**scenario.references, **moved}), robot)
    with asrsim.Worlds(given, 3) as worlds, Simulation(given.with_references(moved)) as referred:
        worlds.reset([asrsim.Start(parameters=own, references=moved) for own in ({}, parameters, {})])
        found = worlds.observe().link_position
        assert np.array_equal(found[0], other.initial_positions)
        assert np.array_equal(found[1], other.vary(parameters).initial_positions)
        assert np.array_equal(found[2], referred.observe().link_position)


def test_motors_without_references_stay_at_rest_at_the_equilibrium():
    result = run(chain(*[Body(actuator="sea", **ARM)] * 2), mode=3, duration=0.1, initial_equilibrium=True, initial=[0.4])
    assert np.ptp(column(result, "link_position")) < 1e-8


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_weight_pulls_a_link_off_its_stop_at_the_equilibrium(way):
    """The reference lies beyond the stop."""
    limits = '<limit lower="-0.5" upper="0.5" effort="1000" velocity="100"/>'
    result = run(
        chain(Body(actuator="sea", limits=limits, **ARM)),
        mode=3,
        duration=0.05,
        initial_equilibrium=True,
        compiled=False,
        parameters={"spring_stiffness": 0.2},
        references={"equilibrium_position": way * 0.6},
    )
    place = column(result, "link_position")
    assert np.ptp(place) < 1e-6
    assert 0.35 < way * place[0] < 0.5
    # The spring carries the weight of 0.2 kg at 0.05 m.
    assert abs(column(result, "link_torque")[0]) == pytest.approx(0.2 * (0.6 - way * place[0]), rel=1e-6)
    assert 0.2 * (0.6 - way * place[0]) == pytest.approx(0.2 * 9.81 * 0.05 * np.sin(way * place[0]), rel=1e-3)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("starts", [(0.0, 0.0), (0.9, -2.5), (np.pi, 0.0), (np.pi, np.pi)])
def test_passive_joints_hang_down_at_the_equilibrium(starts, engine):
    bodies = (Body(actuator="qbmove", inertia=1e-3), Body(inertia=1e-3), Body(inertia=1e-3))
    result = run(
        chain(*bodies),
        mode=6,
        duration=0.5,
        engine=engine,
        initial_equilibrium=True,
        initial=(0.0, *starts),
        references={"equilibrium_position": 0.6, "stiffness_preset": 0.2},
    )
    positions = np.array([column(result, "link_position", j) for j in range(3)])
    assert np.ptp(positions, axis=1) == pytest.approx(0.0, abs=1e-8)
    # The links after the first hang straight down. Angles are relative to the previous link.
    assert np.cos(positions[0] + positions[1])[0] == pytest.approx(1.0, abs=1e-12)
    assert np.cos(positions[2])[0] == pytest.approx(1.0, abs=1e-12)
