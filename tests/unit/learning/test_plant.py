"""Learning on the simulated robot: problem from the scenario, playback of the result, perturbed plants, the command."""

from __future__ import annotations

import json
import re
from itertools import pairwise

import numpy as np
import pytest
from typer.testing import CliRunner

import asrsim
from asrsim.errors import ScenarioError
from asrsim.learning import learn
from asrsim.learning.arm import learning_model
from asrsim.learning.identity import identity_of
from asrsim.learning.plant import make_plant
from asrsim.learning.prepared import prepare_learning
from asrsim.learning.session import run_session
from asrsim.learning.transfer import outputs_of, perturbed
from asrsim.runs.repeat import repeat
from asrsim.scenario import load_scenario, make_scenario
from asrsim.simulation.run import simulate
from asrsim.summary import claim_results
from asrsim.workers import executor
from support.paths import EXAMPLES

pytestmark = pytest.mark.once

CUBE = EXAMPLES / "urdf" / "dof1_qbmove_cube.urdf"


def plant(robot=CUBE, **changes):
    """One joint that lifts its cube in 1 s, at a coarse step: a trial takes some milliseconds."""
    block = {
        "trajectory": {"joint_1": {"minimum_jerk": {"duration": 1.0, "to": 0.4}}},
        "law": "paper",
        "gain": 0.8,
        "tolerance": 0.03,
        "max_iterations": 25,
        "keep_logs": "none",
    }
    scenario = make_scenario(
        robot,
        duration=1.5,
        step=2e-3,
        references={"joint_1": {"stiffness_preset": 0.2}},
        ilc={**block, **changes.pop("ilc", {})},
        **changes,
    )
    return make_plant(scenario)


def holds(scenario, robot=None):
    """Whether every claim holds in a run."""
    run = simulate(scenario, robot)
    results = claim_results(scenario.expect, run.info.joints, lambda quantities, joints: run.samples)
    return all(result.holds for result in results)


def solve(chosen):
    with learning_model(chosen) as model:
        prepared = prepare_learning(chosen, model)
        return prepared, learn(prepared.problem, chosen.outputs, prepared.settings, law=prepared.law)


def test_the_joint_learns_to_lift_its_load():
    chosen = plant()
    _, result = solve(chosen)
    assert result.converged
    assert np.abs(chosen.reference - chosen.outputs(result.inputs)).max() <= 0.03
    assert result.inputs[-1, 0] > 0.45  # the spring's deflection under gravity is learned


def test_gains_from_the_model_learn_faster_than_the_paper_s():
    _, fixed = solve(plant(ilc={"gain": 0.5}))
    prepared, chosen = solve(plant(ilc={"gain": "model"}))
    assert tuple(prepared.settings.joint_gains.values()) == prepared.gain_advice()
    assert chosen.converged
    assert chosen.iterations < fixed.iterations


def test_the_written_playback_repeats_the_learned_motion_bit_by_bit(tmp_path):
    chosen = plant()
    session = run_session(chosen, tmp_path, picture=False)
    scenario = load_scenario(tmp_path / "learned.yaml")[0]
    samples = simulate(scenario).samples
    assert samples is not None
    assert np.array_equal(samples.values["link_position"], session.result.trials[session.result.best].outputs)
    assert {claim.joint for claim in scenario.expect} == {"joint_1"}
    assert scenario.name == f"{chosen.scenario.name}_learned"
    assert holds(scenario)


@pytest.mark.parametrize("computed", [True, False])
def test_the_playback_of_some_joints_leaves_the_others_as_they_were(tmp_path, computed):
    """The other joint's input, if it is computed, follows from what the learned one is to do."""
    motion = {"minimum_jerk": {"duration": 0.25, "to": 0.2}}
    everyone = {"equilibrium_position": motion, "stiffness_preset": 0.4, "inverse_dynamics": computed}
    learning = {"tolerance": 1e-6, "max_iterations": 2, "trajectory": {"joint_1": motion}}
    scenario = make_scenario(EXAMPLES / "urdf" / "dof2_vertical.urdf", duration=0.4, references={"*": everyone}, ilc=learning)
    chosen = make_plant(scenario)
    session = run_session(chosen, tmp_path, picture=False)
    replayed = load_scenario(tmp_path / "learned.yaml")[0]
    samples = simulate(replayed).samples
    assert samples is not None
    np.testing.assert_array_equal(samples.values["link_position"][:, [0]], session.result.trials[session.result.best].outputs)
    assert holds(replayed)


