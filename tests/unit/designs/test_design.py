"""Designed experiments: predicted intervals, limits, and errors for impossible requests."""

from dataclasses import replace

import numpy as np
import pytest

import asrsim
from asrsim.designs import design
from asrsim.designs.write import charts, write_design
from asrsim.recordings import read_recording
from support.identify_files import save
from support.paths import EXAMPLES

SEA = EXAMPLES / "scenarios" / "step_1dof_sea.yaml"
FREE = ["joint_1.spring_stiffness", "joint_1.damping"]
UNSEARCHED = {"rounds": 0, "stop": lambda: True}
"""Options by which a design is the first motion within the limits, for facts that hold for every motion."""
WITHIN = "limits: {joint_1: {link_position: [-1.4, 1.4], link_velocity: 60, deflection: 0.6}}\n"


@pytest.fixture
def limits(tmp_path):
    def written(text=WITHIN):
        path = tmp_path / "lab.limits.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return written


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    path = tmp_path_factory.mktemp("design") / "lab.limits.yaml"
    path.write_text(WITHIN + "noise: {link_position: 0.001}\n", encoding="utf-8")
    return design(SEA, path, variant="soft", free=FREE, duration=0.6, rounds=1)


@pytest.mark.parametrize(("noise", "every"), [(0.05, 1), (0.2, 4)])
def test_information_about_a_spring_is_the_sum_of_squared_torques(limits, noise, every):
    text = f"limits: {{joint_1: {{link_position: 0.5}}}}\nnoise: {{elastic_torque_1: {noise}}}\nrate: {1000 / every}\n"
    path = limits(text)
    found = design(SEA, path, variant="soft", overrides=["engine=bench"], free=FREE[:1], duration=1.0, **UNSEARCHED)
    torque = 200.0 * found.found.motion[0, ::every]
    assert found.found.information[0, 0, 0] == pytest.approx(np.sum(torque**2) / noise**2, rel=1e-4)


def test_information_of_a_recording_adds_to_that_of_every_motion(limits, tmp_path):
    joint = asrsim.run(SEA, variant="soft", overrides=["duration=0.5"])["joint_1"].link_position
    recording = save(tmp_path / "a.csv", "time [s],joint_1.link_position [rad]", 1e-3 * np.arange(len(joint)), joint)
    plain, more = (
        design(SEA, limits(), variant="soft", free=FREE[:1], duration=1.0, experiments=files, **UNSEARCHED)
        for files in ([], [recording])
    )
    gained = [more.intervals[name][0] ** -2 - plain.intervals[name][0] ** -2 for name in ("one step", "chirp")]
    assert gained[0] == pytest.approx(gained[1], rel=1e-5)
    assert gained[0] > 0.0


def test_intervals_are_smaller_than_with_a_step_or_a_chirp(found):
    assert set(found.intervals) == {"design", "one step", "chirp"}
    mean = {name: np.exp(np.log(halves).mean()) for name, halves in found.intervals.items()}
    assert mean["design"] < min(mean["one step"], mean["chirp"])


def test_written_scenario_plays_the_motion_within_its_limits(found, tmp_path):
    csv, scenario, *_ = write_design(found, tmp_path / "excite.csv", plot=False)
    joint = asrsim.run(scenario)["joint_1"]
    assert (
        0.5
        < max(
            np.abs(joint.link_position).max() / 1.4,
            np.abs(joint.link_velocity).max() / 60.0,
            np.abs(joint.deflection).max() / 0.6,
        )
        <= 1.0 + 1e-3
    )
    assert [str(one.quantity) for one in read_recording(csv).channels.values()] == ["reference_1"]


