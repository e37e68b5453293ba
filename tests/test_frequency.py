"""Frequency responses against the analytic response of the linear two-mass actuator, motor - spring - link."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import StateSpace, butter, chirp, lsim, sosfilt

from asrsim.errors import RecordingError
from asrsim.metrics.frequency import FrequencyResponse, frequency_response

MOTOR_INERTIA, MOTOR_DAMPING, SPRING, LINK_INERTIA, LINK_DAMPING, LOOP = 0.01, 0.05, 4.0, 0.004, 0.01, 6.0
"""kg m^2, N m s/rad, N m/rad, kg m^2, N m s/rad; proportional gain of the motor's position loop, N m/rad."""
STEP = 1e-3
TIME = np.arange(0, 20, STEP)


def analytic(frequency: np.ndarray) -> np.ndarray:
    """Link position over motor reference."""
    s = 2j * np.pi * frequency
    motor = MOTOR_INERTIA * s**2 + MOTOR_DAMPING * s + SPRING + LOOP
    link = LINK_INERTIA * s**2 + LINK_DAMPING * s + SPRING
    return LOOP * SPRING / (motor * link - SPRING**2)


def simulate(u: np.ndarray, time: np.ndarray = TIME) -> np.ndarray:
    a = np.array([
        [0, 1, 0, 0],
        [-(SPRING + LOOP) / MOTOR_INERTIA, -MOTOR_DAMPING / MOTOR_INERTIA, SPRING / MOTOR_INERTIA, 0],
        [0, 0, 0, 1],
        [SPRING / LINK_INERTIA, 0, -SPRING / LINK_INERTIA, -LINK_DAMPING / LINK_INERTIA],
    ])  # fmt: skip
    b = np.array([[0], [LOOP / MOTOR_INERTIA], [0], [0]])
    _, y, _ = lsim(StateSpace(a, b, np.array([[0.0, 0, 1, 0]]), np.zeros((1, 1))), u, time)
    return np.asarray(y)


def excitation(kind: str) -> np.ndarray:
    rng = np.random.default_rng(5)
    if kind == "chirp":
        return 0.15 * chirp(TIME, 0.5, 20, 6)
    if kind == "chirp sine":
        return 0.15 * chirp(TIME, 0.5, 20, 6, phi=-90)
    if kind == "wide chirp":
        return 0.15 * chirp(TIME, 0.5, 20, 15)
    if kind == "logarithmic chirp":
        return 0.15 * chirp(TIME, 0.5, 20, 12, method="logarithmic")
    if kind == "multisine":
        return sum(0.05 * np.sin(2 * np.pi * f * TIME + rng.uniform(0, 6)) for f in np.arange(0.5, 10.1, 0.5))
    if kind == "dense multisine":
        return sum(0.05 * np.sin(2 * np.pi * f * TIME + rng.uniform(0, 6)) for f in np.arange(0.5, 10.1, 0.1))
    return sosfilt(butter(4, 10, fs=1 / STEP, output="sos"), rng.standard_normal(len(TIME)))


KINDS = ["chirp", "chirp sine", "wide chirp", "logarithmic chirp", "multisine", "dense multisine", "noise"]


def errors(found: FrequencyResponse) -> tuple[np.ndarray, np.ndarray]:
    """Relative error of the gain and error of the phase in degrees, where the coherence is above 0.95."""
    truth = analytic(found.frequency)
    good = found.coherence > 0.95
    measured = found.gain * np.exp(1j * np.radians(found.phase))
    return np.abs(found.gain / np.abs(truth) - 1)[good], np.abs(np.degrees(np.angle(measured / truth)))[good]


@pytest.mark.parametrize("kind", KINDS)
def test_gain_and_phase_are_the_analytic_ones(kind: str) -> None:
    u = excitation(kind)
    found = frequency_response(TIME, u, simulate(u))
    gain, phase = errors(found)
    assert np.mean(found.coherence > 0.95) > 0.95
    assert np.max(gain) < 0.015
    assert np.max(phase) < 1.0
    inner = (found.frequency > 0.7) & (found.frequency < 5.5)
    truth = analytic(found.frequency[inner])
    assert np.max(np.abs(found.gain[inner] * np.exp(1j * np.radians(found.phase[inner])) / truth - 1)) < 0.003


@pytest.mark.parametrize("kind", KINDS)
def test_with_noise_the_bands_hold_the_truth(kind: str) -> None:
    u = excitation(kind)
    rng = np.random.default_rng(11)
    clean = simulate(u)
    found = frequency_response(TIME, u, clean + 0.05 * np.std(clean) * rng.standard_normal(len(TIME)))
    gain, phase = errors(found)
    assert np.median(gain) < 0.01
    assert np.median(phase) < 1.0
    truth = np.abs(analytic(found.frequency))
    # 95 % each, but neighbours share bins: some slack.
    assert np.mean((found.gain_low <= truth) & (truth <= found.gain_high)) > 0.75


