"""The law `auto` on random arms, its model, and on robots that are not asrsim, through recordings."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from asrsim.actuators import QbMove
from asrsim.errors import InputError, ScenarioError
from asrsim.kinematics import plan_references
from asrsim.kinematics.drive_inverse import drive_backwards
from asrsim.learning import LearningProblem
from asrsim.learning.hardware import next_input
from asrsim.learning.optimal import InputSplines, NormOptimal, lift, standing
from asrsim.learning.plant import make_plant
from asrsim.learning.prepared import learning_model, prepare_learning
from asrsim.learning.twin import Unexplained, fit_twin
from asrsim.scenario import apply_to_robot, make_scenario
from asrsim.simulation.examine import examine
from asrsim.simulation.run import simulate
from support.examined import checked_robot
from support.identify_files import save
from support.lessons import inputs_in, learned, plant_of, play, record
from support.paths import ROOT
from support.robots import drive_with
from support.soft_arm import perturbed, random_arm

ARM = ROOT / "examples" / "urdf" / "dof2_vertical.urdf"


def weaker(arm, factor):
    """Arm whose torque limits are multiplied."""
    return arm.scaled(lambda name: factor if name == "motor_1_max_torque" else 1.0)


@pytest.mark.parametrize("seed", [5, 10, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 6, 17))])
def test_arms_that_can_follow_do_without_tuning(seed, tmp_path):
    prepared, result = learned(plant_of(tmp_path, *random_arm(seed)))
    assert prepared.reach(result) == "within reach"
    assert min(trial.worst for trial in result.trials[:6]) <= 0.02
    assert result.best.worst <= 0.005


def test_a_motion_out_of_reach_names_joint_and_time(tmp_path):
    arm, *motion = random_arm(5)
    prepared, result = learned(plant_of(tmp_path, weaker(arm, 0.01), *motion, max_iterations=4))
    assert re.search(r"out of reach: .* rad; joint_\d at [\d.]+ s: motor torque", prepared.reach(result))
    assert any(line.startswith("beyond its limit: joint_") for line in prepared.before)


def test_a_short_torque_beyond_the_limit_may_be_within_reach(tmp_path):
    """Inverse dynamics needs 140 % of the torque; with the limit in force trials come within the tolerance."""
    arm, *motion = random_arm(2)
    model = learning_model(plant_of(tmp_path, arm, *motion))
    most = max(item.score for item in model.inverse.demands if item.what == "motor torque")
    prepared, result = learned(plant_of(tmp_path, weaker(arm, most / 1.4), *motion))
    assert prepared.demands[0].score == pytest.approx(1.4, abs=0.01)
    assert prepared.reach(result).startswith("within reach, although")


def pushed(linear, joints):
    """Positions of the first joint for a swinging input."""
    each = lift(linear, InputSplines.over(1.0, 0.0), [0.0] * joints)[:, 0, ::joints]
    time = np.linspace(0.0, 1.0, each.shape[1])
    return each @ (time * np.sin(12.0 * time))


def test_joints_that_do_not_learn_are_soft_too():
    """A push on the first joint moves it as it does where both joints learn, and not as if the second were held."""
    still = {"references": {"*": {"stiffness_preset": 0.1}}, "gravity": [0.0, 0.0, 0.0], "duration": 1.0}
    moved = []
    for joints in (("joint_1", "joint_2"), ("joint_1",)):
        block = {"trajectory": dict.fromkeys(joints, 0.0), "tolerance": 1e-3}
        plant = make_plant(examine(make_scenario(ARM, ilc=block, **still)))
        linear = learning_model(plant).linear
        moved.append(pushed(linear, len(joints)))
        held = replace(linear, springs=linear.springs * np.array([1.0, 1e4])[:, None])
        stiff = pushed(held, len(joints))
    np.testing.assert_allclose(moved[1], moved[0], atol=1e-3 * np.abs(moved[0]).max())
    assert np.abs(stiff - moved[0]).max() > 0.1 * np.abs(moved[0]).max()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_springs_can_hold_is_told_for_both_directions(side):
    """Two unequal springs: k sinh(a d) with both deflected to their limit."""
    spring = (6.0, 0.02, 4.0, 0.05, 0.5)
    drive = drive_with(QbMove, mode=3, joint="one", spring=spring)
    time, still = np.linspace(0.0, 1.0, 101), np.zeros(101)
    found = drive_backwards(drive, time, still, still, still + 0.05 * side, still + 0.1)
    most = side * (0.02 * np.sinh(3.0) + 0.05 * np.sinh(2.0))
    np.testing.assert_allclose(found.holdable, most, rtol=1e-6)
    np.testing.assert_allclose(sum(QbMove.elastic_torques(0.0, *found.motors[50], spring)), 0.05 * side, rtol=1e-6)


def trials(*totals):
    """Trials of one joint that is off by so much."""
    zero = np.zeros((2, 1))
    problem = LearningProblem(joints=("one",), time=np.arange(2.0), reference=zero, first_guess=zero)
    return problem, [problem.trial(number, zero, zero + total) for number, total in enumerate(totals)]


def test_after_a_worse_trial_the_best_gets_ten_times_weight():
    best, rho, failed = standing(trials(1.0, 0.5, 0.8)[1])
    assert (best.number, failed) == (1, 1)
    assert rho == pytest.approx(1.0)
    best, rho, failed = standing(trials(1.0, 0.5, 0.8, 0.4)[1])
    assert (best.number, failed) == (3, 0)
    assert rho == pytest.approx(1.0 / 3.0)
    assert standing(trials(1.0, float("nan"))[1])[0].number == 0
    # Less than a hundredth is no progress.
    best, rho, failed = standing(trials(1.0, 0.4, 0.399)[1])
    assert (best.number, failed) == (2, 1)


@pytest.mark.parametrize("patience", [2, 3])
def test_learning_ends_after_more_than_patience_trials_without_progress(patience):
    problem, found = trials(1.0, *[2.0] * 8)
    law = NormOptimal(problem=problem, lifted=None)
    assert next(count for count in range(1, 10) if law.verdict(found[:count], patience) is not None) == 2 + patience


def test_what_was_learned_does_not_jump_at_the_end(tmp_path):
    """Inputs of the last moments act behind the end; they must be those that hold the pose."""
    _, result = learned(plant_of(tmp_path, *random_arm(1), first_guess="zero", max_iterations=4, tolerance=1e-5))
    steps = np.abs(np.diff(result.inputs, axis=0))
    assert steps[-300:].max() < 2.0 * steps[1000:-300].max()


@pytest.mark.parametrize("start", ["equilibrium", 0.0345])
def test_the_twin_is_fitted_to_trials_that_begin_as_the_scenario_states(tmp_path, start):
    """At equilibrium, or at a position from which the arm moves at once."""
    plant = plant_of(tmp_path, *random_arm(6))
    if start != "equilibrium":
        plant = make_plant(examine(replace(plant.scenario, initial_equilibrium=False, initial_positions={"*": start})))
    problem = prepare_learning(plant).problem
    outputs = plant.varied({}, 0.01).outputs(problem.first_guess)
    found = fit_twin(plant, [problem.trial(0, problem.first_guess, outputs)], {})
    misfit = np.sqrt(np.mean((plant.outputs(problem.first_guess) - outputs) ** 2))
    assert found.before == pytest.approx(misfit, rel=1e-3)


def test_masses_and_delay_are_found_from_a_trial_without_noise(tmp_path):
    """The twin is the robot, and not only closer to it."""
    plant = plant_of(tmp_path, *random_arm(6))
    links = [plant.robot.joint(joint).child for joint in plant.joints]
    masses = {link.name: link.mass for link in plant.robot.links}
    robot = plant.varied({links[0]: {"mass": 1.2 * masses[links[0]]}, links[1]: {"mass": 0.8 * masses[links[1]]}}, 0.02)
    problem = prepare_learning(plant).problem
    found = fit_twin(plant, [problem.trial(0, problem.first_guess, robot.outputs(problem.first_guess))], {})
    assert found.residual < 0.05 * found.before
    assert found.changes["delay"] == pytest.approx(0.02, abs=0.002)
    assert [found.changes[f"mass.{joint}"] for joint in plant.joints[:2]] == pytest.approx([0.2, -0.2], abs=0.05)


def test_learning_continues_with_recordings_of_an_independent_robot(tmp_path):
    """Masses and stiffnesses off by 25 %, losses by 50 %, 10 ms, 1 mrad of noise."""
    arm, *motion = random_arm(0)
    plant, robot = plant_of(tmp_path, arm, *motion), perturbed(arm, 0)
    inputs = learning_model(plant).guess
    errors = []
    for number in range(3):
        path = tmp_path / f"trial_{number}.csv"
        errors.append(record(path, plant, robot, inputs, seed=number))
        step = next_input(plant, tmp_path, path)
        inputs = inputs_in(tmp_path / "next.csv", plant)
        if step.converged:
            break
    assert errors[0] > 0.01
    assert step.converged
    assert [replace(step, foretold=ratio).warning is not None for ratio in (1.0, 2.0, np.inf)] == [False, True, True]
    assert errors[-1] < 0.004
    assert len(json.loads((tmp_path / "hardware.json").read_text())["trials"]) == len(errors)
    if len(errors) > 1:
        with pytest.raises(InputError, match="was already used as trial 0"):
            next_input(plant, tmp_path, tmp_path / "trial_0.csv")


def test_a_prediction_is_as_good_as_those_of_recorded_trials():
    """Two trials at 10 and 50 mrad from the best were predicted within 1 and 4 mrad; 6 mrad of the best are not explained."""
    known = Unexplained(most=6e-3, misses=((0.05, 4e-3), (0.01, 1e-3)))
    assert [known.of_change(size) for size in (5e-4, 8e-3, 0.03, 0.2)] == [5e-4, 1e-3, 4e-3, 6e-3]


def test_a_motion_that_no_twin_explains_counts_in_what_is_foretold(tmp_path):
    """The recorded joints swing by 20 mrad, which no twin explains. The announced error is at least the predicted one and once
    more the predicted change, and the change is so small that it is hardly above the limit.
    """
    plant = plant_of(tmp_path, *random_arm(0))
    time = plant.time[::5]
    swing = 0.02 * np.sin(2.0 * np.pi * 3.0 * time)[:, None]
    outputs = plant.outputs(learning_model(plant).guess)[::5] + swing
    header = ",".join(["time [s]", *(f"{joint}.link_position [rad]" for joint in plant.joints)])
    save(tmp_path / "a.csv", header, time, *outputs.T)
    step = next_input(plant, tmp_path, tmp_path / "a.csv")
    (best,) = step.trials
    predicted = step.twin.forecasts(best)[0](inputs_in(tmp_path / "next.csv", plant))
    change, error = (np.abs(predicted - one).max() for one in (best.outputs, plant.reference))
    assert change > 1e-3
    assert (error + change) / best.worst <= step.foretold * (1.0 + 1e-9) < 1.3
    assert (step.warning is None) == (step.foretold <= 1.2)


@pytest.mark.slow
def test_a_worse_trial_is_foretold_before_its_input_is_played(tmp_path):
    """A gain of 3 makes errors grow."""
    arm, *motion = random_arm(4)
    robot = perturbed(arm, 4)
    plant = plant_of(tmp_path, arm, *motion, law="paper", gain=3.0, first_guess="inverse_dynamics")
    before = record(tmp_path / "trial_0.csv", plant, robot, learning_model(plant).guess)
    step = next_input(plant, tmp_path, tmp_path / "trial_0.csv")
    after = np.abs(plant.reference - play(robot, plant, inputs_in(tmp_path / "next.csv", plant))).max()
    assert after > 1.2 * before
    assert step.warning is not None


@pytest.mark.parametrize(
    "changes",
    [
        {"imperfections": {"commands": {"*": {"delay": 0.03}}}},
        {"external_torques": {"joint_1": {"sinusoid": {"amplitude": 0.2, "frequency": 1.0}}}},
        {"link_damping": {"*": {"constant": 0.1, "ratio": 0.2, "inertia": 0.01}}},
        {"parameters": {"*": {"controller_1_integral": 200.0, "controller_2_integral": 200.0}}},
        {"modes": 3},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_the_model_of_learning_contains_the_scenario_s_effects(changes):
    """Inverse dynamics counts it: trial 0 is within some mrad, and every update helps."""
    motion = {"*": {"minimum_jerk": {"duration": 1.2, "to": 0.15}}}
    block = {"trajectory": motion, "tolerance": 1e-3, "max_iterations": 12}
    stiff = {"*": {"stiffness_preset": 0.2}}
    scenario = make_scenario(ARM, duration=1.5, references=stiff, ilc=block, **changes)
    _, result = learned(make_plant(examine(scenario)))
    worst = [trial.worst for trial in result.trials]
    assert worst[0] < 5e-3
    assert worst == sorted(worst, reverse=True)
    assert result.converged


@pytest.mark.parametrize("mode", [1, 3, 6])
def test_inverse_dynamics_gives_the_inputs_of_the_wanted_motion(mode):
    rise = {"minimum_jerk": {"duration": 2.0, "to": 0.6}}
    # The motors lag behind a preset that changes.
    preset = {"sinusoid": {"amplitude": 0.1, "frequency": 1.0, "offset": 0.3}}
    wanted = {"link_position": rise} if mode == 1 else {"equilibrium_position": rise, "stiffness_preset": preset}
    scenario = make_scenario(ARM, duration=2.5, modes=mode, references={"*": wanted}, inverse_dynamics=True)
    robot = apply_to_robot(scenario, checked_robot(scenario)[0])
    planned = replace(plan_references(scenario, robot), inverse_dynamics={})
    samples = simulate(planned).samples
    motion = next(iter(scenario.references["*"].values())).values(samples.time)
    assert np.abs(samples.values["link_position"] - motion[:, None]).max() < 4e-3


def test_inverse_dynamics_beyond_a_spring_is_an_error():
    wanted = {"equilibrium_position": {"minimum_jerk": {"duration": 2.0, "to": 0.6}}, "stiffness_preset": 0.3}
    plain = make_scenario(ARM, duration=2.5, references={"*": wanted}, inverse_dynamics=False)
    robot = apply_to_robot(plain, checked_robot(plain)[0])
    assert plan_references(plain, robot) is plain
    weak = make_scenario(
        ARM,
        duration=2.5,
        references={"*": wanted},
        inverse_dynamics=True,
        parameters={"*": {"max_deflection": 0.05}},
    )
    with pytest.raises(ScenarioError, match=r"out of reach: joint_. at .* s: spring torque"):
        plan_references(weak, apply_to_robot(weak, checked_robot(weak)[0]))
