"""Frequency responses against the analytic response of the linear two-mass actuator, motor - spring - link."""

import numpy as np
import pytest
from scipy.signal import butter, chirp, cont2discrete, sosfilt, ss2zpk, zpk2sos
from scipy.stats import binom

from asrsim.errors import RecordingError
from asrsim.metrics.excitation import excited_band
from asrsim.metrics.frequency import frequency_response

MOTOR_INERTIA, MOTOR_DAMPING, SPRING, LINK_INERTIA, LINK_DAMPING, LOOP = 0.01, 0.05, 4.0, 0.004, 0.01, 6.0
"""kg m^2, N m s/rad, N m/rad, kg m^2, N m s/rad; proportional gain of the motor's position loop, N m/rad."""
STEP = 1e-3
TIME = np.arange(0, 20, STEP)


def analytic(frequency):
    """Link position over motor reference, whose samples are joined by straight lines: hence sinc^2, 3e-4 at 10 Hz."""
    s = 2j * np.pi * frequency
    motor = MOTOR_INERTIA * s**2 + MOTOR_DAMPING * s + SPRING + LOOP
    link = LINK_INERTIA * s**2 + LINK_DAMPING * s + SPRING
    return LOOP * SPRING / (motor * link - SPRING**2) * np.sinc(frequency * STEP) ** 2


def simulate(u):
    a = np.array(
        [
            [0, 1, 0, 0],
            [-(SPRING + LOOP) / MOTOR_INERTIA, -MOTOR_DAMPING / MOTOR_INERTIA, SPRING / MOTOR_INERTIA, 0],
            [0, 0, 0, 1],
            [SPRING / LINK_INERTIA, 0, -SPRING / LINK_INERTIA, -LINK_DAMPING / LINK_INERTIA],
        ]
    )
    b = np.array([[0], [LOOP / MOTOR_INERTIA], [0], [0]])
    held = cont2discrete((a, b, np.array([[0.0, 0, 1, 0]]), np.zeros((1, 1))), STEP, method="foh")
    return np.asarray(sosfilt(zpk2sos(*ss2zpk(*held[:4])), u))


def excitation(kind, rng=None, time=TIME):
    rng = np.random.default_rng(5) if rng is None else rng
    end = len(time) * STEP
    if kind == "chirp":
        return 0.15 * chirp(time, 0.5, end, 6)
    if kind == "chirp sine":
        return 0.15 * chirp(time, 0.5, end, 6, phi=-90)
    if kind == "wide chirp":
        return 0.15 * chirp(time, 0.5, end, 15)
    if kind == "logarithmic chirp":
        return 0.15 * chirp(time, 0.5, end, 12, method="logarithmic")
    if kind == "multisine":
        return sum(0.05 * np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) for f in np.arange(0.5, 10.1, 0.5))
    if kind == "dense multisine":
        return sum(0.05 * np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) for f in np.arange(0.5, 10.1, 0.1))
    return sosfilt(butter(4, 10, fs=1 / STEP, output="sos"), rng.standard_normal(len(time)))


KINDS = ["chirp", "chirp sine", "wide chirp", "logarithmic chirp", "multisine", "dense multisine", "noise"]


def complex_of(found):
    return found.gain * np.exp(1j * np.radians(found.phase))


def off(found, low=0.0, high=np.inf):
    """Largest relative error of the complex response between two frequencies, Hz, where the coherence is above 0.95."""
    used = (found.coherence > 0.95) & (found.frequency > low) & (found.frequency < high)
    return float(np.max(np.abs(complex_of(found) / analytic(found.frequency) - 1)[used]))


@pytest.mark.parametrize("kind", KINDS)
def test_gain_and_phase_are_the_analytic_ones(kind):
    u = excitation(kind)
    found = frequency_response(TIME, u, simulate(u))
    assert np.mean(found.coherence > 0.95) > 0.95
    assert off(found) < 0.018
    assert off(found, 0.7, 5.5) < 0.003
    # Unwrapped: past both resonances the phase tends to -360.
    assert kind != "wide chirp" or found.phase[-1] < -250


@pytest.mark.parametrize(("kind", "near"), [("dense multisine", 1e-4), ("noise", 5e-3)])
def test_resonance_and_bandwidth(kind, near):
    u = excitation(kind)
    found = frequency_response(TIME, u, simulate(u))
    grid = np.linspace(0.5, 10, 100_000)
    gain = np.abs(analytic(grid))
    assert found.resonance == pytest.approx((grid[np.argmax(gain)], gain.max()), rel=0.01)
    assert found.bandwidth == pytest.approx(grid[np.argmax(gain < gain[0] / np.sqrt(2))], rel=near)