@pytest.mark.parametrize("kind", ["chirp", "dense multisine", "noise"])
def test_resonance_and_bandwidth(kind: str) -> None:
    u = excitation(kind)
    found = frequency_response(TIME, u, simulate(u))
    grid = np.linspace(0.5, 10, 100_000)
    gain = np.abs(analytic(grid))
    assert found.resonance is not None
    assert found.resonance[0] == pytest.approx(grid[np.argmax(gain)], rel=0.005)
    assert found.resonance[1] == pytest.approx(gain.max(), rel=0.01)
    if kind != "chirp":  # whose band ends at 6 Hz
        assert found.bandwidth == pytest.approx(grid[np.argmax(gain < gain[0] / np.sqrt(2))], rel=0.02)
    else:
        assert found.bandwidth is None


def test_only_the_excited_band_is_reported() -> None:
    u = excitation("chirp sine")
    found = frequency_response(TIME, u, simulate(u))
    assert found.frequency[0] < 0.7
    assert 5.7 < found.frequency[-1] < 6.5  # not 500, to which the record is sampled
    narrow = frequency_response(TIME, u, simulate(u), band=(1.0, 2.0))
    assert narrow.frequency[0] >= 1.0
    assert narrow.frequency[-1] <= 2.0
    assert np.isnan(found.at(np.array([40.0]))).all()
    assert np.abs(found.at(np.array([1.0])) / analytic(np.array([1.0])) - 1) < 0.01


def test_the_phase_is_unwrapped() -> None:
    u = excitation("wide chirp")
    found = frequency_response(TIME, u, simulate(u))
    assert np.max(np.abs(np.diff(found.phase))) < 60
    assert found.phase[-1] < -250  # past both resonances: towards -360


def test_estimators_agree_on_lines() -> None:
    u = excitation("multisine")
    found = frequency_response(TIME, u, simulate(u))
    assert found.method == "welch"
    np.testing.assert_allclose(found.frequency, np.arange(0.5, 10.1, 0.5), atol=0.01)


def test_unrelated_noise_has_no_coherence_and_wide_bands() -> None:
    rng = np.random.default_rng(2)
    found = frequency_response(TIME, rng.standard_normal(len(TIME)), rng.standard_normal(len(TIME)))
    assert np.median(found.coherence) < 0.1
    assert np.median(found.gain_low) == 0.0
    assert "low-coherence" in [finding.code for finding in found.findings]


def test_jittered_and_gapped_records_are_brought_to_an_even_step() -> None:
    rng = np.random.default_rng(4)
    u = excitation("chirp")
    y = simulate(u)
    ticks = np.sort(np.arange(0, 20, 0.004) + rng.uniform(-0.001, 0.001, 5000))
    ticks = ticks[(ticks > 0) & (ticks < 19.99) & ~((ticks > 0.5) & (ticks < 0.8))]
    found = frequency_response(ticks, np.interp(ticks, TIME, u), np.interp(ticks, TIME, y))
    assert {finding.code for finding in found.findings} == {"gaps", "jitter"}
    inner = (found.frequency > 1.0) & (found.frequency < 5.5)
    truth = np.abs(analytic(found.frequency))
    assert np.max(np.abs(found.gain / truth - 1)[inner]) < 0.02


def test_an_output_that_does_not_move_is_said() -> None:
    u = excitation("chirp")
    held = frequency_response(TIME, u, 1e-9 * simulate(u) + 0.3)
    assert not held.moves
    assert held.resonance is None
    assert "does not move" in held.findings[-1].message
    assert frequency_response(TIME, u, np.zeros_like(u)).moves is False


@pytest.mark.parametrize(
    ("u", "code"),
    [(np.ones(len(TIME)), "constant-excitation"), (np.full(len(TIME), np.nan), "no-overlap")],
)
def test_unusable_excitations(u: np.ndarray, code: str) -> None:
    with pytest.raises(RecordingError) as error:
        frequency_response(TIME, u, np.sin(TIME))
    assert error.value.problems[0].code == code


def test_too_short_and_unresolved() -> None:
    with pytest.raises(RecordingError, match="too few"):
        frequency_response(TIME[:20], TIME[:20], TIME[:20])
    u = excitation("chirp")
    with pytest.raises(RecordingError, match="nothing is resolved"):
        frequency_response(TIME, u, u, band=(2000.0, 3000.0))
    with pytest.raises(RecordingError, match="no method"):
        frequency_response(TIME, u, u, method="magic")
