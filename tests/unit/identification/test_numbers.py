"""Numbers of `asrsim identify` that need no recording: noise, what torques are linear in."""

from __future__ import annotations

import numpy as np
import pytest

from asrsim.identification.keys import Parameter
from asrsim.identification.layout import make_layout
from asrsim.identification.noise import CLIPPED, beyond_steps, fine_noise, lag_correlation, size_of
from asrsim.identification.regression import INSIDE, _solved

pytestmark = pytest.mark.once


@pytest.mark.parametrize("quantum", [0.0, 0.02])
@pytest.mark.parametrize("reach", [3.0, 1e6])
def test_a_smooth_record_has_the_noise_of_its_steps_or_a_millionth_of_its_range(quantum: float, reach: float) -> None:
    ramp = np.linspace(0.0, reach, 4096, endpoint=False)
    assert fine_noise(ramp, quantum) == pytest.approx(max(quantum / 12.0**0.5, 1e-6 * ramp[-1]), rel=1e-9)
    assert fine_noise(ramp[:3], quantum) == pytest.approx(max(quantum / 12.0**0.5, 1e-6 * ramp[2]), rel=1e-9)


def test_the_size_of_residuals_counts_outliers_little_and_neighbours_once() -> None:
    plain = np.tile([1.0, -1.0], 500)
    assert size_of(0.6745 * plain) == pytest.approx(0.6745)
    lone = plain.copy()
    lone[7] = 1e6
    assert size_of(lone) == pytest.approx((0.999 + 0.001 * (CLIPPED / 0.6745) ** 2) ** 0.5)
    assert lag_correlation(plain) == pytest.approx(-0.999)
    assert lag_correlation(plain, 2) == pytest.approx(0.998)
    assert lag_correlation(np.ones(3)) == lag_correlation(np.zeros(9)) == 0.0
    # An encoder's zero lies anywhere within a step.
    for zero, left in ((0.004, 0.0), (0.02, 0.015), (-0.02, -0.015)):
        beyond, borne = beyond_steps(np.full(50, zero), np.linspace(0.0, 1.0, 50), 0.01)
        np.testing.assert_allclose(beyond, left, atol=1e-12)
        assert 0.0 <= borne < 1.0


def test_numbers_in_which_torques_are_linear_are_found_at_once_and_stay_within_bounds() -> None:
    known = [
        Parameter(key=f"j.{name}", unit="1", start=start, low=low) for name, start, low in (("a", 2.0, 0.0), ("b", 0.5, 0.0))
    ]
    layout = make_layout(known, (), ["a"], [{}])
    matrix = np.random.default_rng(1).normal(size=(30, 2))
    for truth, found in (((40.0, 3.0), (40.0, 3.0)), ((5.0, -1.0), None)):
        wanted = matrix @ np.array(truth)
        there = layout.values(_solved(lambda x, wanted=wanted: matrix @ layout.values(x) - wanted, np.zeros(2), layout))
        if found:
            np.testing.assert_allclose(there, found, rtol=1e-6)
        else:
            assert there[1] == pytest.approx(INSIDE * 0.5)
            slope = float(matrix[:, 0] @ wanted / (matrix[:, 0] @ matrix[:, 0]))
            assert there[0] == pytest.approx(slope, rel=1e-5)
