"""Torque-driven joints, differences between recordings, and bounds of parameters."""

from dataclasses import replace

import numpy as np
import pytest

from asrsim.errors import InputError
from asrsim.identification import identify, task_of
from asrsim.identification.data import computed_columns, read_data
from asrsim.identification.problem import solve
from asrsim.identification.uncertainty import Uncertainty, uncertainty
from asrsim.identification.write import write_robot
from asrsim.recordings.data import Column
from asrsim.robot import load_robot
from asrsim.scenario import load_scenario
from asrsim.simulation.prepare import prepare
from support import soft_arm
from support.identify_files import CHIRP, SEA, modelled, record, save, write

SWEEP = np.arange(0.0, 2.0005, 1e-3)
"""s."""
INERTIA = 0.009
LAWS = {
    "friction": {"friction": 0.06, "damping": 0.05},
    "stribeck": {"friction": 0.03, "stribeck_friction": 0.05, "stribeck_velocity": 0.8},
    "load": {"friction": 0.02, "load_friction": 0.25},
    "sensor": {"reference_1.gain": 0.8, "reference_1.offset": 0.03},
    "late": {"friction": 0.04, "reference_1.delay": 0.02},
    "pushed": {"damping": 0.02},
    "rotor": {"armature": 0.006},
}
"""True parameters of each case: losses and rotor of the link, errors of the torque sensor, or an external torque."""


@pytest.mark.parametrize("law", LAWS)
def test_a_torque_driven_joint_has_the_parameters_of_its_recording(law, tmp_path):
    """A link whose torque follows from its motion in closed form; the fit starts with half of each parameter."""
    numbers = dict.fromkeys(
        ("damping", "friction", "load_friction", "stribeck_friction", "armature", "reference_1.offset"), 0.0
    )
    numbers |= {"stribeck_velocity": 1.0, "reference_1.gain": 1.0} | LAWS[law]
    moments = SWEEP + numbers.pop("reference_1.delay", 0.0)
    phase = 2.0 * np.pi * (0.6 + 0.3 * moments) * moments
    rate, bend = 2.0 * np.pi * (0.6 + 0.6 * moments), 2.0 * np.pi * 0.6
    v = -0.5 * rate * np.sin(phase)
    a = -0.5 * (rate**2 * np.cos(phase) + bend * np.sin(phase))
    pushed = 0.1 * np.sin(5.0 * moments) if law == "pushed" else 0.0 * moments
    rest = (INERTIA + numbers["armature"]) * a + numbers["damping"] * v - pushed
    level = numbers["friction"] + numbers["stribeck_friction"] * np.exp(-((v / numbers["stribeck_velocity"]) ** 2))
    torque = rest
    for _ in range(60):
        torque = rest + (level + numbers["load_friction"] * np.abs(torque)) * np.sign(v)
    recorded = torque / numbers["reference_1.gain"] + numbers["reference_1.offset"]
    # Noise, since a fit searches for missing effects where an exact recording shows the error of the time step.
    noise = 2e-4 * np.random.default_rng(0).normal(size=len(SWEEP))
    place = 0.5 * np.cos(2.0 * np.pi * (0.6 + 0.3 * SWEEP) * SWEEP) + noise
    columns = {"time [s]": SWEEP, "joint_1.reference_1 [N m]": recorded, "joint_1.link_position [rad]": place}
    if law == "pushed":
        columns["joint_1.external_torque [N m]"] = pushed
    free = [f"joint_1.{name}" + (f"={0.5 * value}" if value > 0.0 else "") for name, value in LAWS[law].items()]
    table = save(tmp_path / "a.csv", ",".join(columns), *columns.values())
    scenario = write(tmp_path, "lab", {**SEA, "mode": 0, "damping": 0.0}, duration=2.0)
    result = identify(scenario, [table], free=free)
    for key, value in LAWS[law].items():
        assert result.find(f"joint_1.{key}").value == pytest.approx(value, rel=0.02), law
    if law == "rotor":
        (tmp_path / "fit").mkdir()
        for own in ({}, {"*": 0.001}):  # the robot's file states it, unless the scenario does
            stated = replace(result, scenario=replace(result.scenario, armature=own))
            (path, written), _ = write_robot(stated, tmp_path / "fit")
            found = prepare(load_scenario(written)[0]).robot.joint("joint_1").armature
            assert found == pytest.approx(result.find("joint_1.armature").value, rel=1e-8)
            assert ("armature" in path.read_text()) == (not own)


def test_recordings_that_differ_more_than_their_blocks_widen_the_intervals():
    """Gradients of three recordings of four blocks each; all blocks of a recording have one sign."""
    nothing = np.empty(0)
    known = Uncertainty(
        inverse=nothing, deviation=nothing, jacobian=nothing, quantile=nothing, noise=np.eye(1),
        freedom=1e9, at_bound=np.zeros(1, bool), scores=np.repeat([1.0, -2.0, 1.0], 4)[:, None], firsts=np.array([0, 4, 8]),
    )  # fmt: skip
    assert known.deviations(np.eye(1))[0] == pytest.approx(np.sqrt(16.0 * 6.0 * 1.5))
    # Two blocks do not show a spread.
    few = replace(known, scores=100.0 * known.scores[:2], firsts=np.zeros(1, np.intp))
    assert few.deviations(np.eye(1))[0] == pytest.approx(1.0)


