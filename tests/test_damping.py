"""Response of links to torques, for the damping that the loop takes implicitly."""

from __future__ import annotations

import numpy as np
import pytest

from asrsim.simulation.damping import mean_response

STEP = 1e-3


def test_slow_damping_is_taken_at_the_middle_of_a_kick():
    response, lean = mean_response(np.diag([0.5, 0.02]), [0.1, 0.3], STEP)
    assert response == pytest.approx([0.5 * STEP / 0.5, 0.5 * STEP / 0.02], rel=1e-15)
    assert lean == [0.0, 0.0]


def test_a_motion_that_dies_within_a_step_leans_to_its_end():
    stiff = 100.0
    response, lean = mean_response(np.array([[1.0]]), [stiff / STEP], STEP)
    assert lean == pytest.approx([0.5 - 1.0 / stiff])
    assert response == pytest.approx([(1.0 - 1.0 / stiff) * STEP])


def test_strong_damping_between_joints_is_bounded_by_the_row():
    mass = np.array([[1.0, 0.9], [0.9, 1.0]])
    alone, _ = mean_response(np.diag(1.0 / np.diag(np.linalg.inv(mass))), [100.0, 100.0], STEP)
    coupled, _ = mean_response(mass, [100.0, 100.0], STEP)
    share = 1.0 + 0.9
    assert coupled == pytest.approx([share * value for value in alone], rel=1e-12)


def test_a_joint_without_damping_has_the_response_of_its_mass():
    response, lean = mean_response(np.array([[2.0, 0.1], [0.1, 1.0]]), [0.0, 0.5], STEP)
    inverse = np.linalg.inv(np.array([[2.0, 0.1], [0.1, 1.0]]))
    assert response == pytest.approx((0.5 * STEP * np.diag(inverse)).tolist())
    assert lean == [0.0, 0.0]
