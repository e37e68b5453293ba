"""Bounds of a motor's velocity at its stops."""

import pytest
from hypothesis import given
from hypothesis import strategies as some

from asrsim.actuators.motor import velocity_bounds

PLACES = some.floats(-3.0, 3.0)


@given(position=PLACES, stops=some.tuples(PLACES, PLACES), fastest=some.floats(0.1, 10.0), step=some.floats(1e-4, 0.5))
def test_a_motor_comes_to_its_stop_and_not_beyond_and_both_stops_are_alike(position, stops, fastest, step):
    """A motor beyond a stop stays there, or returns."""
    low, high = min(stops), max(stops)
    slowest, largest = velocity_bounds(position, low, high, fastest, step)
    wanted = max(low, position - fastest * step) if position > low else position
    assert position + slowest * step == pytest.approx(wanted, abs=1e-12)
    wanted = min(high, position + fastest * step) if position < high else position
    assert position + largest * step == pytest.approx(wanted, abs=1e-12)
    mirrored = velocity_bounds(-position, -high, -low, fastest, step)
    assert mirrored == pytest.approx((-largest, -slowest), abs=1e-12)
    assert velocity_bounds(position, low, high, fastest, 0.0) == (-fastest, fastest)
