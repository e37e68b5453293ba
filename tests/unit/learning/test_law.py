"""Iterative learning control on plants whose answer is known: the law, its convergence, its stops, its state."""

import math
from dataclasses import replace

import numpy as np
import pytest

from asrsim.errors import InputError
from asrsim.learning import FixedGain, LearningProblem, iterate, zero_phase
from asrsim.learning.figure import learning_charts
from asrsim.learning.state import LearningState, load_state, motion_basis, save_state
from asrsim.scenario import load_scenario
from asrsim.scenario.goals import Learning
from asrsim.signals.pieces import Constant
from support.paths import EXAMPLES

STEP = 1e-3
TIME = np.arange(2001) * STEP
SHARE = np.array([0.4, 0.7])
"""Fraction of the input that reaches each joint of the static plant."""


def reference():
    s = TIME / TIME[-1]
    return 0.8 * np.outer(10 * s**3 - 15 * s**4 + 6 * s**5, [1.0, 0.5])


def problem(first_guess=0.0):
    wanted = reference()
    return LearningProblem(joints=("one", "two"), time=TIME, reference=wanted, first_guess=np.full_like(wanted, first_guess))


def settings(gains=(0.5, 0.5), **changes):
    joint_gains = dict(zip(("one", "two"), gains, strict=False))
    given = {"law": "paper", "gain_decay": None, "tolerance": 1e-3, **changes}
    return Learning(trajectory={"one": Constant(value=0.0)}, joint_gains=joint_gains, **given)


def static_plant(inputs):
    return inputs * SHARE


def learn(problem, simulate, settings, on_trial=None, **options):
    return iterate(problem, simulate, settings, on_trial, law=FixedGain(problem, settings), **options)


def test_without_options_the_update_equals_equation_13_bit_for_bit():
    generator = np.random.default_rng(1)
    inputs, outputs = generator.normal(size=(2, len(TIME), 2))
    trial = problem().trial(3, inputs, outputs)
    following = FixedGain(problem(), settings(gain_decay=10.0)).propose([trial])
    assert np.array_equal(following, inputs + 0.5 * math.exp(-3 / 10) * (reference() - outputs))


def test_errors_of_a_static_plant_shrink_by_one_minus_gain():
    result = learn(problem(), static_plant, settings())
    assert result.converged
    for trial in result.trials:
        expected = np.abs(reference()).max(axis=0) * (1 - SHARE * 0.5) ** trial.number
        assert trial.largest == pytest.approx(expected, rel=1e-12)
    assert max(result.trials[-1].largest) <= 1e-3 < max(result.trials[-2].largest)


def test_the_picture_of_learning_shows_the_best_trial_of_each_joint():
    result = learn(problem(), static_plant, settings(max_iterations=2))
    rows = learning_charts(replace(problem(), units=("rad", "m")), result, settings())
    assert [charts[0].head for charts in rows] == list(problem().joints)
    assert [(position.unit, given.unit) for _, position, given in rows] == [("rad", "rad"), ("m", "m")]
    for column, (errors, position, given) in enumerate(rows):
        norm, own = errors.lines
        assert own.x.tolist() == norm.x.tolist() == [trial.number for trial in result.trials]
        assert own.y.tolist() == [trial.largest[column] for trial in result.trials]
        assert norm.y.tolist() == [trial.norm for trial in result.trials]
        (near,), desired = position.bands, position.lines[-1]
        wanted = np.interp(desired.x, TIME, reference()[:, column])
        np.testing.assert_allclose([near.low, desired.y, near.high], wanted + 1e-3 * np.array([[-1], [0], [1]]), atol=1e-9)
        for chart, values in ((position, result.best.outputs), (given, result.best.inputs)):
            (best,) = [line for line in chart.lines if "best trial" in line.label]
            assert best.y[-1] == values[-1, column]


