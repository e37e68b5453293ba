"""Parts of learning, each against what it must be: presets that are chosen before a trial."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from asrsim.actuators import ACTUATORS
from asrsim.kinematics.drive_inverse import drive_backwards
from asrsim.kinematics.inverse import demands_of
from asrsim.learning.presets import CANDIDATES, _lowest, _range, scores
from asrsim.learning.trial import trial_of
from support.robots import drive_with

pytestmark = pytest.mark.once

TRIED = np.geomspace(0.01, 0.5, CANDIDATES)


@pytest.mark.parametrize("least", [0.001, 0.0137, 0.1, 0.31, 0.49])
def test_the_lowest_preset_that_holds_is_found(least: float) -> None:
    """Where a score falls with the preset: from above, within a 32nd of what is between two candidates."""
    found, score = _lowest(lambda preset: least / preset, TRIED, 7)
    at = np.searchsorted(TRIED, least)
    gap = TRIED[at] - TRIED[at - 1] if at else 0.0
    assert max(least, TRIED[0]) <= found <= max(least, TRIED[0]) + gap / 32.0
    assert score == pytest.approx(least / found)


def test_where_no_preset_holds_the_best_is_taken() -> None:
    found, score = _lowest(lambda preset: 2.0 + np.abs(np.log(preset / TRIED[9])), TRIED, 3)
    assert found == TRIED[9]
    assert score == 2.0


@pytest.mark.parametrize("name", ["qbmove", "bavs", "awas_ii"])
@pytest.mark.parametrize("limit", [0.6, np.inf])
def test_presets_are_tried_up_to_what_the_joint_can(name: str, limit: float) -> None:
    actuator = ACTUATORS.get(name)
    names = [parameter.name for parameter in actuator.parameters]
    elastic = tuple(0.1 if one == "lever_length" else 0.2 for one in names)
    tried = _range(SimpleNamespace(actuator=actuator, elastic=elastic, max_deflection=limit))
    if "lever_length" in names:
        most = 0.8 * 0.1
    elif np.isinf(limit) or actuator.adjuster:
        most = 4.0 * (actuator.typical_preset or 0.25)
    else:
        most = 0.9 * limit
    assert (tried[0], tried[-1], len(tried)) == (pytest.approx(0.02 * most), pytest.approx(most), CANDIDATES)
    np.testing.assert_allclose(tried[1:] / tried[:-1], tried[1] / tried[0])


@pytest.mark.parametrize("mode", [3, 6])
@pytest.mark.parametrize("share", [0.5, 2.0])
def test_a_preset_is_judged_by_its_sag_and_by_its_highest_demand(share: float, mode: int) -> None:
    """15 % of the torque over the stiffness, as a share of the tolerance; a motor's torque beside it, where it is highest."""
    spring = (6.7328, 0.0222, 6.7328, 0.0222, 1.2)
    drive = drive_with(ACTUATORS.get("qbmove"), mode=mode, spring=spring, joint="one")
    time = np.linspace(0.0, 2.0, 201)
    torque, rest = 0.1 * share * np.sin(0.5 * np.pi * time), 0.0 * time
    found = scores(drive, time, rest, rest, torque, 0.02, np.full(len(time), 0.4))
    item = drive_backwards(drive, time, rest, rest, torque, np.full(len(time), 0.4))
    steps = [
        np.array([drive.actuator.elastic_torques(q, *both, drive.elastic) for both in item.motors]).sum(axis=1)
        for q in (-1e-6, 1e-6)
    ]
    stiffness = (steps[0] - steps[1]) / 2e-6
    expected = 0.15 * np.abs(torque) / stiffness / 0.02
    for demand in demands_of(drive, time, rest, torque, item):
        at = round(demand.time / 0.01)
        expected[at] = max(expected[at], demand.score / 0.95)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-9)


def test_ratios_are_of_the_trial_before_and_need_an_error_there() -> None:
    problem = SimpleNamespace(reference=np.array([[3.0, 0.0], [0.0, 4.0]]))
    off = problem.reference + np.array([[3.0, 4.0], [0.0, 1.0]])
    first = trial_of(problem, off, off, before=None)
    assert (first.number, first.norm, first.ratio) == (0, 5.0, None)
    assert first.largest == (3.0, 4.0)
    assert first.rms == pytest.approx((np.sqrt(4.5), np.sqrt(8.5)))
    exact = trial_of(problem, off, problem.reference, before=first)
    assert (exact.number, exact.norm, exact.ratio) == (1, 0.0, 0.0)
    after = trial_of(problem, off, off, before=exact)
    assert (after.number, after.ratio) == (2, None)
