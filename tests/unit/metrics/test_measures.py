"""Measures on signals whose numbers are known in closed form."""

import math

import numpy as np
import pytest
from scipy import signal

from asrsim.errors import InputError
from asrsim.metrics import MEASURES, measure, summarise
from asrsim.metrics.frequency import frequency_response
from asrsim.metrics.lag import estimate_lag

TIME = np.linspace(0, 10, 10_001)


def second_order(damping, omega=20.0, height=1.0, start=0.0):
    """Step response at t = 0 of a standard second-order system."""
    damped = omega * math.sqrt(1 - damping**2)
    decay = np.exp(-damping * omega * TIME)
    return start + height * (1 - decay * (np.cos(damped * TIME) + damping * omega / damped * np.sin(damped * TIME)))


@pytest.mark.parametrize("unit", [1e-6, 1e3])
@pytest.mark.parametrize("name", ["frequency", "overshoot", "settling", "rise", "peak_time", "rms", "final", "steady_state"])
def test_measures_scale_with_the_unit(name, unit):
    """In other units shares, times and frequencies are the same, and values are so many times larger; noise included."""
    noise = 0.01 * np.random.default_rng(3).standard_normal(len(TIME))
    values = second_order(0.1) + noise
    times = unit if MEASURES.get(name).unit == "series" else 1.0
    assert measure(name, TIME, unit * values) == pytest.approx(times * measure(name, TIME, values), rel=1e-9, nan_ok=True)


@pytest.mark.parametrize("name", [name for name in MEASURES.names() if MEASURES.get(name).needs == "series" and name != "at"])
def test_measures_do_not_depend_on_the_zero_of_time(name):
    values = second_order(0.1) + 0.01 * TIME
    assert measure(name, TIME + 5.0, values) == pytest.approx(measure(name, TIME, values), rel=1e-9, nan_ok=True)


@pytest.mark.parametrize("damping", [0.1, 0.3, 0.6])
@pytest.mark.parametrize(("height", "start"), [(1.0, 0.0), (-0.4, 0.2)])
def test_overshoot_and_peak_time_of_a_second_order_system(damping, height, start):
    q = second_order(damping, height=height, start=start)
    root = math.sqrt(1 - damping**2)
    assert measure("overshoot", TIME, q) == pytest.approx(math.exp(-math.pi * damping / root), rel=1e-3)
    assert measure("peak_time", TIME, q) == pytest.approx(math.pi / (20 * root), abs=1e-3)


def test_rise_and_settling_of_a_first_order_system():
    q = 3 * (1 - np.exp(-TIME / 0.5))
    assert measure("rise", TIME, q) == pytest.approx(0.5 * math.log(9), rel=1e-4)
    assert measure("rise", TIME + 2.0, 0.3 + 0.7 * q / 3, initial=0.0, target=1.0) == pytest.approx(0.5 * math.log(7), rel=1e-4)
    assert measure("settling", TIME, q) == pytest.approx(0.5 * math.log(50), rel=1e-4)
    assert measure("settling", TIME, q, band=0.05) == pytest.approx(0.5 * math.log(20), rel=1e-4)
    assert measure("overshoot", TIME, q) == pytest.approx(0.0, abs=1e-6)
    assert math.isnan(measure("frequency", TIME, q))


def test_a_series_without_a_step_has_no_step_measures():
    assert math.isnan(measure("rise", TIME, np.full_like(TIME, 2.0)))
    assert math.isnan(measure("overshoot", TIME, np.zeros_like(TIME)))
    assert math.isnan(measure("settling", TIME, np.sin(TIME)))
    assert math.isnan(measure("frequency", TIME, np.ones_like(TIME)))
    assert math.isnan(measure("nrmse", TIME, TIME, np.ones_like(TIME)))
    assert math.isnan(measure("mean", TIME, np.full_like(TIME, np.nan)))


