"""Wrong calls of simulations and worlds are refused with asrsim's errors before anything changes."""

import dataclasses
import math

import numpy as np
import pytest

import asrsim
from asrsim.engines import ENGINES
from asrsim.errors import AsrsimError, InputError, ScenarioError, SimulationError
from asrsim.scenario import read_scenarios
from asrsim.signals import Constant, Step, Sum

INSTALLED = [name for name in ("bullet", "mujoco") if ENGINES.get(name).available]


@pytest.fixture(params=INSTALLED)
def simulation(request, tiny):
    with asrsim.Simulation(tiny.scenario, overrides={"engine": request.param}) as made:
        made.set_reference("elbow", "equilibrium_position", 0.3)
        made.advance(20)
        yield made


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (lambda one: one.advance(-1), InputError, "must not be negative"),
        (lambda one: one.advance(1.5), TypeError, "integer"),
        (lambda one: one.advance("3"), TypeError, "integer"),
        (
            lambda one: one.reset({"elbw": 0.1}),
            InputError,
            "initial.elbw: the robot has no .* Did you mean 'elbow'",
        ),
        (lambda one: one.reset({"elbow": float("nan")}), InputError, "initial.elbow: must be a finite number"),
        (lambda one: one.reset({"elbow": 99.0}), InputError, "initial.elbow: lies outside the limits of 'elbow'"),
        (lambda one: one.reset(velocities={"elbow": float("inf")}), InputError, "velocities.elbow: must be a finite number"),
        (lambda one: one.reset(parameters={"elbow": {"damping": -1.0}}), AsrsimError, "must be at least 0"),
        (lambda one: one.reset(parameters={"elbow": {"damping": math.nan}}), AsrsimError, "must be a number"),
        (lambda one: one.reset(motors={"elbw": [0.1]}), InputError, "motors.elbw: .* Did you mean 'elbow'"),
        (lambda one: one.reset(motors={"elbow": [math.nan]}), InputError, "motors.elbow: must be a list of finite"),
        (lambda one: one.reset(motors={"elbow": [0.1, 0.2]}), InputError, "motors.elbow: has 2 values"),
        (lambda one: one.set_reference("elbow", "equilibrium_position", "a"), InputError, "must be numbers"),
        (lambda one: one.samples, InputError, "create it with record=True"),
        (lambda one: one.reset({"a": 1.0}, velocities={"b": 1.0}), InputError, "(?s)initial.a.*velocities.b"),
    ],
)
def test_a_refused_call_changes_nothing(simulation, call, error, said):
    before = simulation.observe()
    with pytest.raises(error, match=said):
        call(simulation)
    for name, values in vars(simulation.observe()).items():
        np.testing.assert_array_equal(values, vars(before)[name], err_msg=name)
    simulation.advance(5)
    assert simulation.time == pytest.approx(before.time + 5 * simulation.scenario.step)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"step": math.nan}, "step: must be a finite number"),
        ({"substeps": 0}, "substeps: must be a whole number >= 1"),
        ({"log_every": 0}, "log_rate: must be a whole number >= 1"),
        ({"seed": -1}, "seed: must be a whole number >= 0"),
        ({"gravity": (1, 2)}, r"gravity: must be a list \[x, y, z\]"),
        ({"duration": 0.10005}, "duration: must be a whole number of steps, but 0.10005 s"),
        ({"motion": {"elbow": Constant(value=1.0)}}, "motion: prescribed motion needs 'engine: bench'"),
        ({"initial_positions": {"elbw": 1.0}}, "initial.elbw: .* Did you mean 'elbow'"),
        ({"parameters": {"elbow": {"spring_k": "x"}}}, "parameters.elbow.spring_k: must be a number"),
        ({"external_torques": {"elbow": Step(at=math.nan, after=1.0)}}, "external_torques.elbow: 'at' of the signal"),
        ({"external_torques": {"elbow": Sum(terms=(Step(at=math.nan, after=1.0),))}}, "elbow: 'at' of the signal"),
    ],
)
def test_a_replaced_scenario_is_checked_like_one_that_is_read(tiny, fields, said):
    with pytest.raises(ScenarioError, match=said):
        asrsim.prepare(dataclasses.replace(asrsim.make_scenario(tiny.robot, duration=0.1), **fields))


@pytest.mark.parametrize(
    ("field", "wrong"),
    [("duration", -1.0), ("step", 0.0), ("gravity", (1, 2)), ("engine", "steam")],
)
def test_in_place_of_an_invalid_value_that_of_the_file_is_checked(tiny, field, wrong):
    """Checks of other values depend on it: a reference's time is checked with the duration."""
    stated = {"duration": 3.0, "step": 0.002, "gravity": [0, 0, -1.6], "engine": "mujoco"}
    made = asrsim.make_scenario(tiny.robot, **stated)
    (valid,), problems = read_scenarios(dataclasses.replace(made, **{field: wrong}, seed=7))
    assert [problem.key for problem in problems] == [field]
    assert getattr(valid, field) == getattr(made, field)
    assert valid.seed == 7


def test_quantities_that_no_joint_can_record_are_refused(tiny):
    for make in (asrsim.Simulation, lambda scenario, **keys: asrsim.Worlds(scenario, 2, **keys)):
        with pytest.raises(InputError, match=r"no joint records 'link_positon'.*Did you mean 'link_position'"):
            make(tiny.scenario, names=["link_positon"])


