"""Response of links to torques, for the damping that the substep takes implicitly."""

from __future__ import annotations

import numpy as np
import pytest

from asrsim.scenario.data import LinkDamping
from asrsim.simulation.damping import Response, mean_response
from validation.models import Body, chain, run

STEP = 1e-3


def response_of(mass: list[list[float]], dampings: list[float], *, explicit: bool = False) -> Response:
    return mean_response(np.array(mass), dampings, STEP, explicit=explicit, coupled=None)


def left(weight: float, decay: float) -> float:
    """What one step leaves of a motion that decays by c h / I, with that weight of the change in the mean velocity."""
    return (1.0 - (1.0 - weight) * decay) / (1.0 + weight * decay)


def test_slow_damping_is_taken_at_the_middle_of_a_kick() -> None:
    found = response_of([[0.5, 0.0], [0.0, 0.02]], [0.1, 0.3])
    assert found.weight == 0.5
    assert not found.coupled
    assert np.diag(found.response) == pytest.approx([0.5 * STEP / 0.5, 0.5 * STEP / 0.02], rel=1e-15)


@pytest.mark.parametrize("decay", [5.0, 7.0, 20.0, 1e3, 1e6])
@pytest.mark.parametrize("explicit", [False, True])
def test_a_motion_that_dies_within_a_step_rings_by_half_at_most(decay: float, explicit: bool) -> None:
    found = response_of([[2.0]], [2.0 * decay / STEP], explicit=explicit)
    assert -0.5 - 1e-12 <= left(found.weight, decay) < 0.0
    if decay > 6.0:
        assert left(found.weight, decay) == pytest.approx(-0.5)


def test_explicit_steppings_stay_explicit_where_they_are_stable() -> None:
    assert response_of([[1.0]], [1.4 / STEP], explicit=True).weight == 0.0
    assert response_of([[1.0]], [1.6 / STEP], explicit=True).weight > 0.0


def test_joints_that_damping_couples_are_solved_for_together() -> None:
    """Mean velocities after a torque: (1 + w h M^-1 C)^-1 w h M^-1 tau."""
    mass, dampings = np.array([[1.0, 0.9], [0.9, 1.0]]), np.array([300.0, 500.0])
    found = response_of(mass.tolist(), dampings.tolist())
    assert found.coupled
    response = found.weight * STEP * np.linalg.inv(mass)
    expected = np.linalg.solve(np.eye(2) + response @ np.diag(dampings), response @ [1.0, -2.0])
    assert found.response @ [1.0, -2.0] == pytest.approx(expected, rel=1e-12)
    still = np.linalg.solve(np.eye(2) + response @ np.diag(dampings), [0.3, 0.1])
    assert found.spread @ [0.3, 0.1] == pytest.approx(still, rel=1e-12)


def test_damping_follows_the_stiffness_where_there_is_a_spring_and_is_constant_where_there_is_none() -> None:
    constant, ratio = LinkDamping(constant=0.1), LinkDamping(constant=0.1, ratio=0.5, inertia=0.02)
    for mode, same in ((1, True), (6, False)):
        robot = chain(Body(actuator="sea"))
        ends = [run(robot, mode=mode, initial=[0.3], duration=0.05, link_damping={"*": law}) for law in (constant, ratio)]
        one, other = (end.samples.values["link_position"][-1, 0] for end in ends)
        assert bool(one == other) is same
