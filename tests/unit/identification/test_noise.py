"""Noise, steps and swings of series; regression of parameters in which torques are linear."""

import numpy as np
import pytest
from scipy.signal import lfilter

from asrsim.identification.data import Channel
from asrsim.identification.judge import is_loud
from asrsim.identification.noise import (
    CLIPPED,
    autocovariances,
    autoregression,
    fine_noise,
    frequency,
    is_first_order,
    lag_correlation,
    quantum_of,
    size_of,
)
from asrsim.identification.problem import huber, robust_square
from asrsim.identification.search import has_outliers, refined
from asrsim.identification.track import first_samples
from support.identify_files import modelled


def test_noise_and_steps_are_found_in_a_smooth_record():
    generator, time = np.random.default_rng(0), np.linspace(0.0, 4.0, 4000)
    assert fine_noise(np.sin(time) + 1e-3 * generator.normal(size=4000)) == pytest.approx(1e-3, rel=0.1)
    assert quantum_of(1.5e-3 * np.round(np.sin(time) / 1.5e-3)) == pytest.approx(1.5e-3, rel=1e-3)
    for quantum in (0.0, 0.02):
        ramp = np.linspace(0.0, 1e6, 4096, endpoint=False)
        assert fine_noise(ramp, quantum) == pytest.approx(max(quantum / 12.0**0.5, 1e-6 * ramp[-1]), rel=1e-9)


@pytest.mark.parametrize("jitter", [0.0, 0.1])
def test_a_fast_motion_of_ten_samples_a_period_is_no_noise(jitter):
    """The times of the samples are known, and differ from even times by a tenth of the interval."""
    generator = np.random.default_rng(0)
    time = 0.02 * (np.arange(600) + jitter * generator.normal(size=600))
    values = 0.4 * np.sin(2.0 * np.pi * 5.0 * time) + 1e-3 * generator.normal(size=600)
    assert fine_noise(values, time=time) == pytest.approx(1e-3, rel=0.2)


@pytest.mark.parametrize("memory", [0.0, 0.95, -0.6])
def test_an_autoregression_has_the_coefficient_and_power_of_its_noise(memory):
    noise = lfilter([1.0], [1.0, -memory], np.random.default_rng(0).normal(size=5000))[1000:]
    model, power = autoregression(autocovariances(noise), 4000)
    assert model == pytest.approx([memory] if memory else [], abs=0.05)
    assert power == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.97])
def test_noise_behind_a_low_pass_of_first_order_is_told_from_errors_of_a_model(memory):
    """An oscillation of three standard deviations is added; or, to slow noise, white noise or a second low-pass."""
    generator, time = np.random.default_rng(0), np.linspace(0.0, 1.0, 1500)
    for _ in range(20):
        noise, white = lfilter([1.0], [1.0, -memory], generator.normal(size=2000))[500:], generator.normal(size=1500)
        size = float(np.std(noise))
        assert is_first_order(noise)
        assert not is_first_order(noise + 3.0 * size * np.sin(40.0 * time))
        if memory == 0.97:
            assert not is_first_order(noise + 0.5 * size * white)
            assert not is_first_order(lfilter([1.0], [1.0, -memory], noise))
        # Too few samples show nothing.
        assert not is_first_order(noise[:199])


@pytest.mark.parametrize("covariances", [[-1e-6, *[1e10] * 12], [0.0] * 13, [1.0, 2.0, -3.0, *[4.0, -4.0] * 5]])
def test_an_autoregression_of_impossible_autocovariances_is_stationary(covariances):
    """Corrections of a few samples may make autocovariances that no noise has."""
    with np.errstate(all="raise", under="ignore"):
        model, power = autoregression(np.array(covariances), 300)
    assert power >= 0.0
    assert np.abs(np.roots([1.0, *-model])).max(initial=0.0) < 1.0


def test_the_size_of_residuals_counts_outliers_little():
    plain = np.tile([1.0, -1.0], 500)
    assert size_of(0.6745 * plain) == pytest.approx(0.6745)
    lone = plain.copy()
    lone[7] = 1e6
    assert size_of(lone) == pytest.approx((0.999 + 0.001 * (CLIPPED / 0.6745) ** 2) ** 0.5)
    assert lag_correlation(plain) == pytest.approx(-0.999)


def test_residuals_that_are_large_alone_are_outliers():
    white = np.random.default_rng(0).normal(size=4000)
    for places, are_outliers in ([], False), (slice(0, None, 200), True), (slice(100, 200), False), ([7], False):
        values = white.copy()
        values[places] = 50.0
        assert has_outliers(values) == are_outliers, places