@pytest.mark.parametrize(
    ("name", "values", "options", "expected"),
    [
        ("steady_state", second_order(0.3), {}, 1.0),
        ("steady_state_error", second_order(0.3), {"target": 1.2}, 0.2),
        ("mean", TIME, {}, 5.0),
        ("rms", 2 * np.sin(2 * np.pi * TIME), {}, math.sqrt(2)),
        ("amplitude", 3 + 2 * np.sin(TIME), {}, 2.0),
        ("peak", -3 * TIME, {}, 30.0),
        ("at", TIME**2, {"when": 3.0}, 9.0),
        ("final", TIME, {}, 10.0),
        ("minimum", TIME - 3, {}, -3.0),
        ("maximum", TIME - 3, {}, 7.0),
    ],
)
def test_levels(name, values, options, expected):
    assert measure(name, TIME, values, **options) == pytest.approx(expected, rel=1e-5)


def test_a_window_and_missing_samples():
    q = TIME.copy()
    q[5000:6000] = np.nan
    assert measure("maximum", TIME, q, start=2.0, end=5.5) == pytest.approx(4.999)
    assert measure("minimum", TIME, q, start=2.0) == pytest.approx(2.0)
    assert measure("final", TIME, q, start=10.0) == 10.0


@pytest.mark.parametrize("hertz", [0.9, 17.51, 125.84])
@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_frequency_of_a_ringing(hertz, damping):
    omega = 2 * np.pi * hertz
    q = 0.8 - 0.3 * np.exp(-damping * omega * TIME) * np.cos(omega * TIME + 0.4)
    assert measure("frequency", TIME, q) == pytest.approx(hertz, rel=5e-4)


def test_frequency_of_two_tones_is_that_of_the_louder():
    q = np.sin(2 * np.pi * 3.37 * TIME) + 0.8 * np.sin(2 * np.pi * 8.53 * TIME + 1.0)
    assert measure("frequency", TIME, q, end=4.0) == pytest.approx(3.37, rel=1e-4)


@pytest.mark.parametrize(("length", "decay"), [(4, 3), (10, 6)])
def test_frequency_of_a_hardening_ringing(length, decay):
    # Rest, a step, a ringing whose crossings are uneven: the transform falls from 0 Hz on, and its flank is no oscillation.
    time = np.linspace(0, length, 1000 * length + 1)
    since = np.maximum(time - 0.1, 0)
    phase = 2 * np.pi * (1.2 * since + 2 * (1 - np.exp(-2 * since)))
    q = np.where(since > 0, 0.8 * (1 - np.exp(-decay * since) * np.cos(phase)), 0)
    assert 1.2 < measure("frequency", time, q) < 5.2


def test_fewer_than_two_crossings_in_a_direction_are_no_oscillation():
    wave = np.sin(2.0 * np.pi * TIME)
    assert measure("frequency", TIME, np.where(TIME < 2.5, wave, 0.0)) == pytest.approx(1.0, rel=1e-3)
    assert math.isnan(measure("frequency", TIME, np.where(TIME < 2.0, wave, 0.0)))


def test_rounding_has_no_frequency():
    """A joint that rests has rounding left, which swings."""
    shaken = 0.3 + 2e-13 * np.sin(2.0 * math.pi * 5.0 * TIME)
    assert math.isnan(measure("frequency", TIME, shaken))
    assert measure("frequency", TIME, 0.3 + 1e3 * (shaken - 0.3)) == pytest.approx(5.0, rel=0.01)


def test_frequency_with_noise_and_two_modes():
    rng = np.random.default_rng(3)
    q = np.sin(2 * np.pi * 3.3 * TIME) + 0.3 * np.sin(2 * np.pi * 11 * TIME) + 0.1 * rng.standard_normal(len(TIME))
    assert measure("frequency", TIME, q) == pytest.approx(3.3, rel=2e-3)


@pytest.mark.parametrize("shift", [-0.2, 0.0, 0.0437])
def test_delay(shift):
    pulse = np.exp(-((TIME - 5) ** 2))
    late = np.exp(-((TIME - 5 - shift) ** 2))
    assert measure("delay", TIME, late, pulse) == pytest.approx(shift, abs=1e-4)


def test_lag_between_different_samplings_gains_and_offsets():
    coarse = np.sort(np.random.default_rng(0).uniform(0, 10, 900))
    found = estimate_lag(TIME, np.exp(-((TIME - 5) ** 2)), coarse, 7 - 3 * np.exp(-((coarse - 5.3) ** 2)) * -1)
    assert found is not None
    assert found.seconds == pytest.approx(0.3, abs=1e-3)
    assert found.correlation > 0.999
    assert estimate_lag(TIME, np.ones_like(TIME), TIME, TIME) is None


