"""Small faults that slipped through once: a sign, a factor, a padding."""

from __future__ import annotations

import numpy as np
import pytest

from asrsim.learning.law import zero_phase


@pytest.mark.parametrize("cutoff", [0.5, 2.0])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_the_filter_keeps_a_ramp_to_its_ends(cutoff: float, order: int) -> None:
    """If the padding were shorter than the filter's memory, its transient would remain in the first samples."""
    time = np.arange(0, 20, 0.005)
    ramp = np.column_stack([time, 3 - 0.5 * time])
    off = np.abs(zero_phase(ramp, cutoff, order, 0.005) - ramp)
    assert off.max() < 1e-3 / cutoff