def test_each_reference_has_its_column_and_its_chart(found, tmp_path):
    """As if the design had two references and three parameters."""
    other = replace(found.references[0], joint="joint_2", name="stiffness_preset", slot=1, unit="m", low=-0.5, high=2.0)
    time = found.step * np.arange(found.found.motion.shape[1])
    motion = np.array([found.found.motion[0], np.sin(time)])
    halves = {"design": np.array([0.01, 0.2, 0.03]), "chirp": np.array([0.05, 0.3, 0.04])}
    both = replace(
        found,
        references=(found.references[0], other),
        found=replace(found.found, motion=motion),
        intervals=halves,
        keys=(*found.keys, "joint_2.damping"),
    )
    rows = charts(both)
    for (chart,), one, values in zip(rows[:-1], both.references, motion, strict=True):
        assert (chart.head, chart.words, chart.unit) == (one.joint, one.name.replace("_", " "), one.unit)
        low, high, drawn = chart.lines
        assert (low.y.tolist(), high.y.tolist(), low.x.tolist()) == ([one.low] * 2, [one.high] * 2, [0.0, time[-1]])
        np.testing.assert_array_equal([drawn.x, drawn.y], [time, values])
    (intervals,) = rows[-1]
    assert intervals.places == ["spring stiffness of joint_1", "damping of joint_1", "damping of joint_2"]
    assert {line.label: line.x.tolist() for line in intervals.lines} == {name: (100 * x).tolist() for name, x in halves.items()}
    assert [line.y.tolist() for line in intervals.lines] == [[0.0, 1.0, 2.0]] * 2
    path, *_ = write_design(both, tmp_path / "excite.csv", plot=False)
    assert path.read_text().splitlines()[1] == f"time [s],{found.references[0].heading},joint_2.reference_2 [m]"
    np.testing.assert_allclose(np.loadtxt(path, delimiter=",", skiprows=2).T, [time, *motion], atol=1e-9)


def test_predicted_interval_agrees_with_finite_differences_of_runs(limits, tmp_path):
    """A sticking SEA, one number free: slopes from two runs of the written scenario, 6e-4 apart."""
    robot = EXAMPLES / "urdf" / "dof1_qbmove_cube.urdf"
    text = f"robot: {robot}\nduration: 1\nactuators: {{joint_1: {{type: sea, mode: 6}}}}\ninitial: equilibrium\n"
    lab = limits(f"{text}parameters: {{joint_1: {{spring_stiffness: 8}}}}\n")
    lab = lab.rename(tmp_path / "lab.yaml")
    within = limits("limits: {joint_1: {link_position: 1.2, deflection: 0.6}}\nnoise: {link_position: 0.001}\n")
    one = design(lab, within, free=["joint_1.spring_stiffness"], duration=1.0, **UNSEARCHED)
    _, scenario, *_ = write_design(one, tmp_path / "excite.csv", plot=False)
    low, high = (
        asrsim.run(scenario, overrides=[f"parameters.joint_1.spring_stiffness={8.0 * np.exp(h)}"])["joint_1"].link_position
        for h in (-3e-4, 3e-4)
    )
    half = 1.96 / np.sqrt(np.sum(((high - low) / 6e-4 / 0.001) ** 2))
    assert one.intervals["design"][0] == pytest.approx(half, rel=0.25)


def test_intervals_shrink_with_the_root_of_the_time(found):
    """Until the half-width is 5 %, but never shorter than an experiment."""
    assert found.needed == pytest.approx(np.maximum(0.5, (found.intervals["design"] / 0.05) ** 2))


def test_motion_begins_and_ends_at_the_reference_of_the_start(found):
    assert found.found.motion[0, 0] == found.found.motion[0, -1] == found.references[0].home


@pytest.mark.slow
def test_same_seed_gives_the_same_motion(limits):
    first, again, other = (
        design(SEA, limits(), variant="soft", free=FREE[:1], duration=0.5, rounds=1, seed=seed) for seed in (3, 3, 4)
    )
    assert np.array_equal(first.found.motion, again.found.motion)
    assert not np.array_equal(first.found.motion, other.found.motion)


def test_interrupted_design_keeps_the_best_so_far(limits):
    found = design(SEA, limits(), variant="soft", free=FREE, duration=1.0, stop=lambda: True)
    assert found.interrupted
    assert np.abs(found.found.motion).max() > 0.0


def test_unknown_joints_and_quantities_are_named_with_their_lines(limits):
    path = limits("limits:\n  joint_2:\n    link_position: 1\n  joint_1: {link_position: 1, link_velocty: 2}\n")
    with pytest.raises(asrsim.InputError) as error:
        design(SEA, path, variant="soft", free=FREE)
    assert [(one.key, one.line) for one in error.value.problems] == [("limits.joint_2", 3), ("limits.joint_1.link_velocty", 4)]


