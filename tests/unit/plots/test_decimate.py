"""Thinning keeps every extreme and every gap, and needs no more memory for a longer series."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asrsim.plots import Envelope, decimate


def test_a_short_series_is_left_alone():
    time = np.arange(100.0)
    values = np.cos(time)
    assert decimate(time, values, bins=500)[1] is values


@given(st.integers(0, 2**32 - 1), st.integers(1, 7), st.integers(3, 40))
def test_every_interval_keeps_its_extremes_however_the_series_is_cut(seed, parts, bins):
    rng = np.random.default_rng(seed)
    n = 1000
    time, values = np.arange(n) * 0.01, rng.normal(size=(n, 2))
    values[rng.random((n, 2)) < 0.05] = np.nan
    envelope = Envelope(start=0.0, end=float(time[-1]), bins=bins)
    cuts = [0, *sorted(rng.integers(1, n, size=parts).tolist()), n]
    for start, end in pairwise(cuts):
        envelope.add(time[start:end], values[start:end])
    index = np.clip((time * (bins / time[-1])).astype(int), 0, bins - 1)
    for j in range(2):
        thin_time, thin = envelope.column(j)
        assert np.all(np.diff(thin_time) > 0)
        # Only samples of the series, at their own times.
        rows = np.searchsorted(time, thin_time)
        np.testing.assert_array_equal(values[rows, j], thin)
        for b in range(bins):
            mine = values[index == b, j]
            kept = thin[index[rows] == b]
            if np.isfinite(mine).any():
                assert np.nanmin(kept) == np.nanmin(mine)
                assert np.nanmax(kept) == np.nanmax(mine)
                low, high = sorted(envelope.pairs(j)[2 * b : 2 * b + 2])
                assert (low, high) == (np.nanmin(mine), np.nanmax(mine))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_missing_and_infinite_samples_are_a_gap(bad):
    time = np.arange(10_000) * 0.01
    values = np.sin(time)
    values[3000:6000] = bad
    thin_time, thin = decimate(time, values, bins=50)
    inside = (thin_time > 30.5) & (thin_time < 59.5)
    assert inside.any()
    assert np.isnan(thin[inside]).all()
    assert np.isfinite(thin[~inside]).any()
    assert not np.isinf(thin).any()
