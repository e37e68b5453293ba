"""Many worlds at once: rollouts, states, and parameters of their own, equal to single runs bit for bit."""

from dataclasses import replace

import numpy as np
import pytest

import asrsim
from asrsim import make_scenario
from asrsim.errors import SimulationError
from asrsim.signals import Sinusoid
from asrsim.simulation.prepare import prepare
from asrsim.simulation.start import Start
from asrsim.simulation.worlds import Worlds
from support.paths import EXAMPLES
from validation.models import INSTALLED


def arm(**keys):
    """Arm with two qbMoves."""
    return make_scenario(EXAMPLES / "urdf" / "dof2_horizontal.urdf", **{"engine": "mujoco", "compiled": False, **keys})


@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
def test_a_rollout_gives_what_a_run_records(stepping):
    """All channels agree bit for bit, for an electric motor in mode 6 and for ideal motors in mode 3."""
    electric = {"motor_1_torque_constant": 0.05, "motor_1_gear_ratio": 30.0, "motor_1_resistance": 1.5, "motor_1_inertia": 0.01}
    scenario = arm(
        duration=0.02,
        stepping=stepping,
        modes={"joint_1": 6, "joint_2": 3},
        parameters={"joint_1": electric},
        substeps=3,
        initial={"joint_1": {"position": 0.1, "velocity": 0.3}},
        references={"joint_1": {"equilibrium_position": {"sinusoid": {"amplitude": 0.2, "frequency": 3}}}},
    )
    samples = asrsim.run(scenario).samples
    with Worlds(prepare(scenario), 1) as worlds:
        found = worlds.rollout(tuple(samples.values))
    for name, values in samples.values.items():
        np.testing.assert_array_equal(found[name][0], values, err_msg=name)


def test_unwatched_worlds_have_the_same_bits():
    """Energies and counts follow from the motion, so they may be left out. Then counts cannot be read."""
    scenario = arm(
        duration=0.05,
        modes=6,
        parameters={"*": {"hysteresis_torque": 0.2, "motor_1_max_velocity": 0.5}},
        references={"*": {"equilibrium_position": {"sinusoid": {"amplitude": 0.4, "frequency": 5.0}}}},
    )
    names = ["link_position", "link_torque", "motor_1_velocity"]
    with Worlds(scenario, 1, names=names, watched=False) as bare, Worlds(scenario, 1, names=names) as watched:
        found, expected = bare.rollout(names), watched.rollout(names)
        for name in names:
            np.testing.assert_array_equal(found[name], expected[name], err_msg=name)
        assert watched.counts(0).motor_speed[0] > 0
        for read in (bare.counts, bare.sane):
            with pytest.raises(SimulationError, match="watched=True"):
                read(0)


def test_a_rollout_with_other_inputs_equals_a_scenario_with_them():
    """Inputs that a start does not state are those of the scenario."""
    first, second, third = (Sinusoid(amplitude=0.1 * i, frequency=2.0 + i) for i in (1, 2, 3))
    push = {"joint_2": {"sinusoid": {"amplitude": 0.3, "frequency": 7.0}}}
    prepared = prepare(arm(duration=0.05, modes=3, substeps=2, external_torques=push))
    equilibria = {"joint_1": {"equilibrium_position": first}}
    starts = [({}, {}), ({}, {"joint_1": second}), (equilibria, {"joint_2": third}), (equilibria, {})]
    ends = set()
    with Worlds(prepared, 1) as worlds:
        for references, torques in starts:
            inputs = {joint: dict(values) for joint, values in references.items()}
            for joint, torque in torques.items():
                inputs.setdefault(joint, {})["external_torque"] = torque
            found = worlds.rollout(["link_position"], start=Start(references=inputs))["link_position"][0]
            scenario = replace(
                prepared.scenario,
                references={**prepared.scenario.references, **references},
                external_torques={**prepared.scenario.external_torques, **torques},
            )
            np.testing.assert_array_equal(found, asrsim.run(scenario).samples.values["link_position"])
            ends.add(tuple(found[-1].tolist()))
    assert len(ends) == len(starts)


