"""Recordings of kinds that laboratories have, from independent laws: benches, coarse encoders, unknown gains."""

import math
import re

import numpy as np
import pytest

from asrsim.errors import InputError
from asrsim.identification import identify
from asrsim.identification.noise import beyond_steps, lag_correlation
from asrsim.starter.recording import write_from_recording
from support.identify_files import BENCH, CHIRP, SEA, bench, record, save, write

ARM = """<robot name="rig"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.15"/><mass value="0.6"/>
<inertia ixx="0.001" iyy="0.002" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="50" velocity="20"/><dynamics damping="0.3" friction="0.03"/></joint></robot>"""


def table(folder, header, *columns):
    """Write a recording and the robot into a folder; return the path of the recording."""
    (folder / "rig.urdf").write_text(ARM)
    return save(folder / "a.csv", header, *columns)


@pytest.mark.slow
def test_a_spring_on_a_bench_has_its_hysteresis_identified(tmp_path):
    time = np.arange(0.0, 4.0, 0.005)
    angle = 0.1 * np.sin(math.pi * time)
    lag = np.zeros(len(time))
    for k in range(1, len(time)):
        # Dahl's law along each step, solved exactly.
        change = angle[k] - angle[k - 1]
        side = math.copysign(0.5, change)
        lag[k] = side + (lag[k - 1] - side) * math.exp(-abs(change) / 0.01)
    torque = 180.0 * angle + lag + 0.02 * np.random.default_rng(0).normal(size=len(time))
    recorded = table(tmp_path, "t [s],Angle_deg,Torque_Nm", time, np.degrees(angle), torque)
    with pytest.raises(InputError, match="springs on a bench"):
        write_from_recording(tmp_path / "rig.urdf", recorded, tmp_path / "no.yaml", actuators={"*": "sea"})
    maps = ["Angle_deg=elbow.motor_1_position [deg]", "Torque_Nm=elbow.elastic_torque_1"]
    write_from_recording(tmp_path / "rig.urdf", recorded, tmp_path / "lab.yaml", actuators={"*": "sea"}, mapping=maps)
    assert "engine: bench" in (tmp_path / "lab.yaml").read_text()
    assert not re.search(r"friction|damping|arm", (tmp_path / "lab.fit.yaml").read_text())
    without = identify(tmp_path / "lab.fit.yaml")
    assert any("hysteresis" in text and "--free elbow.hysteresis_deflection=" in text for text in without.causes), (
        without.causes
    )
    free = ["elbow.spring_stiffness", "elbow.hysteresis_torque=0.1", "elbow.hysteresis_deflection"]
    result = identify(tmp_path / "lab.yaml", [recorded], mapping=maps, free=free)
    assert result.fits
    for key, true in zip(("spring_stiffness", "hysteresis_torque", "hysteresis_deflection"), (180.0, 0.5, 0.01), strict=True):
        one = result.find(f"elbow.{key}")
        assert one.low < true < one.high
        assert one.margin < 0.1


def pendulum(rate, quantum):
    """Time, voltage and place of a pendulum under a motor's voltage, held between samples: 0.8 N m/V, 1.2 N m s/rad, 0.05 N m,
    0.01 kg m^2 about its centre of mass.
    """
    steps, inertia = round(20_000 / rate), 0.01 + 0.6 * 0.15**2
    time = np.arange(0.0, 8.0, 1.0 / rate)
    volts = 3.2 * np.sin(1.9 * time) + 1.6 * np.sin(6.9 * time + 1.0)
    places, q, v, step = [], 0.0, 0.0, 1.0 / (rate * steps)
    for volt in volts.tolist():
        places.append(q)
        for _ in range(steps):
            slid = v + step * (0.8 * volt - 1.2 * v - 0.6 * 9.81 * 0.15 * math.sin(q)) / inertia
            most = step * 0.05 / inertia
            v = 0.0 if abs(slid) < most else slid - math.copysign(most, slid)
            q += step * v
    return time, volts, quantum * np.floor(np.array(places) / quantum)


@pytest.mark.slow
def test_a_torque_driven_joint_with_a_coarse_encoder_is_simulated(tmp_path):
    recorded = table(tmp_path, "time,voltage,position", *pendulum(200.0, 2.0 * math.pi / 4096.0))
    (tmp_path / "lab.yaml").write_text("robot: rig.urdf\nduration: 8\nactuators: {elbow: {type: sea, mode: 0}}\n")
    maps = ["voltage=0.5*elbow.reference_1 [N m]", "position=elbow.link_position"]
    free = ["elbow.reference_1.gain", "elbow.damping", "elbow.friction", "arm.iyy"]
    result = identify(tmp_path / "lab.yaml", [recorded], mapping=maps, free=free)
    for key, true, near in (("elbow.reference_1.gain", 1.6, 0.005), ("elbow.damping", 1.2, 0.005), ("arm.iyy", 0.01, 0.05)):
        assert result.find(key).value == pytest.approx(true, rel=near)
    # The encoder rounds down: an offset of half a step, and the correlation of quantisation, are no faults of the model.
    assert result.fits, result.misfit


