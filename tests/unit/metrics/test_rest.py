"""Measures that need rest are either those of the closed form, or undefined."""

import math

import numpy as np
import pytest

from asrsim.errors import InputError
from asrsim.metrics import measure
from asrsim.metrics.expect import evaluate_expectation
from asrsim.metrics.measures import AT_REST, rest_of, unrest
from asrsim.metrics.summary import summarise
from asrsim.scenario.data import Expectation

SECONDS = 2.0
HEIGHT = 0.5


def response(time, damping, omega):
    """Response of a second-order system of unit gain to a step at t = 0, with its distance from rest at the end."""
    if damping == 1.0:
        rest = np.exp(-omega * time) * (1.0 + omega * time)
        return 1.0 - rest, rest[-1]
    if damping > 1.0:
        slow, fast = (omega * (damping + sign * math.sqrt(damping**2 - 1.0)) for sign in (-1.0, 1.0))
        rest = (fast * np.exp(-slow * time) - slow * np.exp(-fast * time)) / (fast - slow)
        return 1.0 - rest, rest[-1]
    damped, decay = omega * math.sqrt(1.0 - damping**2), np.exp(-damping * omega * time)
    rest = decay * (np.cos(damped * time) + damping * omega / damped * np.sin(damped * time))
    return 1.0 - rest, decay[-1] / math.sqrt(1.0 - damping**2)


def responses(noise=0.0, dampings=(0.0, 0.002, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 1.0, 1.5, 3.0)):
    """Steps of many dampings and frequencies, from a twentieth of a period to 90 periods, and of different beginnings."""
    random = np.random.default_rng(5)
    for damping in dampings:
        for radians in np.geomspace(0.3, 550.0, 40):
            for start in (0.0, 0.13, 0.5):
                time = np.arange(0.0, SECONDS + start, 0.001)
                motion, left = response(np.maximum(time - start, 0.0), damping, radians / SECONDS)
                yield damping, time, HEIGHT * motion + noise * random.standard_normal(len(time)), start, left


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_steady_state_is_that_of_the_closed_form_or_undefined(noise):
    found = [(measure("steady_state", time, q), left) for _, time, q, _, left in responses(noise)]
    values = np.array([value for value, _ in found])
    assert np.nanmax(np.abs(values - HEIGHT)) < 0.02 * HEIGHT
    assert all(math.isnan(value) for value, left in found if left > 0.05)
    # What has come to rest long before the end is measured.
    assert np.mean([math.isfinite(value) for value, left in found if left < 1e-3]) > 0.98
    assert all(math.isfinite(value) for value, left in found if left < 1e-5)


def test_overshoot_and_settling_are_those_of_the_closed_form_or_undefined():
    for damping, time, q, start, _ in responses(dampings=(0.0, 0.03, 0.1, 0.3, 0.5)):
        overshoot, settling = (measure(name, time, q, start=start) for name in ("overshoot", "settling"))
        assert math.isnan(overshoot) or abs(overshoot - math.exp(-math.pi * damping / math.sqrt(1 - damping**2))) < 0.03
        if math.isfinite(settling):
            outside = np.abs(q - HEIGHT) > 0.035 * HEIGHT
            assert not outside[time > start + settling].any()


@pytest.mark.parametrize("name", AT_REST)
def test_a_swing_that_ends_at_its_extremum_is_not_at_rest(name):
    """Undamped swings that end at any extremum, and one that ends 3 ms after it."""
    for half_periods in (1.0, 1.01, 2.0, 3.0, 7.0):
        time = np.arange(0.0, 1.0, 0.001)
        q = 1.0 - np.cos(math.pi * half_periods * time)
        assert math.isnan(measure(name, time, q, np.ones_like(q)))
        assert unrest(name, time, q, np.ones_like(q)) == pytest.approx(1.0, rel=0.45)


@pytest.mark.parametrize("slow", [0.5, 2.0, 10.0])
def test_a_creep_after_a_fast_step_is_not_at_rest(slow):
    """A tenth of the step creeps with a time constant of `slow` s: the series is at rest once 1 % of the step is left."""
    for seconds in (0.3, 1.0, 2.0, 5.0, 20.0, 60.0):
        time = np.linspace(0.0, seconds, 4001)
        q = 0.9 * (1.0 - np.exp(-time / 0.01)) + 0.1 * (1.0 - np.exp(-time / slow))
        left = 0.1 * math.exp(-seconds / slow)
        value = measure("steady_state", time, q)
        assert math.isnan(value) if left > 0.013 else abs(value - 1.0) < 0.013