def test_equal_calls_with_new_values_give_the_bits_of_fresh_calls():
    """A controller that calls again and again in the same way gets what it gets from worlds that were just restored: over a
    jump of the scenario's references, beside an external torque that varies, over the ends of chunks, with values set, and
    given back."""
    step = {"step": {"from": 0.0, "to": 0.2, "at": 0.0502}}
    scenario = arm(
        duration=1.0,
        modes=6,
        substeps=2,
        compiled=True,
        references={"*": {"equilibrium_position": step}},
        external_torques={"joint_2": {"sinusoid": {"amplitude": 0.1, "frequency": 8.0}}},
    )

    def moved(*, fresh):
        """Quantities after each call; fresh: restore the worlds before."""
        found = []
        with Worlds(scenario, 2, chunk=64) as worlds:
            for k in range(30):
                if k < 20 and k != 7:
                    worlds.push(np.full((2, 2), 0.01 * (k % 3)))
                for joint in worlds.joints:
                    value = None if k == 12 else 0.01 * k
                    worlds.set_reference(joint, "equilibrium_position", value)
                if 15 < k < 20:
                    worlds.set_reference("joint_1", "stiffness_preset", [0.1 + 0.01 * k, 0.2], worlds=[0, 1])
                if k == 20:
                    worlds.set_reference("joint_2", "external_torque", None)
                if fresh:
                    worlds.restore(worlds.snapshot())
                worlds.advance(5)
                found.append(worlds.read(["link_position", "reference_1", "external_torque"]))
        return {name: np.array([one[name] for one in found]) for name in found[0]}

    again, fresh = moved(fresh=False), moved(fresh=True)
    for name, values in again.items():
        np.testing.assert_array_equal(values, fresh[name], err_msg=name)
        assert np.ptp(values) > 0.01


@pytest.mark.parametrize("compiled", [True, False])
def test_repeated_parameters_give_the_same_bits(compiled):
    """Other parameters in between, in another world or in the same one, have no effect."""
    scenario = make_scenario(
        EXAMPLES / "urdf" / "dof2_vertical.urdf",
        duration=0.1,
        initial="equilibrium",
        compiled=compiled,
        references={"*": {"equilibrium_position": 0.2, "stiffness_preset": 0.2}},
    )
    light, heavy = (Start(parameters={"link_1": {"mass": mass}, "joint_1": {"spring_k_1": 0.03}}) for mass in (0.4, 0.6))
    starts = [Start(), light, heavy, Start(positions={"joint_1": 0.1})]
    with Worlds(scenario, 4) as worlds:
        first, again = (worlds.rollout(["link_position"], start=starts)["link_position"] for _ in range(2))
        turned = worlds.rollout(["link_position"], start=starts[1:] + starts[:1])["link_position"]
    assert np.array_equal(first, again)
    assert np.array_equal(first, np.roll(turned, 1, axis=0))
    assert not np.array_equal(first[0], first[1])


def test_a_world_without_hysteresis_has_no_loss_by_it():
    """The scenario has hysteresis in the first of two joints."""
    scenario = arm(duration=0.01, parameters={"joint_1": {"hysteresis_torque": 0.1}})
    with Worlds(scenario, 2) as worlds:
        worlds.reset([Start(), Start(parameters={"joint_1": {"hysteresis_torque": 0.0}})])
        worlds.advance(5)
        assert np.isnan(worlds.read(["hysteresis_loss"])["hysteresis_loss"]).tolist() == [[False, True], [True, True]]


def test_worlds_continue_from_a_state_as_a_single_simulation_does():
    """A world that diverges stops alone, until its state is set again."""
    scenario = arm(duration=1.0, modes={"*": 6})
    with Worlds(scenario, 2) as worlds, asrsim.Simulation(scenario) as single:
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
def test_worlds_have_the_bits_of_single_runs_in_any_order(threads):
    """Each world has its own parameters and references."""
    scenario = arm(duration=0.2, modes={"*": 6}, compiled=True)
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


@pytest.mark.parametrize("engine", INSTALLED)
def test_restored_worlds_touch_objects_as_before(engine):
    """Between snapshot and restore, the worlds had other masses."""
    world = {"ground": {"height": -1.0}, "objects": {"ball": {"shape": "sphere", "size": [0.1], "mass": 0.5}}}
    with Worlds(arm(duration=1.0, engine=engine, world=world), 2) as worlds:
        ends = []
        worlds.reset([Start(parameters={"link_2": {"mass": mass}}) for mass in (0.5, 0.7)])
        worlds.advance(3)
        kept = worlds.snapshot()
        for masses in ((0.6, 0.8), (0.7, 0.5)):
            worlds.advance(20)
            ends.append(worlds.observe().link_position)
            worlds.reset([Start(parameters={"link_2": {"mass": mass}}) for mass in masses])
            worlds.restore(kept)
        np.testing.assert_array_equal(*ends)