def test_noise_has_no_bandwidth():
    """An output that has nothing to do with the input falls below any level somewhere."""
    noise = np.random.default_rng(1).normal(size=len(TIME))
    found = frequency_response(TIME, excitation("noise"), np.cumsum(noise) / 100.0)
    assert np.median(found.coherence) < 0.5
    assert found.bandwidth is None


def test_only_the_excited_band_is_reported():
    u = excitation("chirp sine")
    found = frequency_response(TIME, u, simulate(u))
    assert 0.5 <= found.frequency[0] < 0.8
    assert 5.7 < found.frequency[-1] < 6.5  # not 500, to which the record is sampled
    narrow = frequency_response(TIME, u, simulate(u), band=(1.0, 2.0))
    assert narrow.frequency[0] >= 1.0
    assert narrow.frequency[-1] <= 2.0


def lines(period, numbers, time, response=None, seed=3):
    """A multisine of harmonics, or the settled answer of a plant to it."""
    rng = np.random.default_rng(seed)
    found = np.zeros_like(time)
    for number in numbers:
        f, phase = number / period, rng.uniform(0, 2 * np.pi)
        value = 1.0 if response is None else response(np.array([f]))[0]
        found += 0.05 * np.abs(value) * np.sin(2 * np.pi * f * time + phase + np.angle(value))
    return found


@pytest.mark.parametrize(
    ("period", "numbers"),
    [(2.0, range(1, 21)), (2.00037, range(1, 20, 2)), (4.0, range(3, 40, 4)), (0.5003, [1])],
)
@pytest.mark.parametrize("end", [20.0, 17.3])
def test_a_multisine_is_exact_whatever_its_period(period, numbers, end):
    time = np.arange(0, end, STEP)
    found = frequency_response(time, lines(period, numbers, time) + 0.3, lines(period, numbers, time, analytic) - 0.1)
    assert ("single-frequency" in [finding.code for finding in found.findings]) is (len(numbers) == 1)
    np.testing.assert_allclose(found.frequency, np.array(list(numbers)) / period, rtol=1e-9)
    assert off(found) < 1e-9


def test_the_part_in_which_the_output_settles_is_left_out():
    time = np.arange(0, 30, STEP)
    u = lines(2.0, range(1, 21), time)
    settled = lines(2.0, range(1, 21), time, analytic) + 0.05 * np.exp(-time) * np.cos(7 * time)
    found = frequency_response(time, u, settled)
    assert off(found) < 1e-7


@pytest.mark.parametrize(("duration", "start", "phase"), [(10, 0.5, 0), (10, 1.0, -90), (60, 0.5, -90), (60, 1.0, 0)])
@pytest.mark.parametrize("around", ["rest", "offset", "drift", "noise"])
def test_the_band_of_a_chirp_begins_at_its_first_frequency(around, duration, start, phase):
    """A linear chirp begins where the window, which fades in over a twentieth of the record, leaves 0.35 of its power: within
    two bins of the closed form."""
    time = np.arange(0, duration, STEP)
    for method, end in (("linear", 6.0), ("linear", 15.0), ("logarithmic", 12.0)):
        u = 0.15 * chirp(time, start, duration, end, phi=phase, method=method)
        extra = {
            "rest": 0.0,
            "offset": 3.0,
            "drift": 0.03 * time / duration,
            "noise": 1e-3 * np.random.default_rng(1).standard_normal(len(time)),
        }[around]
        u = u + extra
        if around == "rest":
            u = np.concatenate([u, np.zeros(2000)])
        low, high, separate = excited_band(u, STEP, None)
        # A bin, or the tenth in which a chirp's power fades.
        assert start - max(0.1 * start, 1.01 / duration) <= low < 2.5 * start
        if method == "linear":
            faded = 0.05 * len(u) * STEP * np.arccos(1.0 - 2.0 * 0.35**0.5) / np.pi
            assert low == pytest.approx(start + (end - start) * faded / duration, abs=2.0 / duration)
        assert 0.8 * end < high < 1.1 * end + 1 / duration
        assert separate is None