def test_a_snapshot_of_another_simulation_or_other_parameters_is_refused(simulation, tiny):
    kept = simulation.snapshot()
    other = asrsim.Simulation(tiny.scenario, overrides={"engine": simulation.scenario.engine})
    with other, pytest.raises(InputError, match="snapshot of another simulation"):
        other.restore(kept)
    simulation.restore(kept)
    simulation.reset(parameters={"elbow": {"damping": 0.2}})
    with pytest.raises(InputError, match="with other parameters"):
        simulation.restore(kept)


CALLS = {"advance": [], "observe": [], "snapshot": [], "reset": [], "set_reference": ["elbow", "equilibrium_position", 0.3]}
"""Methods of simulations and worlds, and their arguments."""


@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize("call", CALLS)
def test_calls_after_close_are_refused(tiny, call, many):
    simulation = asrsim.Worlds(tiny.scenario, 2) if many else asrsim.Simulation(tiny.scenario)
    simulation.close()
    with pytest.raises(SimulationError, match=r"(is|are) closed"):
        getattr(simulation, call)(*CALLS[call])
    simulation.close()


MOVED = asrsim.Start(positions={"elbow": 0.2})


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda w: w.advance(worlds=[0, 0]), "different numbers from 0 to 2"),
        (lambda w: w.advance(worlds=[0, 3]), "different numbers from 0 to 2"),
        (lambda w: w.advance(worlds=[0.7]), "different numbers"),
        (lambda w: w.counts(-1), "different numbers"),
        (lambda w: w.set_reference("elbow", "equilibrium_position", [0.1, 0.2]), "must be numbers of the shape"),
        (lambda w: w.set_state({"elbow": [0.1, 0.2]}), "must be numbers of the shape"),
        (lambda w: w.set_state({}, motors={"elbow": [[0.1], [0.2]]}), "must be numbers of the shape"),
        (lambda w: w.set_state({"elbow": [0.1, 0.2, 99.0]}), "outside the limits"),
        (lambda w: w.reset(asrsim.Start(references={"elbow": {"position": Constant(value=0.1)}})), "no reference 'position'"),
        (
            lambda w: w.reset([MOVED, MOVED, asrsim.Start(references={"elbow": {"equilibrium_position": 0.1}})]),
            "must be a signal",
        ),
        (lambda w: w.reset([MOVED, MOVED, asrsim.Start(parameters={"elbow": {"damping": -1.0}})]), "damping"),
        (lambda w: w.reset([]), "one `Start` for each world"),
        (lambda w: w.record(["link_position"], steps=-1), "must not be negative"),
        (lambda w: w.record("link_position"), "names.*must be a list of quantities.*link_position"),
        (lambda w: w.record(60), "names.*must be a list of quantities.*60"),
    ],
)
def test_wrong_calls_of_worlds_change_nothing(tiny, call, said):
    with asrsim.Worlds(tiny.scenario, 3) as worlds:
        worlds.advance(2)
        before = worlds.observe()
        with pytest.raises(InputError, match=said):
            call(worlds)
        np.testing.assert_array_equal(worlds.observe().link_position, before.link_position)
        assert worlds.time.tolist() == [0.002] * 3


def test_references_that_change_between_resets_take_effect(tiny):
    references = {"elbow": {"equilibrium_position": Constant(value=0.0)}}
    with asrsim.Worlds(tiny.scenario, 1) as worlds:
        for value in (0.1, 0.3):
            references["elbow"]["equilibrium_position"] = Constant(value=value)
            worlds.reset(asrsim.Start(references=references))
            worlds.advance(1)
            assert worlds.read(["reference_1"])["reference_1"] == value


def test_each_world_has_its_own_motor_start(tiny):
    with asrsim.Worlds(tiny.scenario, 3, overrides={"modes.elbow": 6}) as worlds:
        worlds.set_state({}, motors={"elbow": [0.1, 0.2, 0.3]})
        assert worlds.read(["motor_1_position"])["motor_1_position"][:, 0].tolist() == [0.1, 0.2, 0.3]


def test_a_list_of_scenarios_is_refused_where_one_is_needed(tiny):
    loaded = asrsim.load_scenario(tiny.scenario)
    for call in (asrsim.run, asrsim.Simulation):
        with pytest.raises(InputError, match="choose one"):
            call(loaded)
    assert asrsim.load_scenario(tiny.scenario, overrides="duration=0.25")[0].duration == 0.25


@pytest.mark.parametrize("options", [{"duration": -1.0}, {"duration": 0.0}, {"duration": 1e-5}, {"duration": math.nan},
                                     {"duration": math.inf}, {"chunk": 0}, {"chunk": -3}])  # fmt: skip
def test_durations_and_chunks_below_one_step_are_refused(tiny, options):
    with pytest.raises(InputError, match=f"{next(iter(options))}: must (be at least one step|be at least 1 substep)"):
        asrsim.Simulation(tiny.scenario, **options)
    with asrsim.Simulation(tiny.scenario, duration=0.001, chunk=1, record=True) as shortest:
        shortest.advance_to(shortest.total)
        assert shortest.samples.time.tolist() == [0.0, 0.001]
