"""Learning on the simulated robot: problem from the scenario, playback of the result, varied plants."""

import re

import numpy as np
import pytest

from asrsim.errors import InputError, ScenarioError
from asrsim.learning import learn
from asrsim.learning.plant import make_plant
from asrsim.robot.vary import varied_robot
from asrsim.scenario import load_scenario, make_scenario
from asrsim.simulation.examine import examine
from asrsim.simulation.run import simulate
from asrsim.summary import claim_results
from support.lessons import learned
from support.paths import EXAMPLES

CUBE = EXAMPLES / "urdf" / "dof1_qbmove_cube.urdf"


def plant(robot=CUBE, **changes):
    """One joint that lifts its cube in 1 s, at a coarse step: a trial takes some milliseconds."""
    block = {
        "trajectory": {"joint_1": {"minimum_jerk": {"duration": 1.0, "to": 0.4}}},
        "law": "paper",
        "gain": 0.8,
        "tolerance": 0.03,
        "max_iterations": 25,
    }
    scenario = make_scenario(
        robot,
        duration=1.5,
        step=2e-3,
        references={"joint_1": {"stiffness_preset": 0.2}},
        ilc={**block, **changes.pop("ilc", {})},
        **changes,
    )
    return make_plant(examine(scenario))


def holds(scenario, robot=None):
    """Whether every claim holds in a run."""
    run = simulate(scenario, robot)
    results = claim_results(scenario.expect, run.info.joints, lambda quantities, joints: run.samples)
    return all(result.holds for result in results)


@pytest.mark.parametrize("initial", [{}, "equilibrium"])
def test_the_written_playback_repeats_the_learned_motion_bit_by_bit(tmp_path, initial):
    """An equilibrium at the start depends on the first inputs."""
    chosen = plant(initial=initial)
    session = learn(chosen.scenario, tmp_path, picture=False)
    scenario = load_scenario(tmp_path / "learned.yaml")[0]
    samples = simulate(scenario).samples
    assert np.array_equal(samples.values["link_position"], session.result.best.outputs)
    assert holds(scenario)


@pytest.mark.parametrize("computed", [True, False])
def test_playback_of_some_joints_does_not_change_the_others(tmp_path, computed):
    """The other joint's input, if it is computed, follows from what the learned one is to do."""
    motion = {"minimum_jerk": {"duration": 0.25, "to": 0.2}}
    everyone = {"equilibrium_position": motion, "stiffness_preset": 0.4}
    learning = {"tolerance": 1e-6, "max_iterations": 2, "trajectory": {"joint_1": motion}}
    scenario = make_scenario(
        EXAMPLES / "urdf" / "dof2_vertical.urdf",
        duration=0.4,
        references={"*": everyone},
        ilc=learning,
        inverse_dynamics=computed,
    )
    chosen = make_plant(examine(scenario))
    session = learn(chosen.scenario, tmp_path, picture=False)
    replayed = load_scenario(tmp_path / "learned.yaml")[0]
    samples = simulate(replayed).samples
    np.testing.assert_array_equal(samples.values["link_position"][:, [0]], session.result.best.outputs)
    assert holds(replayed)


def test_the_claim_of_a_playback_fails_on_another_robot(tmp_path):
    """The learned error, not the tolerance: with a little more mass the claim no longer holds."""
    chosen = plant()
    session = learn(chosen.scenario, tmp_path, picture=False)
    (error,) = session.result.best.largest
    scenario = load_scenario(tmp_path / "learned.yaml")[0]
    (claim,) = scenario.expect
    assert error <= claim.value <= 1.01 * error
    heavier = varied_robot(chosen.robot, {chosen.robot.joint("joint_1").child: {"mass": 0.56}})
    assert not holds(scenario, heavier)


@pytest.mark.parametrize("law", ["paper", "auto"])
@pytest.mark.parametrize("after", [1, 3])
def test_resumed_learning_repeats_an_unbroken_run_bit_by_bit(tmp_path, law, after):
    """The first run is killed after some trials: no results are written."""
    chosen, seen = plant(ilc={"law": law, "tolerance": 1e-9, "max_iterations": 5}), []

    def killed(trial):
        seen.append(trial)
        if len(seen) == after:
            raise KeyboardInterrupt

    whole = learn(chosen.scenario, tmp_path / "whole", picture=False).result
    with pytest.raises(KeyboardInterrupt):
        learn(chosen.scenario, tmp_path / "cut", on_trial=killed)
    resumed = learn(chosen.scenario, tmp_path / "cut", on_trial=seen.append, resume=True, picture=False).result
    assert [trial.number for trial in seen] == list(range(len(whole.trials)))
    for ours, theirs in zip(resumed.trials, whole.trials, strict=True):
        assert np.array_equal([ours.inputs, ours.outputs], [theirs.inputs, theirs.outputs])


