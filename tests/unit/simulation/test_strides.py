"""Worlds that take fewer substeps while their springs are soft enough."""

import numpy as np
import pytest

import asrsim
from asrsim.errors import InputError
from support.paths import EXAMPLES

pytest.importorskip("numba")
SINE = {"equilibrium_position": {"sinusoid": {"amplitude": 0.8, "frequency": 3.0}}, "stiffness_preset": 0.2}
RANGES = {"*": {"equilibrium_position": [-1, 1], "stiffness_preset": [0.05, 0.4]}}


def arm(step=0.001, substeps=2, **keys):
    given = {
        "engine": "mujoco",
        "duration": 2.0,
        "modes": {"*": 6},
        "motor_substeps": 1,
        "references": {"*": SINE},
        "reference_ranges": RANGES,
        **keys,
    }
    return asrsim.make_scenario(EXAMPLES / "urdf" / "dof2_horizontal.urdf", step=step, substeps=substeps, **given)


def many(scenario, count=1, **options):
    return asrsim.Worlds(scenario, count, names=["link_position"], watched=False, compiled=True, **options)


def motion(scenario, seconds=0.6, **options):
    """Link positions (300, 2) every 2 ms, and the stride at each of these times."""
    with many(scenario, **options) as worlds:
        steps, rows = round(0.002 / scenario.step), []
        for _ in range(round(seconds / 0.002)):
            worlds.advance(steps)
            rows.append((worlds.links()[0][0].copy(), int(worlds.core.strides[0, 0])))
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])


def test_the_motion_has_second_order_and_nearly_the_error_of_all_substeps():
    truth, _ = motion(arm(0.0001, 4))
    errors = {}
    for step in (0.001, 0.0005):
        found, strides = motion(arm(step), adaptive=True)
        errors[step] = np.abs(found - truth).max()
        assert np.count_nonzero(np.diff(strides)) >= 3
        assert 0.1 < strides.mean() < 0.9
    assert errors[0.001] > 3.0 * errors[0.0005]
    assert errors[0.001] < 1.3 * np.abs(motion(arm())[0] - truth).max()
    assert errors[0.001] < 0.4 * np.abs(motion(arm(substeps=1))[0] - truth).max()


def test_a_spring_that_swings_between_stiff_and_soft_keeps_its_energy():
    """A change in every swing would feed energy into the swing, 7 % in 100 s: the stride stays short instead."""
    keys = {
        "engine": "mujoco",
        "duration": 5.0,
        "modes": {"*": 3},
        "initial": {"joint_1": 0.7},
        "gravity": [0, 0, 0],
        "references": {"*": {"equilibrium_position": 0.0, "stiffness_preset": 0.1}},
        "reference_ranges": {"*": {"equilibrium_position": [-0.1, 0.1], "stiffness_preset": [0.05, 0.2]}},
    }
    robot = EXAMPLES / "urdf" / "dof1_qbmove.urdf"
    free = asrsim.make_scenario(robot, step=0.001, substeps=2, **keys)
    prepared = asrsim.prepare(free).vary({"joint_1": {"damping": 0.0}})
    with many(prepared, adaptive=True) as worlds:
        stiffest, law = worlds.core._common.stiffest[1, 0], prepared.drives[0]
        peaks = []
        for _ in range(50):
            swing = []
            for _ in range(100):
                worlds.advance()
                swing.append(float(worlds.links()[0][0, 0]))
            peaks.append(max(swing))
        assert law.actuator.stiffness(max(swing), 0.1, -0.1, law.elastic) > stiffest
    assert peaks[-1] == pytest.approx(peaks[1], rel=2e-3)