def test_learning_that_makes_things_worse_stops_and_says_where():
    result = learn(problem(), static_plant, settings(gains=(0.5, 3.5), patience=3))
    assert result.outcome == "growing"
    assert "grown in 3 iterations in a row" in result.reason
    assert "two" in result.reason
    assert result.iterations == 4  # the other joint's error hides the first growth
    assert result.best.number < result.iterations


def test_a_diverged_simulation_ends_the_learning():
    result = learn(problem(), lambda inputs: np.full_like(inputs, np.nan), settings())
    assert (result.outcome, result.iterations) == ("growing", 0)


def test_the_learning_filter_has_no_delay_and_halves_its_cutoff():
    time = np.arange(20001) * STEP
    for frequency, amplitude in ((0.5, 1.0), (5.0, 0.5), (50.0, 0.0)):
        wave = np.sin(2 * np.pi * frequency * time)[:, None]
        filtered = zero_phase(wave, 5.0, 2, STEP)
        assert filtered[5000:15000] == pytest.approx(amplitude * wave[5000:15000], abs=1e-3)


def state_of(problem):
    return LearningState(
        trials=(problem.trial(0, problem.first_guess, problem.reference),), recordings=("a",), changes={"delay": 0.01}
    )


def test_a_state_is_read_for_its_own_motion_only(tmp_path):
    path = tmp_path / "state.npz"
    save_state(path, motion_basis(problem(0.2)), state_of(problem(0.2)))
    found = load_state(path, motion_basis(problem(0.1)), problem(0.1))
    assert (found.recordings, found.changes) == (("a",), {"delay": 0.01})
    for changed in ({"reference": 2.0 * reference()}, {"time": 2.0 * TIME}, {"joints": ("two", "one")}):
        other = replace(problem(), **changed)
        with pytest.raises(InputError, match="changed: the motion"):
            load_state(path, motion_basis(other), other)


def test_a_compressed_state_is_refused_before_it_is_unpacked(tmp_path):
    path = tmp_path / "state.npz"
    save_state(path, {}, state_of(problem()))
    np.savez_compressed(path, **{**dict(np.load(path)), "inputs": np.zeros((10**6, 1, 1))})
    with pytest.raises(InputError, match=r"state\.npz.*would unpack to 7\.6"):
        load_state(path, {}, problem())


GROWTH = {
    "a creep": ([1.0, 1.05, 1.08], False),
    "growth": ([1.0, 1.05, 1.2], True),
    "up and down": ([1.0, 1.2, 1.1], False),
    "once": ([1.0, 1.2], False),
    "after the best": ([2.0, 1.0, 1.05, 1.2], True),
}


@pytest.mark.parametrize(("worst", "ends"), GROWTH.values(), ids=GROWTH)
def test_fixed_gains_stop_after_two_significant_increases_of_the_error(worst, ends):
    given = LearningProblem(joints=("one",), time=np.arange(2.0), reference=np.zeros((2, 1)), first_guess=np.zeros((2, 1)))
    trials = [given.trial(number, np.zeros((2, 1)), np.full((2, 1), error)) for number, error in enumerate(worst)]
    found = FixedGain(given, settings()).verdict(trials, 2)
    assert (found is not None) == ends


@pytest.mark.parametrize("cutoff", [0.5, 2.0])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_the_filter_keeps_a_ramp_to_its_ends(cutoff, order):
    """If the padding were shorter than the filter's memory, its transient would remain in the first samples."""
    time = np.arange(0, 20, 0.005)
    ramp = np.column_stack([time, 3 - 0.5 * time])
    assert np.abs(zero_phase(ramp, cutoff, order, 0.005) - ramp).max() < 1e-3 / cutoff


@pytest.mark.parametrize(("decay", "found"), [("none", None), ("3.5", 3.5)])
def test_a_scenario_states_the_decay_of_the_gain_or_none(decay, found):
    scenarios = load_scenario(EXAMPLES / "scenarios" / "ilc_2dof.yaml", overrides=[f"ilc.gain_decay={decay}"])
    assert {one.learning.gain_decay for one in scenarios} == {found}
