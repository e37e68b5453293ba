"""Coverage of 95 % intervals, on recordings from an independent integrator."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter, lsim

from asrsim import identify
from asrsim.identification.result import Estimate, doubted
from support import exact_swing
from support.identify_files import SEA as ROTARY
from support.identify_files import save, write
from support.soft_arm import FINE, QBMOVE, SEA, command, record

RECORDINGS = {
    "white": {},
    "coloured": {"memory": 0.02},
    "sampled at 100 Hz": {"every": 10},
    "from encoders": {"noise": 2e-4, "quantum": 1.5e-3},
}
"""Options of `record` by kind of recording."""
SEEDS = 8


@pytest.mark.parametrize("joint", [QBMOVE, SEA], ids=["qbmove", "sea"])
def test_the_independent_integrator_is_exact_within_the_noise(joint):
    time = 1e-3 * np.arange(1001)
    fine, finer = (joint.move(time, lambda at: command(at, 1.0), step=step) for step in (FINE, 0.125 * FINE))
    assert np.sqrt(np.mean((fine - finer) ** 2)) < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("kind", RECORDINGS)
def test_intervals_hold_the_truth_in_90_to_98_percent(tmp_path, kind):
    """Fits of a qbMove and of a pendulum on an SEA, each with parameters that differ from the guess."""
    held = {True: [], False: []}
    for nominal in (QBMOVE, SEA):
        for seed in range(SEEDS):
            generator = np.random.default_rng(seed)
            true = nominal.scaled(lambda _, draw=generator: math.exp(draw.uniform(-0.25, 0.25)))
            recording = record(true, tmp_path / "a.csv", seed=seed, **RECORDINGS[kind])
            result = identify(nominal.write(tmp_path), [recording], free=list(true.keys), ties=true.ties)
            for key, value in true.keys.items():
                one = result.find(key)
                held["friction" in key].append(one.low <= value <= one.high)
    # At a probability of 95 % each, 90 to 98 % of 120 intervals contain the truth, and at least 27 of 32 of friction.
    everything = np.mean(held[True] + held[False])
    assert 0.90 <= everything <= 0.985
    assert np.mean(held[True]) >= 0.84


@pytest.mark.slow
def test_models_with_jumps_of_commands_up_to_a_sample_late_fit_and_their_intervals_hold(tmp_path):
    """Exact swings with six jumps each. An instant at its bound has no interval and counts as a miss."""
    held = []
    for rate in (100.0, 500.0):
        for seed in range(20):
            lab, recording, early = exact_swing.swing(tmp_path, seed, rate)
            found = identify(lab, [recording], free=["joint_1.spring_stiffness", "joint_1.damping"])
            assert found.fits, (rate, seed, found.misfit)
            truth = {"joint_1.spring_stiffness": exact_swing.STIFFNESS, "joint_1.damping": exact_swing.DAMPING}
            truth |= {f"jump_{n}": value for n, value in enumerate(early, start=1)}
            held += [found.find(key).low <= value <= found.find(key).high for key, value in truth.items()]
    assert 0.90 <= np.mean(held) <= 0.98


@pytest.mark.slow
def test_springs_that_differ_by_15_percent_are_never_called_equal(tmp_path):
    for seed in range(4):
        (numbers,) = QBMOVE.joints
        true = replace(QBMOVE, joints=({**numbers, "spring_k_2": 1.15 * numbers["spring_k_1"]},))
        recording = record(true, tmp_path / "a.csv", seed=seed, noise=3e-3)
        guess = QBMOVE.write(tmp_path)
        result = identify(guess, [recording], free=list(QBMOVE.keys), ties=QBMOVE.ties)
        assert not result.fits
        assert any("spring_k_2" in text for text in (*result.misfit, *result.causes)), result.misfit
        # A tie of equal springs is not reported.
        recording = record(QBMOVE, tmp_path / "a.csv", seed=seed, noise=3e-3)
        result = identify(guess, [recording], free=list(QBMOVE.keys), ties=QBMOVE.ties)
        assert not any("is tied" in text for text in (*result.misfit, *result.causes)), result.misfit


@pytest.mark.slow
def test_a_model_that_does_not_fit_identifies_nothing(tmp_path):
    """A joint with five times the friction of the model, of which only the spring is free. Its interval contains the estimate
    with the suspected friction.
    """
    true = SEA.scaled(lambda name: 5.0 if name == "friction" else 1.0)
    recording = record(true, tmp_path / "a.csv", seed=0)
    result = identify(SEA.write(tmp_path), [recording], free=["joint_1.spring_stiffness"])
    assert result.fits is False
    (one,) = result.estimates
    assert one.verdict == "weak"
    assert one.low < SEA.keys[one.key] < one.high


INERTIA = Estimate(
    key="link_1.izz", name="link_1.izz", unit="", start=1.0, value=10.8, low=10.7, high=10.9, verdict="identified"
)
STIFFNESS = replace(INERTIA, key="joint_1.spring_stiffness", name="joint_1.spring_stiffness", value=1.5)


@pytest.mark.parametrize(
    ("one", "fits", "otherwise", "reason"),
    [
        (STIFFNESS, False, {}, "the model is not shown to fit"),
        (STIFFNESS, True, {}, ""),
        (STIFFNESS, False, {"joint_1.spring_stiffness": 1.6}, "models that explain the recording better estimate 1.6$"),
        (STIFFNESS, False, {"joint_1.spring_stiffness": 1.55}, "the model is not shown to fit"),
        (replace(STIFFNESS, value=0.2), True, {}, ""),
        (INERTIA, True, {}, r"it is 10.8 times its start value; if this is plausible, start there \(--free link_1.izz=10.8\)"),
        (replace(INERTIA, start=10.0), True, {}, ""),
    ],
)
def test_doubtful_estimates_are_weak_and_say_why(one, fits, otherwise, reason):
    (found,) = doubted([one], fits=fits, others=[otherwise])
    assert found.verdict == ("weak" if reason else "identified")
    assert re.match(reason, found.reason)
    assert found.high >= otherwise.get(one.name, one.high)


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 0.02])
def test_intervals_hold_an_initial_state_that_differs_from_the_scenario(tmp_path, memory):
    """A linear joint that starts at 0.25 rad and 5 rad/s instead of 0; exact motion with white noise, or noise correlated over
    20 ms.
    """
    truth = {"spring_stiffness": 4.0, "damping": 0.02, "initial_position": 0.25, "initial_velocity": 5.0}
    stiffness, damping, inertia, fine = 4.0, 0.02, 0.009, np.arange(0.0, 2.00005, 1e-4)
    goal = 0.3 * np.sin(2.0 * np.pi * 1.1 * fine) + 0.15 * np.sin(2.0 * np.pi * 2.7 * fine)
    matrix = [[0.0, 1.0], [-stiffness / inertia, -damping / inertia]]
    system = (matrix, [[0.0], [stiffness / inertia]], [[1.0, 0.0]], [[0.0]])
    moved = lsim(system, goal, fine, [truth["initial_position"], truth["initial_velocity"]])[1][::10]
    guess = write(tmp_path, "guess", {**ROTARY, "damping": 0.03, "tags": "<spring_k>3.0</spring_k>"})
    held, keep = [], math.exp(-1e-3 / memory) if memory else 0.0
    for seed in range(12):
        white = np.random.default_rng(seed).normal(size=len(moved) + 500)
        noise = 1e-3 * math.sqrt(1.0 - keep**2) * lfilter([1.0], [1.0, -keep], white)[500:]
        header = "time [s],joint_1.reference_1 [rad],joint_1.link_position [rad]"
        recording = save(tmp_path / "a.csv", header, fine[::10], goal[::10], moved + noise)
        result = identify(guess, [recording], free=["joint_1.spring_stiffness", "joint_1.damping"])
        found = [result.find(f"joint_1.{name}") for name in truth]
        held += [one.low <= value <= one.high for one, value in zip(found, truth.values(), strict=True)]
    assert np.mean(held) >= 0.9


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "noise"), [(0.0, 3e-3), (1.0, 3e-4)])
def test_intervals_hold_with_a_noisy_motor_in_a_torque_mode(tmp_path, speed, noise):
    """A motor and a link that a spring joins start together, at rest or in motion, and nothing returns the motor; `init` has
    copied their first samples. The motor's sensor is as noisy as the link's, or ten times as noisy. Exact motion.
    """
    stiffness, rotor, drag, inertia, damping = truth = 4.0, 0.02, 0.05, 0.009, 0.02
    names = "joint_1.spring_stiffness", "joint_1.motor_1_inertia", "joint_1.motor_1_damping", "link_1.izz", "joint_1.damping"
    fine = np.arange(0.0, 2.00005, 1e-4)
    torque = 0.6 * np.sin(2.0 * np.pi * 1.1 * fine) + 0.4 * np.sin(2.0 * np.pi * 3.7 * fine + 0.5)
    link = [-stiffness / inertia, -damping / inertia, stiffness / inertia, 0.0]
    motor = [stiffness / rotor, 0.0, -stiffness / rotor, -drag / rotor]
    matrix, seen = [[0.0, 1.0, 0.0, 0.0], link, [0.0, 0.0, 0.0, 1.0], motor], np.eye(4)[[0, 2]]
    system = (matrix, [[0.0], [0.0], [0.0], [1.0 / rotor]], seen, np.zeros((2, 1)))
    moved = lsim(system, torque, fine, [0.2, speed, 0.2, speed])[1][::10]
    scenario = write(tmp_path, "guess", {**ROTARY, "mode": 4, "damping": 0.03, "tags": "<spring_k>3.3</spring_k>"})
    text = scenario.read_text()
    known = "motor_1_friction_torque: 0, motor_1_max_torque: 1000, motor_1_max_velocity: 1000, max_deflection: 10"
    text += f"parameters: {{joint_1: {{motor_1_inertia: 0.025, motor_1_damping: 0.04, {known}}}}}\n"
    header = "time [s],joint_1.reference_1 [N m],joint_1.link_position [rad],joint_1.motor_1_position [rad]"
    held = []
    for seed in range(20):
        shown = moved + np.random.default_rng(seed).normal(size=moved.shape) * (noise, 3e-3)
        start = f"position: {shown[0, 0]:.8f}, motor_positions: [{shown[0, 1]:.8f}]"
        scenario.write_text(f"{text}initial: {{joint_1: {{{start}}}}}\n")
        recording = save(tmp_path / "a.csv", header, fine[::10], torque[::10], *shown.T)
        result = identify(scenario, [recording], free=names)
        assert result.fits, (seed, result.misfit)
        found = [result.find(name) for name in names]
        assert {one.verdict for one in found} == {"identified"}
        held += [one.low <= value <= one.high for one, value in zip(found, truth, strict=True)]
    assert np.mean(held) >= 0.9
