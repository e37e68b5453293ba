"""`asrsim identify` on recordings with known true parameters."""

import json
import math
import re
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

import asrsim
from asrsim import identify
from asrsim.designs.advice import advice, design_line
from asrsim.designs.limits import read_limits
from asrsim.errors import InputError
from asrsim.identification import run, task_of
from asrsim.identification.data import PlayedCommand, read_data
from asrsim.identification.parameters import numbers_of
from asrsim.identification.problem import read_scenario
from asrsim.identification.result import estimates
from asrsim.identification.show import judgement
from asrsim.identification.task import Tie, Wish
from asrsim.identification.track import Played
from asrsim.identification.uncertainty import uncertainty
from asrsim.identification.write import fit_data, write_robot
from asrsim.recordings import read_recording
from asrsim.robot import load_robot
from asrsim.scenario.recording_plan import make_plan
from asrsim.sweeps.fitted import joint_of
from support.exact_swing import DAMPING, STIFFNESS, swing
from support.identify_files import BENCH, CHIRP, SEA, bench, modelled, prepared, record, save, write
from support.paths import EXAMPLES

FREE = ["joint_1.spring_stiffness", "link_1.izz", "joint_1.damping"]
GUESS = {**SEA, "damping": 0.03, "izz": 0.009, "tags": "<spring_k>3.0</spring_k>"}


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Folder with a recording of the true robot, and the scenario of a guess."""
    folder = tmp_path_factory.mktemp("lab")
    true = write(folder, "true", SEA, f"{{equilibrium_position: {CHIRP}}}")
    record(true, folder / "a.csv")
    record(true, folder / "b.csv", seed=1)
    write(folder, "lab", GUESS)
    return folder


@pytest.fixture(scope="module")
def fitted(lab):
    free = ["joint_1.spring_stiffness", "joint_1.damping"]
    return identify(lab / "lab.yaml", [lab / "a.csv"], free=free)


def test_estimates_are_near_the_truth_and_the_intervals_hold_it(fitted):
    truth = {"joint_1.spring_stiffness": 4.0, "joint_1.damping": 0.02}
    for key, value in truth.items():
        one = fitted.find(key)
        assert one.verdict == "identified"
        assert one.low - 0.5 * (one.high - one.low) < value < one.high + 0.5 * (one.high - one.low)
        assert one.value == pytest.approx(value, rel=0.02)
    assert fitted.fits, fitted.misfit
    assert fitted.channels[0].held_after == pytest.approx(1e-3, rel=0.2)


def test_a_parameter_without_effect_has_a_reason(lab):
    free = ["joint_1.spring_stiffness", "joint_1.motor_1_inertia"]
    result = identify(lab / "lab.yaml", [lab / "a.csv"], free=free, check=True)
    one = result.find("joint_1.motor_1_inertia")
    assert (one.verdict, one.reason) == ("no effect", "no compared channel depends on it in mode 3 (SpringEqPres)")


def test_a_spring_without_effect_says_that_the_mode_has_none(tmp_path):
    """Its deflection was recorded, so that a sentence about the recorded channels would be wrong."""
    goal = 0.2 * np.sin(9.0 * np.arange(0.0, 1.0, 1e-2))
    heading = "time [s],joint_1.reference_1 [N m],joint_1.link_position [rad],joint_1.deflection [rad]"
    table = save(tmp_path / "a.csv", heading, np.arange(0.0, 1.0, 1e-2), goal, -goal, 0.1 * goal**2)
    lab = write(tmp_path, "lab", {**SEA, "mode": 0})
    result = identify(lab, [table], free=["joint_1.spring_stiffness", "link_1.izz"], check=True)
    assert result.find("joint_1.spring_stiffness").reason.startswith("mode 0 (LinkTorque) has no spring")


def test_an_effect_that_a_diverging_simulation_hides_is_not_denied():
    problem = modelled(lambda _: None, 1, 2000)
    (one,), _ = estimates(problem, np.zeros(1), uncertainty(problem, np.zeros(1), foreseen=True))
    assert one.reason == "the simulation diverges, so no effect can be computed"


def test_an_inertia_without_effect_is_reported(tmp_path):
    light = {**SEA, "damping": 0.5, "izz": 2e-5}
    recording = record(write(tmp_path, "true", light, f"{{equilibrium_position: {CHIRP}}}"), tmp_path / "a.csv")
    izz = identify(write(tmp_path, "lab", {**light, "izz": 0.009}), [recording], free=["link_1.izz"]).find("link_1.izz")
    assert izz.verdict == "no effect"
    assert "can be explained without it" in izz.reason


STEPS = "{waypoints: {points: [[0.0, 0.0], [0.5, 0.3], [1.0, -0.2], [1.5, 0.25]], interpolation: hold}}"


@pytest.mark.parametrize(("reference", "substeps"), [(STEPS, 1), (CHIRP, 10)])
def test_a_simulated_log_is_explained_completely(tmp_path, reference, substeps):
    """A log without noise is explained to the last digits with the substeps of its run. Finer substeps of the run, and the
    input between samples, cause no misfit.
    """
    true = write(tmp_path, "true", SEA, f"{{equilibrium_position: {reference}}}")
    true.write_text(f"{true.read_text()}substeps: {substeps}\n")
    log = record(true, tmp_path / "a.csv", noise=0.0, every=1)
    result = identify(write(tmp_path, "lab", GUESS), [log], free=["joint_1.spring_stiffness", "joint_1.damping"])
    assert result.find("joint_1.spring_stiffness").value == pytest.approx(4.0, rel=1e-9 if substeps == 1 else 2e-4)
    assert result.fits, result.misfit


def test_a_start_may_need_more_substeps_than_the_estimate(tmp_path):
    """With the substeps of the estimate, the spring of the start would be unstable."""
    recording = record(write(tmp_path, "true", SEA, f"{{equilibrium_position: {CHIRP}}}"), tmp_path / "a.csv")
    lab = write(tmp_path, "lab", {**SEA, "tags": "<spring_k>4000</spring_k>"})
    lab.write_text(f"{lab.read_text()}step: 0.01\n")
    found = identify(lab, [recording], free=["joint_1.spring_stiffness", "joint_1.damping"])
    assert found.find("joint_1.spring_stiffness").value == pytest.approx(4.0, rel=2e-3)


def test_delay_and_offset_are_found(tmp_path):
    true = write(tmp_path, "true", SEA, f"{{equilibrium_position: {CHIRP}}}")
    record(true, tmp_path / "a.csv", offset=0.05, late=6)
    write(tmp_path, "lab", GUESS)
    free = ["joint_1.spring_stiffness", "joint_1.damping", "clock", "joint_1.link_position.offset"]
    result = identify(tmp_path / "lab.yaml", [tmp_path / "a.csv"], free=free)
    # The difference at the start counts as an offset, not as another initial position.
    assert [one.name for one in result.estimates] == free
    assert result.find("clock").value == pytest.approx(0.006, abs=3e-4)
    assert result.find("joint_1.link_position.offset").value == pytest.approx(0.05, abs=3e-4)


def test_a_delay_that_is_ignored_is_suspected(tmp_path):
    true = write(tmp_path, "true", SEA, f"{{equilibrium_position: {CHIRP}}}")
    recording, free = record(true, tmp_path / "a.csv", late=12), ["joint_1.spring_stiffness", "joint_1.damping"]
    result = identify(write(tmp_path, "lab", GUESS), [recording], free=free)
    assert not result.fits
    assert any("a delay of the commands (12" in text for text in result.causes), result.causes


def test_two_recordings_share_the_parameters_of_the_robot(lab):
    free = ["joint_1.spring_stiffness", "joint_1.damping", "clock"]
    result = identify(lab / "lab.yaml", [lab / "a.csv"], validate=[lab / "b.csv"], free=free[:2])
    assert [one.recording for one in result.channels] == ["a.csv", "b.csv"]
    assert np.isnan(result.channels[1].after)
    assert result.channels[1].held_after == pytest.approx(1e-3, rel=0.2)
    both = identify(lab / "lab.yaml", [lab / "a.csv", lab / "b.csv"], free=free, check=True)
    assert [one.name for one in both.estimates][2:] == ["clock (a.csv)", "clock (b.csv)"]


@pytest.mark.parametrize(
    ("free", "ties", "message"),
    [
        (["joint_1.spring_stifness"], [], "Did you mean 'joint_1.spring_stiffness'"),
        ([], [], "no parameter is free"),
        (["joint_1.damping"], ["joint_1.damping=joint_1.damping"], "is not free"),
        (["joint_1.damping"], ["joint_1.friction=link_1.mass"], "is not free"),
        (["joint_1.damping=5:1"], [], "its lower bound is not below its upper bound"),
        (["joint_1.damping=0:9:5"], [], "its start value is out of range"),
        *(([f"joint_1.damping={value}"], [], "is not a free parameter") for value in ("x", "0:1:2:3")),
    ],
)
def test_wrong_input_is_one_clear_error(lab, free, ties, message):
    with pytest.raises(InputError) as found:
        identify(lab / "lab.yaml", [lab / "a.csv"], free=free, ties=ties)
    assert message in str(found.value)


def test_uninformative_recordings_are_refused(tmp_path, lab):
    time = np.arange(0.0, 1.0, 0.01)
    noise = 1e-3 * np.random.default_rng(0).normal(size=100)
    write(tmp_path, "torque", {**SEA, "mode": 0})
    for columns, message, scenario in (
        ((time, noise, 0 * time), "no channel moves", lab / "lab.yaml"),
        ((time[:6], np.sin(9.0 * time[:6]), time[:6] ** 2), "are too few for", lab / "lab.yaml"),
        ((time, np.sin(time)), "commands of joint_1 are missing", tmp_path / "torque.yaml"),
    ):
        names = ("time", "joint_1.link_position", "joint_1.reference_1")
        recording = save(tmp_path / "a.csv", ",".join(names[: len(columns)]), *columns)
        with pytest.raises(InputError, match=message):
            identify(scenario, [recording], free=[*FREE, "joint_1.friction", "link_1.mass", "clock"])


def test_the_written_robot_keeps_the_layout_of_its_file(lab, tmp_path, asrsim_command):
    arguments = ("-e", lab / "a.csv", "--free", "joint_1.spring_stiffness", "--free", "joint_1.damping", "--no-plot")
    done = asrsim_command("identify", lab / "lab.yaml", *arguments, "--out", tmp_path)
    assert done.code == 0, done.err
    data = json.loads((tmp_path / "fit.json").read_text())
    assert data["fits"]
    assert len(data["covariance"]) == len(data["keys"]) == 2
    before, after = (lab / "lab.urdf").read_text().splitlines(), (tmp_path / "lab.urdf").read_text().splitlines()
    changed = [(a, b) for a, b in zip(before, after, strict=False) if a != b]
    assert len(changed) == 2
    assert all("<!-- guessed -->" in b for a, b in changed if "guessed" in a)
    assert load_robot(tmp_path / "lab.urdf").joint("joint_1").damping == pytest.approx(0.02, rel=0.05)


def test_a_xacro_robot_is_written_as_plain_urdf(fitted, tmp_path):
    source = tmp_path / "lab.urdf.xacro"
    source.write_text('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"/>')
    files, said = write_robot(replace(fitted, robot=replace(fitted.robot, path=source)), tmp_path)
    assert (files[0].name, "expanded URDF" in said[-1]) == ("lab.urdf", True)
    assert load_robot(files[0]).joint("joint_1").damping == pytest.approx(fitted.find("joint_1.damping").value, rel=1e-6)


@pytest.mark.parametrize(
    ("mode", "unit", "quantity", "reason"),
    [
        (0, "N m", "elastic_torque_1 [N m]", "has no spring"),
        (3, "rad", "motor_1_position [rad]", "follow their"),
        (6, "rad", "link_velocity [rad/s]", "compute velocities"),
        (3, "rad", "elastic_torque_1 [N m]", "never changes"),
        (6, "rad", "motor_1_temperature [°C]", "'Heating of the motors' is off at the start of the fit"),
    ],
)
def test_columns_that_no_fit_can_use_are_named_with_the_reason(tmp_path, mode, unit, quantity, reason):
    time, noise = np.arange(0.0, 4.0, 2e-3), 1e-3 * np.random.default_rng(0).normal(size=(2, 2000))
    columns = {
        "time [s]": time,
        f"joint_1.reference_1 [{unit}]": np.sin(time),
        "joint_1.link_position [rad]": np.sin(time) + noise[0],
    }
    columns[f"joint_1.{quantity}"] = np.full(2000, 0.5) if reason == "never changes" else np.cos(time) + noise[1]
    with ExitStack() as stack:
        data = prepared(stack, tmp_path, columns, ["joint_1.damping"], mode=mode).tracks[0].data
        assert [channel.quantity for channel in data.channels] == ["link_position"]
        (remark,) = (one for one in data.remarks if one.endswith(f"joint_1.{quantity.partition(' ')[0]}"))
    assert reason in remark


@pytest.mark.parametrize(("mode", "first"), [(4, "N m"), (6, "rad")])
def test_a_recorded_adjuster_without_unit_is_in_metres(tmp_path, mode, first):
    robot = EXAMPLES / "urdf" / "dof1_awas_ii.urdf"
    (tmp_path / "robot.yaml").write_text(f"robot: {robot}\nmodes: {{joint_1: {mode}}}\nduration: 1\n")
    time = np.arange(0.0, 1.0, 0.01)
    rows = "".join(f"{t:.2f},{math.sin(t)},{0.01 + 0.001 * t},{0.9 * math.sin(t)}\n" for t in time)
    (tmp_path / "a.csv").write_text("t [s],goal,pivot,q [rad]\n" + rows)
    meanings = ["goal=joint_1.reference_1", "pivot=joint_1.reference_2", "q=joint_1.link_position"]
    task = task_of(tmp_path / "robot.yaml", [tmp_path / "a.csv"], mapping=meanings, free=["joint_1.damping"])
    scenario, _, robot = read_scenario(task)
    (data,) = read_data(task, scenario, robot)
    assert [command.unit for command in data.commands] == [first, "m"]


def test_the_limits_of_the_next_experiment_are_the_recorded_ones(lab, tmp_path):
    """If only ratios are identified, a torque sensor is proposed."""
    result = identify(lab / "lab.yaml", [lab / "a.csv"], free=FREE)
    assert design_line(result, tmp_path) == design_line(result, tmp_path)
    (path,), line = design_line(result, tmp_path)
    read = read_limits(path)
    place = np.genfromtxt(lab / "a.csv", delimiter=",", names=True)["joint_1link_position_rad"]
    assert read.limits["joint_1"]["link_position"] == pytest.approx((place.min(), place.max()), abs=5e-3)
    assert read.sensors == ("elastic_torque",)
    assert read.rate == pytest.approx(500.0)
    assert line.startswith(f"asrsim design {lab / 'lab.yaml'} --free joint_1.spring_stiffness")
    tied = replace(result, task=replace(result.task, ties=(Tie(key="b", to="a", factor=2.0),)))
    assert "--tie 'b=2*a'" in design_line(tied, tmp_path)[1]
    varied = replace(result, task=replace(result.task, variant="soft", overrides=("step=2e-3",)))
    assert "lab.yaml --variant soft --set step=2e-3 --free" in design_line(varied, tmp_path)[1]
    assert any("move joint_1 at" in text and "Hz" in text for text in advice(result))


def test_a_longer_recording_is_advised_only_if_noise_makes_intervals_wide(lab):
    """Neither the errors of a wrong model nor doubts about narrow intervals fall with the length of a recording."""
    fitted = identify(lab / "lab.yaml", [lab / "a.csv"], free=["joint_1.damping"])

    def advised(half, misfit=()):
        (one,) = fitted.estimates
        one = replace(one, verdict="weak", low=one.value * (1.0 - half), high=one.value * (1.0 + half))
        return [*advice(replace(fitted, estimates=(one,), misfit=misfit, causes=()))]

    assert any("4.0 times as long" in text for text in advised(0.1))
    assert advised(0.01) == advised(0.01, ("it diverges",)) == []
    assert not any("times as long" in text for text in advised(0.1, ("it diverges",)))


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("joint_1.friction", "at less than {slow:.2g} rad/s, and reverse often"),
        ("joint_1.motor_1_friction_torque", "at less than {slow:.2g} rad/s, and reverse often"),
        ("joint_1.damping", "faster than {fast:.2g} rad/s, and let its oscillation decay"),
        ("link_1.mass", "Hz (recorded: up to"),
        ("link_1.izz", "Hz (recorded: up to"),
        ("joint_1.armature_inertia", "Hz (recorded: up to"),
        ("joint_1.spring_stiffness", "deflect joint_1 more, by loads, presets or reversals (recorded: {half:.2g} rad at up to"),
        ("joint_1.hysteresis_torque", "deflect joint_1 more"),
        ("joint_1.reference_1.delay", ""),
        ("link_2.mass", ""),
    ],
)
def test_the_advised_motion_shows_what_the_parameter_changes(fitted, key, words):
    """Friction shows in slow reversals, damping in fast motions, inertia at high frequencies, and a spring in deflections."""
    lines = fitted.channels[0].lines
    place, speed = lines["after"], np.abs(np.gradient(lines["after"], lines["time"])).max()
    one = replace(fitted.estimates[0], key=key, name=key, verdict="unidentifiable")
    told = [*advice(replace(fitted, estimates=(one,), misfit=(), causes=()))]
    wanted = words.format(slow=0.1 * speed, fast=speed, half=0.5 * np.ptp(place))
    assert [text.startswith(f"{key}: ") and wanted in text for text in told] == [True] * bool(words)
    assert [*advice(replace(fitted, estimates=(one,), causes=("backlash",)))] == []
    bands = re.findall(r"at ([\d.]+) to ([\d.]+) Hz", told[0]) if told else []
    # The chirp ends at 6 Hz, and has harmonics.
    assert all(6.0 <= float(low) < 18.0 for low, _ in bands)
    assert all(float(high) == pytest.approx(3.0 * float(low), rel=0.05) for low, high in bands)


@pytest.mark.parametrize("every", [2, 10])
def test_a_written_scenario_repeats_the_fit_from_any_folder(tmp_path, every):
    """The scenario contains delays of commands, and the interpolation of commands between coarse samples."""
    true = write(tmp_path, "true", SEA, f"{{equilibrium_position: {CHIRP}}}")
    (tmp_path / "data").mkdir()
    recording = record(true, tmp_path / "data/a.csv", late=6, every=every)
    play = "{playback: {file: data/a.csv, column: joint_1.reference_1}}"
    scenario = write(tmp_path, "lab", GUESS, f"{{equilibrium_position: {play}}}")
    scenario.write_text(f"{scenario.read_text()}parameters: {{joint_1: {{motor_1_max_torque: 9.0}}}}\n")
    free = ["joint_1.spring_stiffness", "joint_1.damping", "joint_1.reference_1.delay"]
    (tmp_path / "fits/one").mkdir(parents=True)
    files, said = write_robot(identify(scenario, [recording], free=free), tmp_path / "fits/one")
    assert not said
    run = asrsim.run(files[1])
    assert run.run.scenario.parameters["joint_1"]["motor_1_max_torque"] == 9.0
    recorded = np.genfromtxt(recording, delimiter=",", names=True)
    found = np.interp(recorded["time_s"], run.samples.time, run.samples.joint("joint_1")["link_position"])
    assert np.sqrt(np.mean((found - recorded["joint_1link_position_rad"]) ** 2)) == pytest.approx(1e-3, rel=0.1)


def test_a_draw_of_a_sweep_is_the_written_robot(lab, fitted, tmp_path):
    """Tied parameters are included, and moments of inertia are adjusted to a larger moment."""
    ties = (
        Tie(key="joint_1.friction", to="joint_1.damping", factor=0.5),
        Tie(key="link_1.izz", to="joint_1.damping", factor=5.0),
    )
    tied = replace(fitted, layout=replace(fitted.layout, ties=ties))
    files, _ = write_robot(tied, tmp_path, everything=True)
    (best,) = joint_of(fit_data(tied)).interval(0.0)[:1]
    drawn = asrsim.prepare(lab / "lab.yaml").vary(numbers_of(joint_of(fit_data(tied)).assign(best))).robot
    written = load_robot(files[0])
    assert drawn.links[1].inertia == pytest.approx(written.links[1].inertia, rel=1e-6)
    joints = [robot.joint("joint_1") for robot in (drawn, written)]
    assert joints[0].friction == pytest.approx(0.5 * joints[0].damping) == pytest.approx(joints[1].friction, rel=1e-6)


def test_a_fit_file_contains_the_whole_task(lab, tmp_path, asrsim_command):
    path = tmp_path / "fit.yaml"
    path.write_text(
        f"scenario: {lab / 'lab.yaml'}\nexperiments: [{lab / 'a.csv'}]\nfree:\n  joint_1.spring_*: 3.5\n"
        "  joint_1.damping: {low: 0, high: 1}\nties: {joint_1.friction: 0.5 * joint_1.damping}\n"
    )
    task = task_of(path)
    assert task.free["joint_1.spring_*"].start == 3.5
    assert (task.ties[0].to, task.ties[0].factor) == ("joint_1.damping", 0.5)
    checked = asrsim_command("identify", path, "--check")
    assert (checked.code, "check only" in checked.out) == (0, True)
    with pytest.raises(InputError, match="the option `experiments` is not allowed"):
        task_of(path, [lab / "a.csv"])
    path.write_text("scenario: nothing.yaml\nexperiments: []\nfrree: {}\nfree: [joint_1.damping]\n")
    with pytest.raises(InputError) as found:
        task_of(path)
    assert {problem.line for problem in found.value.problems} == {1, 2, 3, 4}


def test_options_extend_or_replace_keys_of_a_fit_file(lab, tmp_path, asrsim_command):
    path = tmp_path / "fit.yaml"
    path.write_text(
        f"scenario: {lab / 'lab.yaml'}\nexperiments: [{lab / 'a.csv'}]\nhold_out: 0.2\nfree:\n  joint_1.damping: {{low: 0}}\n"
        "  joint_1.spring_stiffness: 3\nties: {joint_1.friction: 0.5 * joint_1.damping}\n"
    )
    options = ("--free", "link_1.izz=0.01", "--free", "joint_1.damping=0.2", "--tie", "joint_1.friction=joint_1.damping")
    checked = asrsim_command("identify", path, *options, "--validate", lab / "b.csv", "--check", "--json")
    starts = {one["key"]: one["start"] for one in json.loads(checked.out)["estimates"]}
    assert starts == {"joint_1.damping": 0.2, "joint_1.spring_stiffness": 3.0, "link_1.izz": 0.01}
    ties = ["joint_1.friction=joint_1.damping"]
    task = task_of(path, free=["joint_1.damping=0.2"], ties=ties, own=["joint_1.damping"], hold_out=0.1)
    assert (task.hold_out, task_of(path).hold_out) == (0.1, 0.2)
    assert task.ties == (Tie(key="joint_1.friction", to="joint_1.damping"),)
    path.write_text(
        path.read_text().replace(f"[{lab / 'a.csv'}]", f"[{{file: {lab / 'a.csv'}, map: [a=joint_1.link_position]}}]")
    )
    (trial,) = task_of(path, mapping=["a=-joint_1.link_position"], rate=50.0).experiments
    assert trial.mapping == ("a=joint_1.link_position", "a=-joint_1.link_position")  # the last one counts
    assert trial.rate == 50.0
    assert task.free["joint_1.damping"] == Wish(start=0.2, low=0.0, own=True)


def test_a_preview_judges_parameters_that_start_at_their_bound(lab):
    free = {"joint_1.damping": 0.0, "joint_1.reference_1.delay": 0.0}
    checked = identify(lab / "lab.yaml", [lab / "a.csv"], free=free, check=True)
    assert [one.value for one in checked.estimates] == [0.0, 0.0]
    assert {one.verdict for one in checked.estimates} <= {"identified", "weak"}
    assert all(0.0 <= one.high < 0.05 for one in checked.estimates)


@pytest.mark.parametrize(("unit", "modes"), [("", {}), (" [rad]", {"joint_1": 6})])
def test_a_command_without_a_unit_is_what_the_mode_takes(tmp_path, unit, modes):
    write(tmp_path, "lab", {**SEA, "mode": 8, "tags": "<mot_kt>0.1</mot_kt>"})
    time = np.arange(50.0)
    recording = save(tmp_path / "a.csv", "t_ms,i_A,theta", time, np.sin(time), np.cos(time))
    maps = [f"i_A=joint_1.reference_1{unit}", "theta=joint_1.motor_1_position"]
    read = read_recording(recording, mapping=maps, joints=["joint_1"])
    assert make_plan(load_robot(tmp_path / "lab.urdf"), read, step=1e-3, idle=()).modes == modes


@pytest.mark.parametrize("stage", ["free simulation", "judgement", "looking for effects that the model lacks"])
def test_stopping_keeps_the_best_fit_so_far(lab, stage):
    """After the stop, the fit takes little more than one simulation for each parameter."""
    told, asked = [], []

    def stop():
        if told and told[-1].task == stage:
            asked.append(told[-1].evaluations)
        return bool(asked)

    free = ["joint_1.damping", "joint_1.friction"]
    result = identify(task_of(lab / "lab.yaml", [lab / "a.csv"], free=free), stop=stop, progress=told.append)
    assert (result.status, bool(asked)) == ("interrupted", True)
    assert result.fits is fit_data(result)["fits"] is None
    assert any(one.task.startswith("observer at ") for one in told)
    assert result.evaluations - asked[0] < 12
    assert len(result.estimates) == 2


def test_a_fit_out_of_time_returns_its_best_estimate(lab):
    told = []
    task = task_of(lab / "lab.yaml", [lab / "a.csv"], free=FREE)
    result = identify(task, duration=1e-3, progress=told.append)
    assert result.status == "unfinished"
    assert len(result.estimates) == 3
    assert all(one.verdict != "identified" for one in result.estimates)
    assert [text for text, _ in judgement(result)][-1] == "unfinished: these are the numbers of the best fit so far"


def test_progress_estimates_the_remaining_time(lab, monkeypatch):
    monkeypatch.setattr(run, "OFTEN", 0.0)
    told = []
    identify(lab / "lab.yaml", [lab / "a.csv"], free=FREE, progress=told.append)
    late = [one for one in told if one.evaluations > 20]
    assert late
    assert all(0.0 <= one.remaining < 600.0 for one in late)
    assert late[-1].remaining <= late[0].remaining


@pytest.mark.parametrize("factor", [8.0, 0.125])
def test_a_weakly_damped_swing_is_fitted_from_a_distant_stiffness(tmp_path, factor):
    numbers = {**SEA, "damping": 0.002, "mode": 2, "tags": "<spring_k>20.0</spring_k>"}
    true = write(tmp_path, "true", numbers, "{reference_1: {step: {at: 0.1, from: 0, to: 0.3}}}", duration=4.0)
    # With steps of 1 ms, the error of the simulated swing is larger than the interval.
    true.write_text(true.read_text() + "substeps: 16\n")
    record(true, tmp_path / "a.csv")
    guess = {**numbers, "damping": 0.05, "tags": f"<spring_k>{20.0 * factor}</spring_k>"}
    lab = write(tmp_path, "lab", guess, duration=4.0)
    found = identify(lab, [tmp_path / "a.csv"], free=["joint_1.spring_stiffness", "joint_1.damping"])
    assert found.fits
    for key, truth in (("joint_1.spring_stiffness", 20.0), ("joint_1.damping", 0.002)):
        assert found.find(key).low < truth < found.find(key).high


def test_commands_that_jump_between_samples_are_timed(tmp_path):
    """An exact swing on a linear spring at 100 Hz. Each step of the command comes up to 10 ms before its first sample. The last
    step is in the held-out part.
    """
    lab, recording, early = swing(tmp_path, seed=18)
    found = identify(lab, [recording], free=["joint_1.spring_stiffness", "joint_1.damping"])
    assert found.fits, found.misfit
    for key, truth in (("joint_1.spring_stiffness", STIFFNESS), ("joint_1.damping", DAMPING)):
        one = found.find(key)
        assert one.verdict == "identified"
        assert abs(one.value - truth) < one.high - one.low
    assert [found.find(f"jump_{n}").value for n in range(1, 7)] == pytest.approx(early, abs=1e-4)


@pytest.mark.parametrize("factor", [1e3, 1e-2])
def test_a_start_may_be_a_thousand_times_off(tmp_path, factor):
    recording = record(write(tmp_path, "true", SEA, f"{{equilibrium_position: {CHIRP}}}"), tmp_path / "a.csv")
    lab = write(tmp_path, "lab", {**SEA, "damping": 0.2, "tags": f"<spring_k>{4.0 * factor}</spring_k>"})
    found = identify(lab, [recording], free=["joint_1.spring_stiffness", "joint_1.damping"])
    assert found.fits
    assert found.find("joint_1.spring_stiffness").value == pytest.approx(4.0, rel=1e-3)


@pytest.mark.slow
def test_a_wrong_tie_is_suspected_instead_of_an_offset(tmp_path):
    def tags(k_1, k_2):
        return f"<spring_k1>{k_1}</spring_k1><spring_k2>{k_2}</spring_k2><spring_a1>6.7</spring_a1><spring_a2>6.7</spring_a2>"

    numbers = {**SEA, "actuator": "qbmove"}
    references = f"{{equilibrium_position: {CHIRP}, stiffness_preset: {{step: {{at: 1.0, from: 0.1, to: 0.3}}}}}}"
    true = write(tmp_path, "true", {**numbers, "tags": tags(0.022, 0.0264)}, references)
    recording = record(true, tmp_path / "a.csv", noise=1e-2)
    lab, free = write(tmp_path, "lab", {**numbers, "tags": tags(0.02, 0.02)}), ["joint_1.spring_k_1", "joint_1.damping"]
    result = identify(lab, [recording], free=free, ties=["joint_1.spring_k_2=joint_1.spring_k_1"])
    assert not result.fits
    assert any("joint_1.spring_k_2" in text and "tied" in text for text in result.causes), result.causes
    assert any("joint_1.spring_k_2 is tied to joint_1.spring_k_1" in text for text in result.misfit), result.misfit
    assert not any("offset" in text for text in result.causes), result.causes


@pytest.mark.filterwarnings("error")
def test_a_prediction_that_stands_still_is_judged(tmp_path):
    """Friction in the model holds the link, so the prediction is constant and depends on no free parameter."""
    recording = record(write(tmp_path, "true", SEA, f"{{equilibrium_position: {CHIRP}}}"), tmp_path / "a.csv")
    result = identify(write(tmp_path, "lab", {**SEA, "friction": 100.0}), [recording], free=["joint_1.damping"])
    assert not result.fits
    (friction,) = re.findall(r"another friction of joint_1 \((\S+) N m\) is suspected", "\n".join(result.causes))
    assert float(friction) < 1e-3


def test_a_channel_that_nothing_explains_may_be_another_quantity(tmp_path):
    """Short predictions explain any smooth channel, but a free simulation does not."""
    time, generator = np.arange(0.0, 1.0, 2e-3), np.random.default_rng(0)
    walk = 0.05 * generator.normal(size=len(time)).cumsum()
    header = "time [s],joint_1.reference_1,joint_1.link_position [rad]"
    recording = save(tmp_path / "a.csv", header, time, np.sin(4.0 * time), walk)
    result = identify(write(tmp_path, "lab", SEA), [recording], free=["joint_1.damping"])
    assert not result.fits
    assert any("link_position: the fit hardly explains it" in text for text in result.causes), result.causes


@pytest.mark.parametrize(
    ("width", "cause"),
    [(0.0, "falls with the amplitude"), pytest.param(2e-3, "backlash of joint_1 (0.002", marks=pytest.mark.slow)],
)
def test_softening_and_backlash_are_detected_on_the_bench(tmp_path, width, cause):
    time, deflection, trials = np.arange(0.0, 4.0, 0.02), np.linspace(-0.02, 0.02, 20001), []
    soft = 1.5 * np.tanh(deflection / 1e-3) if not width else -1099.9 * np.clip(deflection, -0.5 * width, 0.5 * width)
    generator = np.random.default_rng(0)
    for amplitude in (0.5, 2.0, 4.0, 8.0):
        applied = amplitude * np.sin(0.5 * np.pi * time)
        angle = np.interp(applied, 1100.0 * deflection + soft, deflection) + 1e-5 * generator.normal(size=len(time))
        torque = applied + 0.01 * generator.normal(size=len(time))
        trials.append(save(tmp_path / f"{amplitude}.csv", BENCH, time, angle, torque))
    result = identify(bench(tmp_path, 2000), trials, free=["joint_1.spring_stiffness"])
    assert not result.fits
    assert any(cause in text for text in result.causes), result.causes
    assert result.find("joint_1.spring_stiffness").margin > 0.05


@pytest.mark.slow
def test_a_recorded_axis_gives_the_published_numbers(tmp_path, shared):
    (tmp_path / "axis.urdf").write_text(
        '<robot name="axis"><link name="world"/><joint name="axis" type="prismatic"><parent link="world"/><child link="mass"/>'
        '<axis xyz="1 0 0"/><limit effort="1e5" velocity="100" lower="-10" upper="10"/><dynamics damping="150" friction="10"/>'
        '</joint><link name="mass"><inertial><mass value="60"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
        '</inertial></link><gazebo><plugin name="p" filename="libsea_plugin.so"><joint>axis</joint><operation_mode>0'
        "</operation_mode><pub_eltau>false</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau></plugin>"
        "</gazebo></robot>"
    )
    (tmp_path / "axis.yaml").write_text("robot: axis.urdf\nduration: 24\n")
    recording = shared / "recordings/emps_estimation.csv"
    result = identify(
        tmp_path / "axis.yaml",
        [recording],
        free=["mass.mass", "axis.damping", "axis.friction", "axis.reference_1.offset"],
        mapping=["force_N=axis.reference_1", "reference_m=ignore", "voltage_V=ignore"],
    )
    for one, published in zip(result.estimates, (95.1089, 203.5034, 20.3935, -3.1648), strict=False):
        # The offset is one percent of the friction beside which it acts.
        assert one.value == pytest.approx(published, rel=0.01, abs=0.2 if "offset" in one.key else 0.0)
        assert one.low < published < one.high


@pytest.mark.parametrize("hold", [True, False])
@pytest.mark.parametrize("delay", [0.0, 0.0123])
def test_a_played_command_jumps_where_the_recording_does(hold, delay):
    """Large jumps are reported at their samples; near the jumps the played command has the recorded values."""
    time = np.arange(0.0, 1.0, 0.01)
    values = np.where(time > 0.305, 1.0, 0.0) + (0.0 if hold else 0.05 * time)
    command = PlayedCommand(joint="j", quantity="reference_1", name="q", time=time, values=values, hold=hold, unit="rad")
    played = Played(command=command, step=1e-3, delay=delay, gain=2.0, offset=0.1)
    assert played.jumps(0.0, 1.0) == pytest.approx([0.31 + delay])
    assert played.jumps(0.4, 0.5).size == 0
    asked = np.array([0.105, 0.295, 0.315, 0.505, 0.905])
    at = values[(100 * asked).astype(int)] if hold else np.interp(asked, time, values)
    assert played.values(asked + delay) == pytest.approx(2.0 * (at - 0.1), abs=1e-3)
    beside = played.values(np.array([0.31 + delay - 1e-5, 0.31 + delay + 1e-5]))
    assert np.diff(beside) == pytest.approx([2.0], abs=0.05)
