"""Parts of learning, each against what it must be: presets that are chosen before a trial."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from asrsim.actuators import ACTUATORS
from asrsim.kinematics.drive_inverse import drive_backwards
from asrsim.kinematics.inverse import demands_of
from asrsim.learning.presets import CANDIDATES, _lowest, _over_time, _range, scores
from asrsim.learning.trial import trial_of
from support.robots import drive_with

pytestmark = pytest.mark.once

TRIED = np.geomspace(0.01, 0.5, CANDIDATES)


@pytest.mark.parametrize("least", [0.001, 0.0137, 0.1, 0.31, 0.49])
def test_the_lowest_preset_that_holds_is_found(least: float) -> None:
    """Where a score falls with the preset: from above, within a 32nd of what is between two candidates."""
    found, score = _lowest(lambda preset: least / preset, TRIED, 7)
    assert len(found) == 7
    assert np.ptp(found) == 0.0
    at = np.searchsorted(TRIED, least)
    gap = TRIED[at] - TRIED[at - 1] if at else 0.0
    assert max(least, TRIED[0]) <= found[0] <= max(least, TRIED[0]) + gap / 32.0
    assert score == pytest.approx(least / found[0])


def test_where_no_preset_holds_the_best_is_taken() -> None:
    found, score = _lowest(lambda preset: 2.0 + np.abs(np.log(preset / TRIED[9])), TRIED, 3)
    assert found.tolist() == [TRIED[9]] * 3
    assert score == 2.0


@pytest.mark.parametrize("step", [0.01, 0.02])
def test_a_preset_over_time_is_low_where_little_is_asked_for(step: float) -> None:
    """It holds everywhere, and a while before and after it must; nowhere is it above the constant one."""
    time = np.arange(0.0, 6.0, step)
    least = np.where(np.abs(time - 3.0) < 0.5, 0.3, 0.02)
    constant, _ = _lowest(lambda preset: least / preset, TRIED, len(time))
    values, score = _over_time(lambda preset: least / preset, constant, TRIED, step)
    assert score == pytest.approx((least / values).max())
    assert score <= 1.0
    assert values.max() <= constant[0] * (1.0 + 1e-12)
    # 0.4 s beyond what asks for it, and as smooth as a tenth of a second or two.
    assert values[np.abs(time - 3.0) < 0.65].min() > 0.9 * constant[0]
    quiet = values[np.abs(time - 3.0) > 1.6]
    assert quiet.max() < 1.3 * quiet.min()
    assert 0.02 <= quiet.min() < 0.05
    assert np.abs(np.diff(values)).max() < 2.0 * step * constant[0] / 0.4


def test_where_less_never_holds_the_constant_preset_stays() -> None:
    constant = np.full(50, 0.3)
    values, score = _over_time(lambda preset: np.where(preset < 0.3, 2.0, 0.9), constant, TRIED, 0.01)
    assert values is constant or values.tolist() == constant.tolist()
    assert score == 0.9


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
    first = trial_of(problem, off, off, before=None, expected=None)
    assert (first.number, first.norm, first.ratio, first.predicted) == (0, 5.0, None, None)
    assert first.largest == (3.0, 4.0)
    assert first.rms == pytest.approx((np.sqrt(4.5), np.sqrt(8.5)))
    exact = trial_of(problem, off, problem.reference, before=first, expected=problem.reference + 1.0)
    assert (exact.number, exact.norm, exact.ratio) == (1, 0.0, 0.0)
    assert exact.predicted == pytest.approx(np.sqrt(2.0) / 5.0)
    after = trial_of(problem, off, off, before=exact, expected=off)
    assert (after.number, after.ratio, after.predicted) == (2, None, None)