def test_the_playback_s_claim_is_the_error_over_the_whole_time_and_fails_on_another_robot(tmp_path):
    """The learned error, not the tolerance: a little more mass, a shifted input, and the claim no longer holds."""
    chosen = plant()
    session = run_session(chosen, tmp_path, picture=False)
    (error,) = session.result.best_trial.largest
    scenario = load_scenario(tmp_path / "learned.yaml")[0]
    (claim,) = scenario.expect
    assert error <= claim.value <= 1.01 * error
    heavier = perturbed(chosen, {"mass.joint_1": 0.03}).robot
    assert not holds(scenario, heavier)
    path = tmp_path / "learned.csv"
    lines = path.read_text().splitlines()
    early = [line.split(",")[0] + "," + later.split(",")[1] for line, later in zip(lines[2:-25], lines[27:], strict=True)]
    path.write_text("\n".join([*lines[:2], *early]) + "\n")
    shifted = load_scenario(tmp_path / "learned.yaml")[0]
    assert not holds(shifted)


def test_a_session_writes_what_it_promises(tmp_path):
    run_session(plant(ilc={"max_iterations": 2, "tolerance": 1e-6}), tmp_path, keep_logs="all")
    assert {path.name for path in tmp_path.iterdir()} == {
        "state.npz", "learned.csv", "desired.csv", "learned.yaml", "ilc.json", "ilc.png",
        "trial_000.mcap", "trial_001.mcap", "trial_002.mcap",
    }  # fmt: skip
    data = json.loads((tmp_path / "ilc.json").read_text())
    assert data["outcome"] == "exhausted"
    assert [trial["iteration"] for trial in data["trials"]] == [0, 1, 2]


def test_trials_share_one_preparation_and_give_the_bits_of_runs_of_their_own(monkeypatch):
    from asrsim.simulation import prepare

    made, real = [], prepare.describe
    monkeypatch.setattr(prepare, "describe", lambda *arguments: made.append(1) or real(*arguments))
    chosen = plant()
    trials = [np.full_like(chosen.reference, level) for level in (0.0, 0.4, 0.2)]
    outputs = [chosen.outputs(inputs) for inputs in trials]
    assert len(made) == 1
    for inputs, output in zip(trials, outputs, strict=True):
        run = simulate(chosen.with_inputs(inputs))
        assert np.array_equal(run.samples.values["link_position"], output)


def test_a_run_whose_input_is_computed_follows_the_motion_and_its_log_repeats_it(tmp_path):
    wanted = {"minimum_jerk": {"duration": 1.0, "to": 0.4}}
    errors = []
    for computed in (False, True):
        joint = {"equilibrium_position": wanted, "stiffness_preset": 0.2, "inverse_dynamics": computed}
        scenario = make_scenario(CUBE, duration=1.5, step=2e-3, references={"joint_1": joint}, desired={"joint_1": wanted})
        result = asrsim.run(scenario, out=tmp_path / str(computed))
        motion = scenario.desired["joint_1"].values(result.time)
        errors.append(float(np.abs(result["joint_1"]["link_position"] - motion).max()))
        assert repeat(result.log, out=tmp_path / f"again_{computed}").identical
    assert errors[1] < 0.1 * errors[0]


def test_a_heavier_link_hangs_lower_and_draws_zero_change_nothing():
    chosen = plant()
    inputs = np.full_like(chosen.reference, 0.4)
    same = perturbed(chosen, {"mass.joint_1": 0.0, "friction.joint_1": 0.0, "parameters.joint_1.spring_k_1": 0.0, "delay": 0.0})
    assert np.array_equal(same.outputs(inputs), chosen.outputs(inputs))
    assert perturbed(chosen, {"mass.joint_1": 1.0}).outputs(inputs)[-1, 0] < chosen.outputs(inputs)[-1, 0] - 0.02


def test_a_stiffer_spring_named_by_its_tag_hangs_higher():
    chosen = plant()
    inputs = np.full_like(chosen.reference, 0.4)
    stiffer = perturbed(chosen, {"parameters.joint_1.spring_k1": 0.5, "parameters.joint_1.spring_k2": 0.5})
    assert stiffer.outputs(inputs)[-1, 0] > chosen.outputs(inputs)[-1, 0] + 0.02


def test_a_delay_shifts_the_motion():
    chosen = plant()
    inputs = chosen.reference
    late, on_time = perturbed(chosen, {"delay": 0.02}).outputs(inputs), chosen.outputs(inputs)
    assert late[10:] == pytest.approx(on_time[:-10], abs=2e-3)
    assert np.abs(late - on_time).max() > 5e-3


def test_an_unknown_parameter_of_a_spread_is_named():
    with pytest.raises(ScenarioError, match="no such parameter"):
        perturbed(plant(), {"parameters.joint_1.spring_z": 0.1})


