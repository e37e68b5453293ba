"""Closed chains against an equation of one freedom; the gap stays closed; what cannot be closed is refused in words."""

import numpy as np
import pytest

import asrsim
from asrsim.errors import AsrsimError
from support import four_bar
from validation.models import INSTALLED

TORQUE = 0.2


def run(folder, engine, *, step=1e-3, compiled=None, text=None, **keys):
    path = folder / "four_bar.urdf"
    path.write_text(text or four_bar.urdf())
    keys = {
        "duration": 1.0, "loops": four_bar.LOOPS, "initial": {"crank": 1.0, "coupler": -2.25, "rocker": -2.4}, "substeps": 1,
        "external_torques": {"crank": TORQUE}, **keys,
    }  # fmt: skip
    return asrsim.run(asrsim.make_scenario(path, engine=engine, step=step, compiled=compiled, **keys)).run.samples.values


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_four_bar_moves_at_second_order(tmp_path, engine):
    times, errors = np.linspace(0.0, 1.0, 11), []
    truth = four_bar.solve(times, TORQUE)
    for step in (2e-3, 5e-4):
        q = run(tmp_path, engine, step=step)["link_position"]
        errors.append(np.abs(q[np.round(times / step).astype(int), 0] - truth).max())
    assert np.ptp(truth) > 1.5
    assert errors[1] < 1e-5
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)


def test_both_engines_and_the_compiled_loop_move_a_four_bar_equally(tmp_path):
    ends = [
        run(tmp_path, engine, compiled=compiled, duration=0.5)["link_position"]
        for engine in INSTALLED for compiled in (False, True)
    ]  # fmt: skip
    for k in range(0, len(ends), 2):
        np.testing.assert_array_equal(ends[k], ends[k + 1])
    for other in ends[1:]:
        np.testing.assert_allclose(ends[0], other, rtol=0.0, atol=1e-11)


def test_the_gap_of_a_loop_stays_closed(tmp_path):
    """For a minute: 60,000 steps."""
    q = run(tmp_path, "mujoco", duration=60.0, compiled=True, external_torques={})["link_position"]
    assert np.ptp(q[:, 0]) > 1.0
    assert four_bar.gap(q).max() < 1e-12


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_spring_drives_a_loop_through_its_master(tmp_path, engine):
    keys = {"actuators": {"crank": {"type": "sea", "mode": 6}}, "references": {"crank": {"equilibrium_position": 1.0}}}
    effort = '<limit effort="100" velocity="100"/>'
    values = run(tmp_path, engine, text=four_bar.urdf(effort), external_torques={}, substeps=None, duration=3.0,
                 link_damping={"crank": {"constant": 0.3}}, **keys)  # fmt: skip
    q = values["link_position"]
    assert np.abs(q[-1] - q[-200]).max() < 1e-3
    assert 0.0 < abs(q[-1, 0] - 1.0) < 0.1
    assert four_bar.gap(q).max() < 1e-12


LOOP = four_bar.LOOPS[0]
REFUSED = {
    "no start closes it": ({"loops": [LOOP | {"points": [[3, 0, 0], [0.3, 0, 0]]}]}, "no positions of its joints close it"),
    "dead centre": ({"initial": {"crank": np.pi / 2, "coupler": -np.pi / 2, "rocker": 0.0},
                     "loops": [{"links": ["A", "C"], "points": [[0.15, 0, 0], [-0.25, 0, 0]]}]}, "dead centre|close it"),
    "unknown master": ({"loops": [LOOP | {"master": "elbow"}]}, "is no joint of the loop|no moving joint|elbow"),
    "one link twice": ({"loops": [{"links": ["B", "B"], "points": [[0, 0, 0], [0.1, 0, 0]]}]}, "no joints lie between"),
    "two loops with one joint": ({"loops": [LOOP, LOOP]}, "belongs to another loop"),
    "equilibrium": ({"initial": "equilibrium"}, "closed chains"),
    "two masters": (
        {"actuators": {"crank": {"type": "sea", "mode": 6}, "rocker": {"type": "sea", "mode": 6}}}, "several driven joints",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_loops_that_cannot_be_simulated_are_refused_in_words(tmp_path, case):
    keys, words = REFUSED[case]
    with pytest.raises(AsrsimError, match=words):
        run(tmp_path, "mujoco", duration=0.01, **keys)