def test_lone_outliers_do_not_move_an_estimate():
    """Least squares would be off by .025, the mean of the outliers over the slope."""
    values = np.random.default_rng(0).normal(size=4000)
    values[::200] = 50.0
    assert refined(modelled(lambda x: values + 10.0 * x[0], 1, 4000), np.zeros(1)) == pytest.approx(0.0, abs=0.01)


def test_a_swing_stands_out_of_white_and_of_correlated_noise():
    generator, time = np.random.default_rng(0), np.arange(2000) * 1e-3
    for memory in (0.0, 0.5, 0.95):
        noise = lfilter([1.0], [1.0, -memory], generator.normal(size=(200, 600)))[:, 200:]
        assert sum(frequency(time, one) > 0.0 for one in noise) <= 1
    ringing = 0.4 * np.sin(2.0 * np.pi * 108.0 * time)
    assert frequency(time, generator.normal(size=2000) + ringing) == pytest.approx(108.0, abs=1.0)
    assert frequency(time, np.ones(200)) == 0.0


def test_a_deviating_segment_is_noisy_and_outliers_are_not():
    white = np.random.default_rng(0).normal(size=2000)
    assert not is_loud(white + np.where(np.arange(2000) % 100 == 0, 50.0, 0.0), 1.0)
    assert is_loud(white * np.where(np.arange(2000) < 200, 4.0, 1.0), 1.0)
    assert is_loud(white, 0.7)


@pytest.mark.parametrize("size", [0.1, 2.9, 3.1, 40.0])
def test_outliers_cost_as_their_size_beyond_three_deviations(size):
    assert huber(np.array([-size, size])) == pytest.approx(size**2 if size < 3.0 else 9.0 + 6.0 * (size - 3.0))


@pytest.mark.parametrize("size", [1.0, 100.0])
def test_outliers_cost_less_than_their_square_but_large_errors_of_a_model_do_not(size):
    smooth = size * np.sin(np.linspace(0.0, 20.0, 1000))
    assert robust_square(smooth) == pytest.approx(np.mean(smooth**2))
    outlier = np.where(np.arange(1000) == 500, 1e3 * size, smooth)
    assert robust_square(outlier) < 0.02 * np.mean(outlier**2)


def test_a_link_starts_where_a_parabola_through_15_samples_does():
    time, noise = 0.001 * np.arange(100), 0.01
    values = np.where(np.arange(100) < 15, 0.3 - 2.0 * time, 1e3)
    channel = Channel(joint="j", quantity="link_position", unit="rad", time=time, values=values, noise=noise, quantum=0.0)
    basis = np.vander(time[:15], 3, increasing=True)
    errors = noise * np.sqrt(np.diag(np.linalg.inv(basis.T @ basis)))
    assert first_samples(channel) == pytest.approx((0.3, -2.0, errors[0], errors[1]), rel=1e-6)


def coarse(values, time):
    """Channel of a sensor with steps of 2 mrad."""
    rounded = 2e-3 * np.round(values / 2e-3)
    return Channel(joint="j", quantity="link_position", unit="rad", time=time, values=rounded, noise=6e-4, quantum=2e-3)


@pytest.mark.parametrize("start", [0.0, 0.3, 0.5])
def test_a_coarse_sensor_shows_the_motion_at_the_start_over_a_longer_time(start):
    """A swing of 1.6 Hz whose first 15 samples are equal or neighbours; its speed at the start is 0.11 to 0.13 rad/s."""
    time = 1e-3 * np.arange(3000)
    channel = coarse(0.013 * np.sin(10.0 * time + start), time)
    _, slope, _, error = first_samples(channel, 12.0)
    assert abs(slope) > 2.0 * error
    assert slope == pytest.approx(0.13 * np.cos(start), abs=3.0 * error)
    assert abs(first_samples(channel)[1]) < 2.0 * first_samples(channel)[3]


@pytest.mark.parametrize("wait", [0.0, 0.05, 0.1, 0.2])
def test_a_link_that_a_torque_accelerates_from_rest_does_not_begin_in_motion(wait):
    time = 1e-3 * np.arange(3000)
    channel = coarse(0.5 * np.maximum(time - wait, 0.0) ** 2, time)
    _, slope, _, error = first_samples(channel, 4.0)
    assert abs(slope) < 2.0 * error