def test_a_link_that_is_fixed_to_a_varied_one_varies_with_it(tmp_path):
    path = tmp_path / "tool.urdf"
    tool = (
        '<link name="tool"><inertial><mass value="0.3"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>'
        '</inertial></link><joint name="flange" type="fixed"><parent link="LINK"/><child link="tool"/>'
        '<origin xyz="0 0 -0.1"/></joint>'
    )
    child = plant().robot.joint("joint_1").child
    shelf = tool.replace("tool", "shelf").replace("flange", "wall").replace("LINK", plant().robot.root.name)
    tip = tool.replace("tool", "tip").replace("flange", "screw").replace("LINK", "tool")
    path.write_text(CUBE.read_text().replace("</robot>", tool.replace("LINK", child) + tip + shelf + "</robot>"))
    chosen = plant(path)
    robots = chosen.robot, perturbed(chosen, {"mass.joint_1": 0.2}).robot
    masses = [{link.name: link.mass or 0.0 for link in robot.links} for robot in robots]
    wanted = {name: mass * (1.2 if name in (child, "tool", "tip") else 1.0) for name, mass in masses[0].items()}
    assert masses[1] == pytest.approx(wanted)
    with learning_model(chosen) as model, learning_model(perturbed(chosen, {"mass.joint_1": 0.2})) as heavier:
        postures = [np.array([[0.4]]), np.zeros((1, 1)), np.zeros((1, 1))]
        loads = [item.arm.model.inverse_dynamics(*postures)[0, 0] for item in (model, heavier)]
    assert loads[1] == pytest.approx(1.2 * loads[0], rel=1e-9)


def test_friction_can_be_added_where_there_is_none(tmp_path):
    path = tmp_path / "smooth.urdf"
    path.write_text(re.sub(r'friction="[^"]*"', 'friction="0"', CUBE.read_text()))
    chosen = plant(path)
    inputs = chosen.reference
    changed = perturbed(chosen, {"added_friction.joint_1": 0.05})
    assert changed.robot.joint("joint_1").friction == pytest.approx(0.05)
    assert np.abs(changed.outputs(inputs) - chosen.outputs(inputs)).max() > 1e-3
    assert np.array_equal(perturbed(chosen, {"friction.joint_1": 0.5}).robot.joint("joint_1").friction, 0.0)


def test_the_default_gain_and_the_model_s_are_safe_by_themselves():
    for gain in (0.5, "model"):
        prepared, result = solve(
            plant(ilc={"law": "filtered", "gain": gain, "tolerance": 1e-5, "max_iterations": 20, "patience": 30})
        )
        assert prepared.settings.filter is not None
        assert result.trials[-1].worst < 1.3 * result.best_trial.worst


def test_every_file_that_the_plant_depends_on_counts(tmp_path):
    """A resumed run is refused when a playback that another reference plays has changed."""
    recording = tmp_path / "torque.csv"
    recording.write_text("time [s],torque [N m]\n0,0\n1.5,0\n")
    torque = {"joint_1": {"playback": {"file": str(recording), "column": "torque"}}}
    before = identity_of(plant(external_torques=torque))
    assert identity_of(plant(external_torques=torque)) == before
    recording.write_text("time [s],torque [N m]\n0,0\n1.5,0.01\n")
    assert identity_of(plant(external_torques=torque)) != before


def test_what_a_plant_is_does_not_hang_on_how_it_is_written(tmp_path):
    """Another order of keys, and what may change between resumptions, leave it the plant that it was."""
    wave = {"amplitude": 0.01, "angular_frequency": 1.0}
    one = plant(gravity=[0.0, 0.0, -9.8], external_torques={"joint_1": {"sinusoid": wave}})
    reverse = {"joint_1": {"sinusoid": dict(reversed(wave.items()))}}
    other = plant(external_torques=reverse, gravity=[0.0, 0.0, -9.8], log_rate=100.0, ilc={"gain": 0.5})
    assert identity_of(one) == identity_of(other)


def test_whatever_moves_a_plant_otherwise_makes_it_another(tmp_path):
    """The robot's text under the same path, any number of the scenario, the contents of files that are exchanged."""
    robot, files = tmp_path / "arm.urdf", [tmp_path / name for name in ("a.csv", "b.csv")]
    tables = [f"time [s],torque [N m]\n0,0\n1.5,{size}\n" for size in (0.0, 0.01)]
    torque, motor = ({"playback": {"file": str(file), "column": "torque"}} for file in files)
    found = set()
    for text in (CUBE.read_text(), re.sub(r'mass value="[^"]*"', 'mass value="0.3"', CUBE.read_text())):
        robot.write_text(text)
        for order in (tables, tables[::-1], tables[:1] * 2):
            for file, table in zip(files, order, strict=True):
                file.write_text(table)
            for gravity in ([0.0, 0.0, -9.8], [0.0, 0.1, -9.8]):
                chosen = plant(robot, gravity=gravity, external_torques={"joint_1": {"sum": [torque, motor]}})
                found.add(identity_of(chosen))
    assert len(found) == 12


