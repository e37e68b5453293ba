"""What stands on the core uses its doors, and what users add to it is one file."""

from __future__ import annotations

import runpy

import numpy as np
import pytest

import asrsim
from asrsim.actuators import ACTUATORS, Actuator, Parameter
from asrsim.engines import ENGINES
from asrsim.simulation.worlds import Worlds
from support.paths import EXAMPLES
from validation.models import INSTALLED, Body, chain, column, run


@pytest.fixture
def pendulum(monkeypatch: pytest.MonkeyPatch) -> None:
    """The example engine, registered for one test."""
    monkeypatch.setattr(ENGINES, "_entries", dict(ENGINES._entries))
    runpy.run_path(str(EXAMPLES / "plugins" / "pendulum_engine.py"))


@pytest.mark.usefixtures("pendulum")
@pytest.mark.parametrize("compiled", [False, True])
def test_an_engine_of_one_file_gives_the_motion_of_the_others(compiled: bool) -> None:
    """The one joint of the SEA example under gravity, which it has about its axis too."""
    ends = []
    for engine in ("pendulum", *INSTALLED):
        scenario = asrsim.make_scenario(
            EXAMPLES / "urdf" / "dof1_sea.urdf", engine=engine, duration=0.4, modes={"*": 6}, gravity=[3.0, 5.0, -7.0],
            references={"*": {"equilibrium_position": 0.7}}, compiled=compiled,
        )  # fmt: skip
        ends.append(asrsim.run(scenario).run.samples.values["link_position"])
    assert np.ptp(ends[0]) > 0.1
    for other in ends[1:]:
        np.testing.assert_allclose(ends[0], other, rtol=0.0, atol=1e-12)


class ThreeMotors(Actuator):
    """Three motors pull one link by springs of their own."""

    name = "three_motors"
    title = "three springs side by side"
    source = "this test"
    motors = 3
    parameters = (Parameter(name="stiffness_of_each", default=4.0, unit="N m/rad", doc="of each spring"),)

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, theta_3, parameters):
        (k,) = parameters
        return k * (theta_1 - q), k * (theta_2 - q), k * (theta_3 - q)

    @staticmethod
    def stiffness(q, theta_1, theta_2, theta_3, parameters):
        return 3.0 * parameters[0]

    @staticmethod
    def elastic_energy(q, theta_1, theta_2, theta_3, parameters):
        (k,) = parameters
        return 0.5 * k * ((theta_1 - q) ** 2 + (theta_2 - q) ** 2 + (theta_3 - q) ** 2)

    @staticmethod
    def motor_references(equilibrium, preset):
        return equilibrium, equilibrium + preset, equilibrium - preset

    @staticmethod
    def equilibrium_position(theta_1, theta_2, theta_3=0.0):
        return theta_1


@pytest.fixture
def three_motors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Registered for one test."""
    monkeypatch.setattr(ACTUATORS, "_entries", dict(ACTUATORS._entries))
    ACTUATORS.add("three_motors", ThreeMotors)


@pytest.mark.usefixtures("three_motors")
@pytest.mark.parametrize("mode", [3, 6])
@pytest.mark.parametrize("compiled", [False, True])
def test_three_motors_swing_a_link_by_their_springs(mode: int, compiled: bool) -> None:
    """I q'' = 3 k (mean - q): from rest at 0 it swings about the motors' mean, 0.3 rad, if they stand still."""
    inertia, spring = 0.02, 4.0
    stiff = {"stiffness_of_each": spring, **{f"motor_{i}_inertia": 1e6 for i in (1, 2, 3)}}
    result = run(
        chain(Body(actuator="three_motors", mass=1e-9, reach=0.0, inertia=inertia)), mode=mode, gravity=0.0, duration=0.5,
        references={"equilibrium_position": 0.3, "stiffness_preset": 0.1}, parameters=stiff, compiled=compiled,
        **({} if mode == 3 else {"initial_motor_positions": {"joint_1": (0.3, 0.4, 0.2)}}),
    )  # fmt: skip
    time = result.samples.time
    expected = 0.3 * (1.0 - np.cos(np.sqrt(3.0 * spring / inertia) * time))
    np.testing.assert_allclose(column(result, "link_position"), expected, atol=1e-3)
    for i, theta in enumerate((0.3, 0.4, 0.2), start=1):
        np.testing.assert_allclose(column(result, f"motor_{i}_position"), theta, atol=1e-6)
        torque = spring * (theta - column(result, "link_position"))
        np.testing.assert_allclose(column(result, f"elastic_torque_{i}"), torque, atol=1e-6)
    assert np.abs(column(result, "energy_residual")).max() < 1e-3


def test_worlds_are_put_in_a_state_and_go_on_from_there() -> None:
    """As a simulation that starts there; a world that breaks stops alone, until it is put somewhere."""
    scenario = asrsim.make_scenario(EXAMPLES / "urdf" / "dof2_horizontal.urdf", engine="mujoco", duration=1.0, modes={"*": 6})
    with Worlds(scenario, 2, compiled=False) as worlds, asrsim.Simulation(scenario, compiled=False) as single:
        worlds.set_state({"joint_1": [0.1, 0.3]}, {"joint_2": 1.0})
        worlds.set_reference("joint_1", "external_torque", [1e305, 0.0])
        worlds.advance(20)
        assert worlds.healthy.tolist() == [False, True]
        single.reset({"joint_1": 0.3}, velocities={"joint_2": 1.0})
        single.advance(20)
        np.testing.assert_array_equal(worlds.observe().link_position[1], single.observe().link_position)
        worlds.set_state({"joint_1": 0.1}, worlds=[0])
        worlds.advance(1)
        assert worlds.healthy.all()
        assert worlds.time.tolist() == [0.001, 0.021]


@pytest.mark.parametrize("threads", [1, 2])
def test_worlds_have_the_bits_of_single_runs_in_any_order(threads: int) -> None:
    """Other numbers, masses too, and other references in each; whichever are stepped first."""
    scenario = asrsim.make_scenario(
        EXAMPLES / "urdf" / "dof2_horizontal.urdf", engine="mujoco", duration=0.2, modes={"*": 6}, compiled=True
    )
    numbers = [{"link_2": {"mass": 0.3 + 0.1 * i}, "joint_1": {"damping": 0.01 * i}} for i in range(4)]
    goals = np.linspace(-0.5, 0.7, 4)
    ends = []
    for own, goal in zip(numbers, goals, strict=True):
        with asrsim.Simulation(scenario) as single:
            single.reset(parameters=own)
            single.set_reference("joint_1", "equilibrium_position", goal)
            single.advance(30)
            ends.append([single.observe().link_position, single.read(["link_torque"])["link_torque"]])
    with Worlds(scenario, 4, threads=threads) as worlds:
        worlds.reset([asrsim.Start(parameters=own) for own in numbers])
        worlds.set_reference("joint_1", "equilibrium_position", goals)
        kept = worlds.snapshot()
        for _ in range(2):
            worlds.advance(10, worlds=[3, 1])
            worlds.advance(20)
            worlds.advance(10, worlds=[True, False, True, False])
            found = worlds.observe().link_position, worlds.read(["link_torque"])["link_torque"]
            np.testing.assert_array_equal(found[0], [position for position, _ in ends])
            np.testing.assert_array_equal(found[1], [torque for _, torque in ends])
            worlds.restore(kept)