def test_each_recording_has_blocks_of_its_own():
    """Two recordings whose gradients are opposite in each tenth, so that only tenths of the same recording disagree."""
    signs = np.random.default_rng(0).choice([-1.0, 1.0], 400)
    apart = 0.4 * np.repeat(np.tile([1.0, -1.0], 5), 40)
    first, second = (modelled(lambda x, way=way: signs * (x[0] + way * apart), 1, 400) for way in (1.0, -1.0))  # type: ignore[misc]
    both = replace(
        first, tracks=first.tracks + second.tracks, weights=first.weights + second.weights, ends=first.ends + second.ends
    )
    found = uncertainty(both, np.zeros(1))
    # Twenty blocks of 40 samples give estimates of 0.4 or -0.4, whose mean has this deviation.
    assert found.deviation[0] == pytest.approx(0.4 / np.sqrt(20 - 1), rel=1e-3)
    assert list(found.firsts) == [0, 10]
    # A later recording of half the length has ten blocks, too.
    assert np.bincount(replace(both, ends=(1.0, 0.5)).blocks(10)).tolist() == [40] * 10 + [20] * 10


def test_estimates_beyond_a_bound_stay_at_the_bound(tmp_path):
    """The true damping is below its lower bound, the true stiffness above its upper bound."""
    recording = record(write(tmp_path, "true", SEA, f"{{equilibrium_position: {CHIRP}}}"), tmp_path / "a.csv")
    guess = write(tmp_path, "guess", {**SEA, "damping": 0.06})
    free = {
        "joint_1.damping": {"start": 0.06, "low": 0.04, "high": 0.1},
        "joint_1.spring_stiffness": {"start": 3.3, "low": 3.0, "high": 3.6},
    }
    result = identify(task_of(guess, [recording], free=free))
    assert [(one.verdict, one.value) for one in result.estimates] == [("at bound", 0.04), ("at bound", 3.6)]
    assert result.estimates[1].reason == "3.6 N m/rad is its bound"
    assert not result.fits
    wrong = {"joint_1.damping": {"least": 1}, "joint_1.friction": "much", "link_1.mass": 2.0}
    with pytest.raises(InputError) as caught:
        task_of(guess, [recording], free=wrong)
    assert [problem.key for problem in caught.value.problems] == ["free.joint_1.damping.least", "free.joint_1.friction.start"]


def test_a_parameter_without_effect_does_not_disturb_the_search():
    """Rosenbrock's valley: every stage of the search is the same with and without a further parameter."""

    def valley(x):
        return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0], 0.0, 0.0])

    start = np.array([-1.2, 1.0, 0.0])
    for rounds in (5, 10, 20, 40):
        without, beside = (solve(modelled(valley, count, 4), start[:count], rounds=rounds) for count in (2, 3))
        assert beside == pytest.approx([*without, 0.0], abs=1e-6)


def test_a_torque_computed_from_a_deflection_is_no_measurement():
    """A position that was converted from counts is measured."""
    time, generator = np.arange(0.0, 1.0, 0.01), np.random.default_rng(0)
    angle, deflection = generator.normal(size=(2, 100))
    names = {"counts": (651.9 * angle, None), "q": (angle, "link_position"), "phi": (deflection, None)}
    columns = [
        Column(time=time, values=values, unit="", joint="j", quantity=quantity, source=name, conversion="")
        for name, (values, quantity) in {**names, "tau": (-80.0 * deflection, "elastic_torque_1")}.items()
    ]
    assert computed_columns(columns, {"q", "tau"}) == {"tau": "phi"}


def test_a_fit_lasts_until_the_end_of_the_longest_channel(tmp_path):
    """The position of the motor was recorded for half of the time."""
    scenario, path = soft_arm.SEA.write(tmp_path), soft_arm.record(soft_arm.SEA, tmp_path / "lab.csv", seed=0, duration=1.0)
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:500] + [f"{line.rpartition(',')[0]}," for line in lines[500:]]) + "\n")
    (loaded,) = load_scenario(scenario)
    task = task_of(scenario, experiments=[path], free=["joint_1.damping"])
    (data,) = read_data(task, loaded, load_robot(loaded.robot))
    assert data.duration == pytest.approx(1.0)
    assert sorted(round(float(channel.time[-1]), 1) for channel in data.channels) == [0.5, 1.0]


def test_an_unknown_push_does_not_spoil_a_torque_driven_joint(tmp_path):
    """A link under a recorded torque, in closed form; for half a second another torque of 0.05 N m acts, which is not recorded.
    A free simulation drifts away, and short predictions that restart at measured positions do not.
    """
    phase, rate = 2.0 * np.pi * (0.6 + 0.3 * SWEEP) * SWEEP, 2.0 * np.pi * (0.6 + 0.6 * SWEEP)
    place = 0.5 * np.cos(phase)
    v = -0.5 * rate * np.sin(phase)
    a = -0.5 * (rate**2 * np.cos(phase) + 2.0 * np.pi * 0.6 * np.sin(phase))
    push = 0.05 * ((SWEEP > 1.0) & (SWEEP < 1.5))
    noise = 2e-4 * np.random.default_rng(0).normal(size=len(SWEEP))
    table = save(
        tmp_path / "a.csv",
        "time [s],joint_1.reference_1 [N m],joint_1.link_position [rad]",
        SWEEP,
        INERTIA * a + 0.05 * v - push,
        place + noise,
    )
    result = identify(
        write(tmp_path, "lab", {**SEA, "mode": 0, "damping": 0.5}), [table], free=["joint_1.damping", "link_1.izz"]
    )
    assert result.bandwidth > 0.0
    assert result.fits is False
    assert any("errors of the model accumulate" in text for text in result.misfit)
    for key, truth in (("joint_1.damping", 0.05), ("link_1.izz", INERTIA)):
        one = result.find(key)
        assert one.value == pytest.approx(truth, rel=0.1)
        assert one.low < truth < one.high
        assert one.verdict == "weak"