@pytest.mark.slow
def test_processes_change_nothing_in_the_numbers():
    chosen = plant()
    draws = [{"mass.joint_1": change} for change in (-0.1, 0.0, 0.1)]
    with executor(1) as here, executor(2) as there:
        alone, together = (outputs_of(chosen, chosen.reference, draws, workers) for workers in (here, there))
    assert all(np.array_equal(a, b) for a, b in zip(alone, together, strict=True))


def test_a_scenario_without_ilc_and_a_mode_without_position_are_errors():
    with pytest.raises(ScenarioError, match="ilc"):
        make_plant(make_scenario(CUBE, duration=1.0))
    with pytest.raises(ScenarioError, match="mode 4"):
        plant(modes=4)


@pytest.fixture
def scenario_file(tmp_path):
    path = tmp_path / "lift.yaml"
    path.write_text(
        f"robot: {CUBE}\nduration: 1.0\nstep: 0.002\nreferences: {{joint_1: {{stiffness_preset: 0.2}}}}\n"
        "ilc:\n  trajectory: {joint_1: {minimum_jerk: {duration: 0.8, to: 0.3}}}\n  tolerance: 0.05\n  law: paper\n"
        "  gain: 0.8\n  keep_logs: none\n  transfer: {draws: 6, spread: {mass: 0.2}}\n"
    )
    return path


def command():
    import typer

    from asrsim.cli.ilc import ilc

    app = typer.Typer()
    app.command()(ilc)
    return app


def test_the_command_learns_and_transfers(scenario_file, tmp_path):
    out = tmp_path / "out"
    result = CliRunner().invoke(
        command(), [str(scenario_file), "--out", str(out), "--transfer", "--processes", "1", "--no-plot"]
    )
    assert result.exit_code == 0, result.output
    assert "converged after" in result.output
    assert "of 6 plants stay within 0.05 rad" in result.output
    assert (out / "learned.csv").read_text().splitlines()[1] == "time [s],joint_1 [rad]"


def test_the_command_fails_where_learning_does_not_converge(scenario_file, tmp_path):
    result = CliRunner().invoke(
        command(), [str(scenario_file), "--out", str(tmp_path / "o"), "--set", "ilc.max_iterations=1", "--json", "--no-plot"]
    )
    assert result.exit_code == 1
    assert json.loads(result.output)["outcome"] == "exhausted"


@pytest.mark.slow
def test_the_paper_s_learning_converges_in_eleven_iterations():
    """Section 4.3 and figure 15: iterations, last errors, norms and final equilibrium."""
    chosen = make_plant(load_scenario(EXAMPLES / "scenarios" / "ilc_2dof.yaml")[0])
    prepared, result = solve(chosen)
    trials = result.trials
    assert result.converged
    assert result.iterations == 11
    assert [max(trial.largest) for trial in trials[-2:]] == pytest.approx([0.0842, 0.0750], abs=2e-4)
    assert (trials[0].norm, trials[-1].norm) == (pytest.approx(1.160, abs=6e-3), pytest.approx(0.082, abs=1e-3))
    assert result.inputs[-1] == pytest.approx([1.391, 1.145], abs=1e-3)
    # asrsim 0.1, whose friction let joints creep and whose velocity torques were held over some steps.
    first = [1.155613730, 0.926231119, 0.685612862, 0.488195729, 0.346592446, 0.249907949]
    first += [0.185618044, 0.151358508, 0.126808899, 0.108158255, 0.093732709, 0.082406890]
    assert [trial.norm for trial in trials] == pytest.approx(first, abs=1e-7)
    assert all(later.norm < earlier.norm for earlier, later in pairwise(trials))
    assert sum(trial.seconds for trial in trials) < 60.0
    assert prepared.problem.joints == ("joint_1", "joint_2")


def test_a_sliding_joint_is_learned_in_metres(tmp_path):
    slides = tmp_path / "slides.urdf"
    slides.write_text(CUBE.read_text().replace('type="revolute"', 'type="prismatic"'))
    arm = plant(slides, compiled=False, ilc={"law": "auto", "tolerance": 1e-5, "max_iterations": 1})
    session = run_session(arm, tmp_path / "out", picture=False)
    units = {item.what: item.unit for item in session.prepared.demands}
    assert units["motor torque"] == units["spring torque"] == "N"
    assert (units["motor speed"], units["spring deflection"], units["error from the start"]) == ("m/s", "m", "m")
    assert re.search(r"still [\d.e-]+ m off .* tolerance 1e-05 m$", session.result.reason)