SPAN = np.arange(0, 20, 0.005)
MOTIONS = {
    "sine": lambda t: np.sin(2 * np.pi * t),
    "slow sine": lambda t: np.sin(2 * np.pi * 0.3 * t),
    "chirp": lambda t: np.sin(2 * np.pi * (0.3 * t + 0.05 * t**2)),
    "step": lambda t: 1.0 * (t > 5),
}


@pytest.mark.parametrize(("kind", "noise"), [("sine", 0.05), ("sine", 0.5), ("slow sine", 0.1), ("chirp", 0.2), ("step", 0.05)])
def test_noise_does_not_draw_a_delay_towards_zero(kind, noise):
    """A motion, and the same 0.15 s later, each with noise of its own."""
    rng = np.random.default_rng(0)
    found = [
        measure("delay", SPAN, *(MOTIONS[kind](SPAN - late) + noise * rng.standard_normal(len(SPAN)) for late in (0.15, 0.0)))
        for _ in range(20)
    ]
    assert np.mean(found) == pytest.approx(0.15, abs=0.003)


@pytest.mark.parametrize("kind", ["noise", "sines", "sine and noise"])
def test_unrelated_series_have_no_delay(kind):
    noise = np.random.default_rng(0).standard_normal((2, len(SPAN)))
    sines = np.sin(2 * np.pi * np.array([[0.7], [2.3]]) * SPAN)
    first, second = {"noise": noise, "sines": sines, "sine and noise": (sines[0], noise[0])}[kind]
    assert math.isnan(measure("delay", SPAN, first, second))


def test_a_delay_at_the_limit_of_the_search_is_none():
    pulse, late = np.exp(-((TIME - 4) ** 2)), np.exp(-((TIME - 5) ** 2))
    assert math.isnan(measure("delay", TIME, late, pulse, limit=0.5))
    assert measure("delay", TIME, late, pulse, limit=1.5) == pytest.approx(1.0, abs=1e-3)
    assert math.isnan(measure("delay", TIME, -late, pulse, limit=1.5))


@pytest.mark.parametrize(("name", "expected"), [("rmse", "rms"), ("bias", "mean")])
def test_differences_weigh_by_time(name, expected):
    """Ten times as many samples in the first second count no more than that second."""
    uneven = np.concatenate([np.linspace(0, 1, 1001), np.linspace(1, 10, 91)[1:]])
    values = np.where(uneven < 1, 1.0, 0.0) + 0.3 * np.sin(uneven)
    assert measure(name, uneven, values, np.zeros_like(values)) == measure(expected, uneven, values)
    dense = np.linspace(0, 10, 100_001)
    truth = measure(expected, dense, np.where(dense < 1, 1.0, 0.0) + 0.3 * np.sin(dense))
    assert measure(name, uneven, values, np.zeros_like(values)) == pytest.approx(truth, rel=0.03)


def test_r2_of_a_constant_reference_is_undefined():
    """The mean of equal values differs from them by rounding."""
    assert np.isnan(measure("r2", TIME, np.full_like(TIME, 0.3), np.full_like(TIME, 0.1)))


def test_r2():
    q = np.sin(TIME)
    assert measure("r2", TIME, q, q) == 1.0
    assert measure("r2", TIME, np.full_like(q, measure("mean", TIME, q)), q) == pytest.approx(0.0, abs=1e-9)


def test_displacement_of_a_body():
    poses = np.full((len(TIME), 7), 0.7)
    poses[:, 0], poses[:, 1], poses[:, 6] = 0.3 * np.sin(np.pi * TIME / 10), 0.04 * TIME, 1.0
    away = np.hypot(poses[:, 0], poses[:, 1]).max()
    poses[:, :3] += (-2.0, 0.5, 0.0)
    assert measure("displacement", TIME, poses) == pytest.approx(0.4)
    assert measure("displacement", TIME, poses, axis="y") == pytest.approx(0.4)
    assert measure("maximum_displacement", TIME, poses) == pytest.approx(away)
    assert measure("distance", TIME, poses, x=-2.0, y=0.6, z=0.7) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("name", "values", "options", "words"),
    [
        ("rsme", TIME, {}, "choose from rmse"),
        ("rmse", TIME, {}, "second series"),
        ("settling", TIME, {"bandd": 0.1}, "not an option"),
        ("at", TIME, {}, "must be given"),
        ("mean", np.zeros((len(TIME), 7)), {}, "scalar series"),
    ],
)
def test_wrong_use_is_explained(name, values, options, words):
    with pytest.raises(InputError, match=words):
        measure(name, TIME, values, **options)


