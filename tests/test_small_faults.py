"""Small faults that slipped through once: a sign, a factor, a padding, an inertia that stays behind."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from conftest import Tiny

from asrsim.learning.law import zero_phase
from asrsim.learning.perturb import _heavier
from asrsim.recordings.stamps import one_zero
from asrsim.recordings.timebase import _spacing
from asrsim.robot import load_robot
from asrsim.scenario import load_scenario
from asrsim.simulation.certify import certify
from asrsim.simulation.run import simulate

EXAMPLES = Path(__file__).parents[1] / "examples"
SECOND = 1_000_000_000


@dataclass(frozen=True)
class Stamps:
    """What `one_zero` looks at of a table."""

    values: np.ndarray
    zeros: dict[int, int]


@pytest.mark.parametrize("later", [2.5, -0.75])
def test_stamps_of_two_columns_come_onto_the_first_one_s_zero(later: float) -> None:
    zero = 1_700_000_000 * SECOND
    table = Stamps(np.array([[0.0, 0.0, 7.0], [0.1, 0.1, 8.0]]), {0: zero, 1: zero + round(later * SECOND)})
    found, start = one_zero(table)  # type: ignore[arg-type]
    assert start == pytest.approx(1.7e9)
    np.testing.assert_allclose(found.values, [[0.0, later, 7.0], [0.1, 0.1 + later, 8.0]])
    assert table.values[0, 1] == 0.0  # the table itself is left alone


@pytest.mark.parametrize("missing", [1, 2, 5])
def test_a_single_missing_sample_is_a_gap_and_jitter_is_none(missing: int) -> None:
    time = np.delete(np.arange(100) * 0.01, range(40, 40 + missing))
    (found,) = _spacing(time, np.arange(len(time)), path=Path("lab.csv"), name="time", numbered=True)
    assert found.code == "dropped-samples"
    assert f"{missing} samples are missing in 1 gaps" in found.message
    jittered = np.arange(100) * 0.01
    jittered[50:] += 0.006  # a step of 1.6 is no missing sample
    assert [
        finding.code for finding in _spacing(jittered, np.arange(100), path=Path("lab.csv"), name="time", numbered=True)
    ] == ["jitter"]


@pytest.mark.parametrize("cutoff", [0.5, 2.0])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_the_filter_keeps_a_ramp_to_its_ends(cutoff: float, order: int) -> None:
    """A padding shorter than what the filter remembers leaves its start in the first samples."""
    time = np.arange(0, 20, 0.005)
    ramp = np.column_stack([time, 3 - 0.5 * time])
    off = np.abs(zero_phase(ramp, cutoff, order, 0.005) - ramp)
    assert off.max() < 1e-3 / cutoff


@pytest.mark.parametrize("factor", [1.25, 0.5])
def test_a_heavier_link_has_more_inertia(factor: float) -> None:
    robot = load_robot(EXAMPLES / "urdf" / "dof1_qbmove.urdf")
    (joint,) = robot.moving_joints
    changed = _heavier(robot, joint.name, factor)
    before, after = (next(link for link in one.links if link.name == joint.child) for one in (robot, changed))
    assert after.mass == pytest.approx(factor * before.mass)
    np.testing.assert_allclose(after.inertia, factor * np.array(before.inertia))


@pytest.mark.parametrize(("stepping", "order"), [("leapfrog", 2), ("euler", 1)])
def test_a_certified_order_is_the_scheme_s_where_forces_are_smooth(stepping: str, order: int, tiny: Tiny) -> None:
    text = tiny.scenario.read_text(encoding="utf-8")
    text = text.replace("step: {at: 0.1, to: 0.5}", "sinusoid: {amplitude: 0.4, frequency: 1.5}")
    tiny.scenario.write_text(f"{text}stepping: {stepping}\n", encoding="utf-8")
    (scenario,) = load_scenario(tiny.scenario)
    reported = certify(scenario, simulate(scenario)).joints["elbow"]
    assert reported.order == pytest.approx(order, abs=0.15)