@pytest.mark.parametrize("changed", ["arm.urdf", "push.csv", "part.obj", "the scenario"])
def test_learning_is_not_resumed_after_a_file_changed(tmp_path, changed):
    mesh = '<collision><geometry><mesh filename="part.obj"/></geometry></collision></link>'
    (tmp_path / "arm.urdf").write_text(CUBE.read_text().replace("</link>", mesh))
    (tmp_path / "push.csv").write_text("time [s],torque [N m]\n0,0.1\n2,0.1\n")
    (tmp_path / "part.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")
    push = {"joint_1": {"playback": {"file": str(tmp_path / "push.csv"), "column": "torque"}}}
    given = {"robot": tmp_path / "arm.urdf", "external_torques": push, "compiled": False}
    learn(plant(**given, ilc={"max_iterations": 1}).scenario, tmp_path / "out", picture=False)
    if changed == "the scenario":
        given["gravity"] = [0.0, 0.0, -9.0]
    else:
        (tmp_path / changed).write_text((tmp_path / changed).read_text().replace("0.1", "0.11"))
    with pytest.raises(InputError, match=rf"have changed: [^,]*{changed}\. Delete state"):
        learn(plant(**given).scenario, tmp_path / "out", resume=True)


def test_learning_needs_a_block_ilc_and_a_position_mode():
    with pytest.raises(ScenarioError, match="ilc"):
        make_plant(examine(make_scenario(CUBE, duration=1.0)))
    with pytest.raises(ScenarioError, match="mode 4"):
        plant(modes=4)


def test_a_gain_needs_a_joint_that_learns():
    arm = EXAMPLES / "urdf" / "dof2_horizontal.urdf"
    block = {"tolerance": 0.01, "trajectory": {"joint_1": {"minimum_jerk": {"duration": 0.5, "to": 0.2}}}}
    scenario = {"duration": 1.0, "references": {"*": {"stiffness_preset": 0.3}}}
    assert make_plant(examine(make_scenario(arm, ilc={**block, "joint_gains": {"joint_1": 0.3}}, **scenario)))
    with pytest.raises(ScenarioError, match=r"ilc\.joint_gains\.joint_2: this joint is not among the joints that learn"):
        make_plant(examine(make_scenario(arm, ilc={**block, "joint_gains": {"joint_2": 0.3}}, **scenario)))


@pytest.mark.slow
def test_the_paper_s_learning_converges_in_eleven_iterations():
    """Section 4.3 and figure 15: iterations, last errors, norms and final equilibrium."""
    chosen = make_plant(examine(load_scenario(EXAMPLES / "scenarios" / "ilc_2dof.yaml")[0]))
    _, result = learned(chosen)
    trials = result.trials
    assert result.converged
    assert result.iterations == 11
    assert [max(trial.largest) for trial in trials[-2:]] == pytest.approx([0.0842, 0.0750], abs=2e-4)
    assert (trials[0].norm, trials[-1].norm) == (pytest.approx(1.160, abs=6e-3), pytest.approx(0.082, abs=1e-3))
    assert result.inputs[-1] == pytest.approx([1.391, 1.145], abs=1e-3)


def test_a_sliding_joint_is_learned_in_metres(tmp_path):
    slides = tmp_path / "slides.urdf"
    slides.write_text(CUBE.read_text().replace('type="revolute"', 'type="prismatic"'))
    arm = plant(slides, compiled=False, ilc={"law": "auto", "tolerance": 1e-5, "max_iterations": 1})
    session = learn(arm.scenario, tmp_path / "out", picture=False)
    units = {item.what: item.unit for item in session.prepared.demands}
    assert units["motor torque"] == units["spring torque"] == "N"
    assert (units["motor speed"], units["spring deflection"]) == ("m/s", "m")
    assert re.search(r"the largest error .* is [\d.]+ mm .* tolerance 10 µm$", session.result.reason)