def test_summary_of_a_joint():
    q = second_order(0.3)
    found = summarise(TIME, {"link_position": q, "position_error": 1.1 - q, "deflection": 0.2 - 0.5 * q})
    assert found.steady_state_error == pytest.approx(0.1, abs=1e-6)
    assert found.overshoot == pytest.approx(0.372, abs=1e-3)
    assert found.peak_deflection == pytest.approx(0.5 * 1.3723 - 0.2, abs=1e-3)
    assert found.frequency == pytest.approx(20 * math.sqrt(1 - 0.09) / 2 / math.pi, rel=0.01)
    assert summarise(TIME, {}).as_dict()["overshoot"] is None
    assert math.isnan(summarise(TIME, {"link_position": q}, step=len(TIME)).settling)


def test_a_drifting_periodic_motion_has_no_delay_of_a_period():
    """The period is the limit of the search, and the drift makes its edge correlate best."""
    time = np.arange(0, 24.8, 0.01)
    motion = np.cos(2 * np.pi * time / 6.22)
    drift = motion - 0.0002 * time**2
    assert abs(measure("delay", time, drift, motion)) < 0.1


def test_a_short_end_that_fits_better_is_no_lag():
    """Less than half of the series overlaps there."""
    generator = np.random.default_rng(0)
    first, time = generator.normal(size=1000), 0.01 * np.arange(1000)
    second = first + 0.5 * generator.normal(size=1000)
    second[:200] = first[800:]
    found = estimate_lag(time, first, time, second, limit=10.0)
    assert found is not None
    assert found.seconds == pytest.approx(0.0, abs=0.01)
    assert not found.ambiguous


def test_measures_of_a_response_are_those_of_its_frequency_response():
    """Of a resonator, driven by a chirp; `test_frequency` compares frequency responses with closed forms."""
    time, omega = np.arange(0.0, 40.0, 0.005), 6.0 * np.pi
    given = signal.chirp(time, 0.2, 40.0, 10.0)
    _, output, _ = signal.lsim(([omega**2], [1.0, 0.6 * omega, omega**2]), given, time)
    band = {"low": 0.5, "high": 8.0}
    found = frequency_response(time, given, output, band=(0.5, 8.0))
    # The peak, at 2.7 Hz, may be near the end of the band.
    assert frequency_response(time, given, output, band=(0.5, 3.1)).resonance == pytest.approx(found.resonance, rel=1e-3)
    peak = [measure(name, time, output, given, **band) for name in ("resonance", "largest_gain")]
    assert peak == pytest.approx(found.resonance, rel=1e-3)
    assert measure("bandwidth", time, output, given, **band) == found.bandwidth
    assert 0.99 < measure("coherence", time, output, given, **band) <= 1.0
    assert measure("gain", time, output, given, hertz=5.0, **band) == pytest.approx(np.interp(5.0, found.frequency, found.gain))
    assert np.isnan(measure("gain", time, np.zeros_like(time), given, hertz=5.0, **band))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("late", "trusted"), [(0.3, True), (0.95, True), (1.05, False), (1.5, False)])
def test_a_delay_beyond_the_limit_of_the_search_is_undefined(late, trusted, sign):
    """A bump, and the same bump later or earlier; the search covers 1 s in both directions."""
    first, second = np.exp(-((TIME - 5.0) ** 2)), np.exp(-((TIME - 5.0 - sign * late) ** 2))
    found = estimate_lag(TIME, first, TIME, second, limit=1.0)
    assert found is not None
    assert (found.at_limit, found.is_trusted) == (not trusted, trusted)
    assert found.seconds == pytest.approx(sign * min(late, 1.0), abs=2e-3)
    delay = measure("delay", TIME, second, first, limit=1.0)
    assert delay == pytest.approx(sign * late, abs=1e-3) if trusted else math.isnan(delay)