@pytest.mark.slow
@pytest.mark.parametrize("ringing", [0.0, 0.1])
def test_a_free_swing_tells_its_losses_and_a_mode_that_is_missing(tmp_path, ringing):
    """The clock starts at 0.3 s, in the motion. 0.02 N m s/rad, 0.01 N m, 0.01 kg m^2 about the centre of mass; in one case an
    oscillation of 7 Hz is added.
    """
    places, q, v, step, inertia = [], 1.2, 0.0, 1e-4, 0.01 + 0.6 * 0.15**2
    for _ in range(50_000):
        places.append(q)
        v += step * (-0.02 * v - 0.01 * math.copysign(1.0, v) - 0.6 * 9.81 * 0.15 * math.sin(q)) / inertia
        q += step * v
    time = 0.3 + np.arange(470) * 0.01
    shown = np.array(places)[3000::100] + ringing * np.sin(14.0 * math.pi * time)
    recorded = table(tmp_path, "t [s],q1 [rad]", time, shown + 1e-3 * np.random.default_rng(0).normal(size=len(time)))
    write_from_recording(tmp_path / "rig.urdf", recorded, tmp_path / "lab.yaml")
    result = identify(tmp_path / "lab.fit.yaml")
    assert result.fits == (not ringing)
    assert any("an oscillation of 7" in text for text in result.causes) == bool(ringing)
    if not ringing:
        for key, true in (("damping", 0.02), ("friction", 0.01)):
            one = result.find(f"elbow.{key}")
            assert one.low < true < one.high
            assert one.margin < 0.1


@pytest.mark.parametrize("phase", [0.0, 0.3, 0.5])
def test_steps_and_a_zero_within_one_are_no_faults(phase):
    motion = np.sin(np.arange(0.0, 12.0, 0.004))
    recorded = 0.01 * np.floor(motion / 0.01 + phase)
    beyond, borne = beyond_steps(motion - recorded, recorded, 0.01)
    assert np.sqrt(np.mean(beyond**2)) < 1.1 * 0.01 / math.sqrt(12.0)
    assert abs(lag_correlation(beyond) - borne) < 0.1
    # An error of the model beyond quantisation is still found.
    beyond, borne = beyond_steps(1.02 * motion - recorded, recorded, 0.01)
    assert lag_correlation(beyond) - borne > 0.3


def test_spring_over_inertia_about_the_joint_is_identifiable(tmp_path):
    """All pairs of stiffness and inertia with equal k / (izz + m r^2) give the same motion."""

    def arm(name, numbers, references=None):
        scenario = write(tmp_path, name, numbers, references)
        robot = tmp_path / f"{name}.urdf"
        robot.write_text(robot.read_text().replace("<inertial>", '<inertial><origin xyz="0.06 0 0"/>'))
        return scenario

    recording = record(arm("true", SEA, f"{{equilibrium_position: {CHIRP}}}"), tmp_path / "a.csv")
    guess = arm("guess", {**SEA, "izz": 0.012, "damping": 0.03, "tags": "<spring_k>5</spring_k>"})
    found = identify(guess, [recording], free=["joint_1.spring_stiffness", "joint_1.damping", "link_1.izz"])
    assert [one.verdict for one in found.estimates] == ["only as ratio"] * 3
    assert all(math.isnan(one.low) for one in found.estimates)
    one, other = found.combinations
    assert one.text == "joint_1.spring_stiffness / (link_1.izz + 0.0018 kg m^2, the inertia about the joint)"
    about = 0.009 + 0.5 * 0.06**2
    assert one.value == pytest.approx(4.0 / about, rel=2.0 * one.margin)
    assert one.margin < 0.002
    assert other.value == pytest.approx(0.02 / about, rel=2.0 * other.margin)


def test_trials_with_a_moving_zero_of_the_spring_are_reported(tmp_path):
    generator, time, trials = np.random.default_rng(0), np.arange(0.0, 4.0, 0.01), []
    for number in range(5):
        place = (0.05 + 0.02 * number) * np.sin(2.0 * np.pi * (0.5 + 0.1 * number) * time)
        torque = 4.0 * place + generator.normal(scale=0.1) + 2e-3 * generator.normal(size=len(time))
        trials.append(save(tmp_path / f"{number}.csv", BENCH, time, place, torque))
    lab = bench(tmp_path, 3)
    shared = identify(lab, trials, free=["joint_1.spring_stiffness"])
    assert not shared.fits
    zeros = [text for text in shared.causes if text.startswith("a zero offset of joint_1.elastic_torque_1 in each recording")]
    assert any("--own joint_1.elastic_torque_1.offset" in text for text in zeros), shared.causes
    own = identify(lab, trials, free=["joint_1.spring_stiffness"], own=["joint_1.elastic_torque_1.offset"])
    assert own.fits, own.misfit
    assert own.find("joint_1.spring_stiffness").value == pytest.approx(4.0, rel=1e-3)


def test_a_gear_between_motor_and_its_encoder_is_suspected(tmp_path):
    numbers = {**SEA, "mode": 6}
    recording = record(
        write(tmp_path, "true", numbers, f"{{equilibrium_position: {CHIRP}}}"),
        tmp_path / "a.csv",
        ("link_position", "motor_1_position"),
    )
    header, *columns, motor = recording.read_text().partition("\n")[0], *np.loadtxt(recording, delimiter=",", skiprows=1).T
    save(recording, header, *columns, 20.0 * motor)
    result = identify(write(tmp_path, "lab", numbers), [recording], free=["joint_1.damping"])
    (cause,) = result.causes
    (gain,) = re.findall(r"a different scale and zero offset of joint_1.motor_1_position \((.*?)\)", cause)
    assert float(gain) == pytest.approx(0.05, rel=1e-2)