def test_parameter_without_any_effect_is_named_before_the_search(limits):
    with pytest.raises(asrsim.InputError, match="no motion identifies it") as error:
        design(SEA, limits(), variant="soft", free=[*FREE, "joint_1.motor_1_inertia"], duration=0.5)
    assert [one.key for one in error.value.problems] == ["joint_1.motor_1_inertia"]


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        ("limits: {joint_1: {link_position: [0.5, 1.0]}}\n", {}, "begins outside this limit"),
        (
            "limits: {joint_1: {link_position: [0.5, 1.0]}}\n",
            {"overrides": ["references=", "initial.joint_1=0.3"]},
            "begins outside this limit, at 0.3",
        ),
        (WITHIN, {"duration": 0.2}, "is too short: .* takes at least 0.5 s"),
        (WITHIN, {"free": []}, "no parameter is free"),
        (WITHIN + "choose: {sensors: [elastic_torque]}\n", {}, "has no noise"),
        ("limits: {joint_1: {link_position: [1.0, -1.0]}}\n", {}, "not below its upper limit"),
        (WITHIN + "choose: {joint_1.controler_1_proportional: [1, 2]}\n", {}, "2: .* is not a parameter of the robot"),
    ],
)
def test_impossible_designs_are_refused_with_the_reason(limits, text, options, said):
    with pytest.raises(asrsim.InputError, match=said):
        design(SEA, limits(text), **{"variant": "soft", "free": FREE, **options})


def test_a_start_beyond_a_limit_names_quantity_and_remedy(limits):
    """Motors that begin away from their presets need more torque than the limit at once."""
    robot = EXAMPLES / "urdf" / "dof1_qbmove_cube.urdf"
    scenario = limits(f"robot: {robot}\nduration: 1\nmodes: 6\nreferences: {{joint_1: {{stiffness_preset: 0.3}}}}\n")
    scenario = scenario.rename(scenario.with_name("lab.yaml"))
    path = limits("limits: {joint_1: {link_position: 1, motor_torque: 5}}\n")
    with pytest.raises(asrsim.InputError, match=r"motor_1_torque reaches .* times its limit") as error:
        design(scenario, path, free=["joint_1.damping"], duration=1.0)
    assert error.value.problems[0].key == "limits.joint_1.motor_1_torque"
    assert "initial: equilibrium" in error.value.problems[0].hint
    assert design(scenario, path, free=["joint_1.damping"], duration=1.0, overrides=["initial=equilibrium"], **UNSEARCHED).keys


def test_the_chosen_gain_is_the_one_whose_own_design_predicts_the_best_intervals(limits):
    scenario = limits(
        f"robot: {EXAMPLES / 'urdf' / 'dof1_qbmove_cube.urdf'}\nduration: 1\nactuators: {{joint_1: {{type: sea, mode: 6}}}}\n"
        "initial: equilibrium\nparameters: {joint_1: {spring_stiffness: 8}}\n"
    )
    scenario = scenario.rename(scenario.with_name("lab.yaml"))

    def designed(*gains):
        text = "limits: {joint_1: {link_position: 1.2, deflection: 0.6}}\nnoise: {link_position: 0.001}\n"
        path = limits(f"{text}choose: {{joint_1.controller_1_proportional: {list(gains)}}}\n")
        return design(scenario, path, free=["joint_1.spring_stiffness"], duration=0.5, rounds=0)

    alone = {gain: designed(gain).intervals["design"] for gain in (5.0, 50.0)}
    chosen = designed(5.0, 50.0)
    assert chosen.gains == {"joint_1.controller_1_proportional": min(alone, key=alone.get)}
    assert chosen.intervals["design"] == min(alone.values())
    assert chosen.intervals["design"] < 0.5 * max(alone.values())


def test_what_cannot_be_written_is_refused_before_the_search(asrsim_command, monkeypatch, tmp_path):
    monkeypatch.setattr("asrsim.designs.run.design", lambda *given, **options: pytest.fail("searched"))
    (tmp_path / "file").write_text("mine")
    for out in ("file", "file/excite.csv"):
        done = asrsim_command("design", "a.yaml", "--limits", "l.yaml", "--out", out)
        assert done.code == 1
        assert "file" in done.err
