"""Positions at which torques balance, against closed forms."""

import numpy as np
import pytest

from asrsim.statics.balance import balanced, by_differences, springs_by_differences

SLACK = springs_by_differences(np.zeros_like)
"""Springs without torque."""


def test_steps_that_would_go_to_and_fro_come_to_rest():
    """Undamped steps of Newton's method for the torque -sgn(q) sqrt|q| go from q to -q without end."""

    def torques(q):
        return -np.sign(q) * np.sqrt(np.abs(q))

    start, stops = np.array([[0.1], [-0.07]]), np.array([9.0])
    movable = np.array([True])
    nothing = by_differences(np.zeros_like, movable)
    positions, left = balanced(nothing, springs_by_differences(torques), start, -stops, stops, movable)
    assert positions == pytest.approx(np.zeros((2, 1)), abs=1e-12)
    assert left == pytest.approx(np.zeros((2, 1)), abs=1e-10)


def test_a_coarse_search_leaves_an_unstable_equilibrium_too():
    """An upright link without a spring: the first step away from there is shorter than the distance that is close enough."""
    upright, stops, movable = np.array([[np.pi]]), np.array([9.0]), np.array([True])
    weights = by_differences(lambda q: -np.sin(q), movable)
    found, _ = balanced(weights, SLACK, upright, -stops, stops, movable, close=0.1)
    assert np.cos(found[0, 0]) == pytest.approx(1.0, abs=0.01)


def test_robots_rest_where_springs_and_weights_balance_or_on_stops():
    """Two joints pull on each other; 3 q1 - q2 = 1, 2 q2 - q1 = 1 without stops, and q1 = 1 / 3 where q2 stands at 0."""
    springs, load = np.array([[3.0, -1.0], [-1.0, 2.0]]), np.array([1.0, 1.0])
    for highest, rest in ((9.0, [0.6, 0.8]), (0.0, [1.0 / 3.0, 0.0])):
        high = np.array([9.0, highest])
        start, low, both = np.zeros((1, 2)), np.full(2, -9.0), np.full(2, True)
        weights = by_differences(lambda q: load - q @ springs, both)
        positions, _ = balanced(weights, SLACK, start, low, high, both)
        assert positions[0] == pytest.approx(rest, abs=1e-9)