def moved(scenario, count, calls, **options):
    """Positions (N, 2) after random references, with `calls` calls of `advance` for 20 steps each time."""
    chance = np.random.default_rng(0)
    with many(scenario, count, adaptive=True, **options) as worlds:
        strides = []
        for _ in range(30):
            for joint in worlds.joints:
                worlds.set_reference(joint, "equilibrium_position", chance.uniform(-1.0, 1.0, 4)[:count])
            for _ in range(calls):
                worlds.advance(20 // calls)
            strides.append(worlds.core.strides[:, 0].copy())
        assert 0.0 < np.mean(strides) < 1.0
        return worlds.links()[0]


def test_strides_do_not_depend_on_calls_threads_and_other_worlds():
    steady = arm(references={"*": {"equilibrium_position": 0.0, "stiffness_preset": 0.2}})
    whole = moved(steady, 4, 1)
    for found in (moved(steady, 4, 20), moved(steady, 4, 2, threads=2), moved(arm(), 4, 1), moved(steady, 1, 4)):
        assert np.array_equal(found, whole[: len(found)])


def test_a_restored_world_continues_in_its_stride():
    with many(arm(), 2, adaptive=True) as worlds:
        worlds.advance(60)
        before = worlds.snapshot()
        assert worlds.core.strides[0, 0] == 1
        worlds.advance(700)
        after = worlds.links()[0].copy()
        worlds.reset()
        worlds.restore(before)
        worlds.advance(700)
        assert np.array_equal(worlds.links()[0], after)


def test_worlds_whose_signals_jump_take_all_substeps():
    jump, found = {"equilibrium_position": {"step": {"at": 0.1, "to": 0.5}}}, []
    for adaptive in (True, False):
        with many(arm(references={"*": jump}), adaptive=adaptive) as worlds:
            worlds.advance(400)
            found.append(worlds.links()[0].copy())
    assert np.array_equal(*found)


def test_the_stiffness_of_a_world_with_other_parameters_is_its_own():
    """The third world is a little softer than what the longer stride resolves, the fourth a little stiffer."""
    still = arm(references={"*": {"equilibrium_position": 0.0, "stiffness_preset": 0.05}})
    with many(still, 4, adaptive=True) as worlds:
        spring = worlds.prepared.drives[0]
        ratio = worlds.core._common.stiffest[1, 0] / spring.actuator.stiffness(0.0, 0.05, -0.05, spring.elastic)
        numbers = {name: spring.values[name] for name in ("spring_k_1", "spring_k_2")}
        shares = (1.0, 0.1, 0.7 * ratio, 1.3 * ratio)
        worlds.reset(
            [asrsim.Start(parameters={"joint_1": {name: share * one for name, one in numbers.items()}}) for share in shares]
        )
        worlds.advance(300)
        assert worlds.core.strides[:, 0].tolist() == [1, 1, 1, 0]


def test_motors_are_observed_at_the_time_of_the_step():
    """The first steps have no longer strides: a stride shifts the times at which motors are stored."""
    with many(arm(), adaptive=True) as own, many(arm()) as full:
        own.advance(30)
        full.advance(30)
        assert own.core.strides[0, 0] == 1
        np.testing.assert_allclose(own.observe().motor_position, full.observe().motor_position, atol=2e-4)


@pytest.mark.parametrize(
    ("keys", "options", "words"),
    [
        ({"imperfections": {"sensors": {"*": {"delay": 0.002}}}}, {}, "without imperfect sensors"),
        ({"world": {"ground": True}}, {}, "without contacts"),
        ({"stepping": "euler"}, {}, "stepping leapfrog"),
        ({}, {"compiled": False}, "compiled loop"),
        ({}, {"watched": True, "names": ["link_position"]}, "without energies and stiffness. watched=False"),
        ({}, {"names": ["link_position", "stiffness"]}, "Record other quantities than stiffness"),
    ],
)
def test_what_needs_all_substeps_is_refused(keys, options, words):
    with pytest.raises(InputError, match=words):
        asrsim.Worlds(arm(**keys), 1, adaptive=True, **{"watched": False, **options})


def test_environments_that_adapt_are_those_of_one_alone():
    pytest.importorskip("gymnasium")
    both, one = asrsim.make_vec_env(arm(), 2, adaptive=True), asrsim.make_env(arm(), adaptive=True)
    many_seen, seen = both.reset(seed=0)[0], one.reset(seed=0)[0]
    for action in np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2, *one.action_space.shape)).astype(np.float32):
        many_seen, seen = both.step(action)[0], one.step(action[0])[0]
    assert np.array_equal(many_seen[0], seen)
    assert both.worlds.core.strides[:, 0].any()


def test_worlds_record_what_needs_no_energies_unless_told_otherwise():
    with asrsim.Worlds(arm(), 2, watched=False, adaptive=True) as worlds:
        worlds.advance(3)
        assert "link_position" in worlds.names
        assert "stiffness" not in worlds.names