def coverage(kind, level, seeds, duration=20.0):
    """Shares of the points whose gain, and phase, lies in its band, record by record; median band width over median error."""
    gains, phases, widths, off = [], [], [], []
    time = TIME[: round(duration / STEP)]
    for seed in seeds:
        rng = np.random.default_rng(seed)
        u = excitation(kind, rng)[: len(time)] if kind == "noise" else excitation(kind, rng, time)
        clean = simulate(u)
        found = frequency_response(time, u, clean + level * np.std(clean) * rng.standard_normal(len(time)))
        ratio = complex_of(found) / analytic(found.frequency)
        truth = np.abs(analytic(found.frequency))
        gains.append(float(np.mean((found.gain_low <= truth) & (truth <= found.gain_high))))
        phases.append(float(np.mean(np.abs(np.degrees(np.angle(ratio))) <= found.phase_margin)))
        widths += ((found.gain_high - found.gain_low) / (2 * found.gain)).tolist()
        off += np.abs(ratio - 1).tolist()
    return gains, phases, float(np.median(widths) / np.median(off))


@pytest.mark.parametrize("level", [0.002, 0.1])
@pytest.mark.parametrize("kind", ["chirp", "multisine", "noise"])
def test_bands_hold_the_truth_about_as_often_as_they_say(kind, level):
    """Four records: points that share bins agree, so about ten independent ones a record; a two-sided bound at 1e-3."""
    *shares, width = coverage(kind, level, range(4))
    for share in shares:
        assert binom.cdf(round(40 * np.mean(share)), 40, 0.95) > 1e-3
    # Of an error that is round in the complex plane with s in each direction: median 1.18 s, band 1.96 to 2.2 s.
    assert 1.1 < width < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("level", [0.002, 0.02, 0.1])
@pytest.mark.parametrize("duration", [5.0, 20.0])
@pytest.mark.parametrize("kind", ["chirp", "wide chirp", "logarithmic chirp", "multisine", "dense multisine", "noise"])
def test_bands_of_95_percent_cover_90_to_99_percent(kind, level, duration):
    for shares in coverage(kind, level, range(50), duration)[:2]:
        assert 0.90 <= np.mean(shares) <= 0.99


def test_unrelated_noise_has_no_coherence_and_wide_bands():
    rng = np.random.default_rng(2)
    found = frequency_response(TIME, rng.standard_normal(len(TIME)), rng.standard_normal(len(TIME)))
    assert np.median(found.coherence) < 0.1
    assert np.median(found.gain_low) == 0.0
    assert set(found.phase_margin[found.gain_low == 0.0]) == {180.0}
    assert "low-coherence" in [finding.code for finding in found.findings]


def test_jittered_and_gapped_records_are_brought_to_an_even_step():
    rng = np.random.default_rng(4)
    u = excitation("chirp")
    y = simulate(u)
    ticks = np.sort(np.arange(0, 20, 0.004) + rng.uniform(-0.001, 0.001, 5000))
    ticks = ticks[(ticks > 0) & (ticks < 19.99) & ~((ticks > 0.5) & (ticks < 0.8))]
    found = frequency_response(ticks, np.interp(ticks, TIME, u), np.interp(ticks, TIME, y))
    assert {finding.code for finding in found.findings} == {"gaps", "jitter"}
    assert off(found, 1.0, 5.5) < 0.025


@pytest.mark.parametrize(("share", "moves"), [(1e-6, True), (1e-8, False), (0.0, False)])
def test_an_output_that_hardly_varies_does_not_move(share, moves):
    u = excitation("chirp")
    y = simulate(u)
    found = frequency_response(TIME, u, 0.3 + 0.3 * share / np.ptp(y) * y)
    assert found.moves is moves
    assert (found.resonance is not None) is moves
    assert [finding.code for finding in found.findings] == ([] if moves else ["output-still"])


@pytest.mark.parametrize(("newtons", "metres"), [(549e3, 1.0), (1.0, 1 / 549e3), (1e-9, 1e-6)])
def test_input_and_output_are_judged_in_units_of_their_own(newtons, metres):
    """A spring of 549 kN/m moves by micrometres, which is a ten millionth of its force and still a motion."""
    u = excitation("chirp")
    found = frequency_response(TIME, newtons * u, metres * simulate(u))
    assert found.moves
    assert found.resonance is not None
    truth = analytic(found.frequency) * metres / newtons
    assert np.max(np.abs(complex_of(found) / truth - 1)) < 0.015


@pytest.mark.parametrize(
    ("u", "options", "words"),
    [
        (np.ones(len(TIME)), {}, "constant"),
        (np.full(len(TIME), np.nan), {}, "no samples in common"),
        (np.where(TIME < 0.02, TIME, np.nan), {}, "too few"),
        (np.sin(TIME**2), {"band": (2000.0, 3000.0)}, "resolves no frequency"),
    ],
)
def test_unusable_excitations_are_errors(u, options, words):
    with pytest.raises(RecordingError, match=words):
        frequency_response(TIME, u, np.sin(TIME), **options)