@pytest.mark.parametrize(("hertz", "damping"), [(2.2, 0.06), (1.8, 0.09), (3.4, 0.04)])
def test_a_decaying_swing_has_its_amplitude_left_whenever_the_series_ends(hertz, damping):
    """The last tenth, a half swing and the noise of turning points make no creep of a swing."""
    time = np.arange(0.0, 7.0, 0.001)
    q = response(time, damping, 2.0 * math.pi * hertz)[0]
    for end in np.arange(1.0, 7.0, 0.05):
        before = time <= end
        amplitude, extent = np.abs(q[~before] - 1.0).max(initial=0.0), np.ptp(q[before])
        left = rest_of(time[before], q[before])[1]
        assert left < max(2.0 * amplitude, 1e-2 * extent)
        assert left > 0.5 * amplitude or amplitude < 0.015 * extent


def test_a_creep_shows_below_the_rest_of_a_swing():
    """Three tenths of the step creep with a time constant of 1.4 s below a swing at 3 Hz, which is gone after 5 s."""
    time = np.arange(0.0, 8.0, 0.001)
    q = 0.7 * response(time, 0.05, 2.0 * math.pi * 3.1)[0] + 0.3 * (1.0 - np.exp(-time / 1.4))
    for end in np.arange(2.0, 8.0, 0.05):
        before = time <= end
        creep = 0.3 * math.exp(-end / 1.4)
        left = rest_of(time[before], q[before])[1]
        assert left < 4.0 * max(np.abs(q[~before] - 1.0).max(initial=0.0), 0.015)
        assert left > 0.0 or creep < 0.015


def test_stiction_and_a_series_that_never_moves_are_rest():
    time = np.linspace(0.0, 1.0, 1001)
    stuck = np.where(time < 0.6, 0.3 - 0.3 * np.cos(math.pi * time / 0.6), 0.6)
    assert measure("steady_state", time, stuck) == pytest.approx(0.6)
    assert measure("steady_state", time, np.full_like(time, 0.2)) == pytest.approx(0.2)
    assert measure("steady_state", time, 0.2 + 1e-7 * time) == pytest.approx(0.2, abs=1e-6)
    assert measure("steady_state", time, 0.2 + 1e-3 * np.random.default_rng(1).standard_normal(1001)) == pytest.approx(
        0.2, abs=1e-3
    )


def test_the_error_of_a_steady_motion_is_at_rest_and_the_motion_is_not():
    """A ramp that is followed with a constant lag, and a sine that is followed with a lag."""
    time = np.linspace(0.0, 4.0, 4001)
    assert measure("steady_state_error", time, time - 0.1 * (1.0 - np.exp(-time / 0.1)), time) == pytest.approx(0.1, abs=1e-4)
    assert math.isnan(measure("steady_state", time, time - 0.1))
    assert math.isnan(measure("steady_state_error", time, np.sin(5.0 * (time - 0.1)), np.sin(5.0 * time)))


@pytest.mark.parametrize("name", AT_REST)
def test_a_claim_about_a_motion_that_has_not_ended_fails_in_words(name):
    time = np.arange(0.0, 1.0, 0.001)
    columns = {"link_position": 0.5 - 0.5 * np.cos(math.pi * time), "position_error": 0.5 * np.cos(math.pi * time)}
    claim = Expectation(joint="elbow", quantity="link_position", measure=name, comparison="<", value=1e9)
    found = evaluate_expectation(claim, time, columns, checked=False)
    assert not found.holds
    assert f"{name} of link_position cannot be measured, since it is not at rest at the end (0." in found.text
    assert " rad of motion is left), expected < 1e+09" in found.text


def test_a_target_replaces_the_steady_state_that_a_swing_lacks():
    time = np.arange(0.0, 1.0, 0.001)
    swing = 1.0 - np.cos(3.0 * math.pi * time)
    assert measure("overshoot", time, swing, target=1.0) == pytest.approx(1.0, abs=1e-4)
    with pytest.raises(InputError):
        measure("steady_state", time, swing, target=1.0)


@pytest.mark.parametrize("rate", [0.3, 4.0])
def test_the_summary_s_steady_state_and_motion_are_those_of_the_measures(rate):
    time = np.linspace(0.0, 4.0, 801)
    q = 1.0 - np.exp(-rate * time)
    steady, left = rest_of(time, q)
    assert steady == pytest.approx(measure("steady_state", time, q), rel=0.0, nan_ok=True)
    assert left == unrest("steady_state", time, q)
    assert np.isnan(steady) == (left > 0.0)


def test_the_summary_has_all_measures_that_need_rest_or_none():
    """A step begins at 0.1 s, so that the windows of the measures differ."""
    time = np.arange(0.0, 4.0, 0.001)
    q = response(np.maximum(time - 0.1, 0.0), 0.08, 2.0 * math.pi * 2.5)[0]
    verdicts = set()
    for end in np.arange(1.0, 4.0, 0.02):
        before = time <= end
        found = summarise(time[before], {"link_position": q[before], "position_error": 1.0 - q[before]}, step=100)
        rests = {math.isfinite(value) for value in (found.steady_state, found.steady_state_error, found.overshoot)}
        assert rests == {found.motion_left == 0.0}
        assert math.isnan(found.settling) or found.motion_left == 0.0
        verdicts |= rests
    assert verdicts == {True, False}
