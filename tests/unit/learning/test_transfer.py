"""Transfer on a plant whose answer to each perturbation is known."""

from __future__ import annotations

import numpy as np
import pytest

from asrsim.learning import Spread, draw_plants, transfer
from asrsim.learning.transfer import correlation_interval
from asrsim.scenario.learning_keys import PlantSet, PlantSpread

REFERENCE = np.linspace(0.0, 1.0, 11)[:, None]
SPREAD = Spread(factors={"gain": 0.1, "idle": 0.2, "delay": 0.01})


def outputs_of(draws):
    """The output is off by the gain's relative change, and a little by the delay."""
    return [REFERENCE * (1 + draw["gain"]) - 0.5 * draw["delay"] for draw in draws]


def report(count=400, tolerance=0.05):
    return transfer(REFERENCE, draw_plants(SPREAD, count, 7), outputs_of, joints=("one",), tolerance=tolerance)


def test_half_the_spread_is_within_half_the_tolerance():
    assert report().within == pytest.approx(0.5, abs=0.07)


def test_quantiles_are_those_of_the_largest_error():
    found = report().quantiles((0.5, 1.0))
    assert found[0.5] == pytest.approx(0.05, abs=0.01)
    assert found[1.0] <= 0.1 + 0.5 * 0.01


def test_the_factor_that_matters_comes_first_and_an_idle_one_does_not_matter():
    ranked = {item.factor: item for item in report().influences}
    assert next(iter(ranked)) == "gain"
    assert abs(ranked["gain"].regression) > 0.9
    assert abs(ranked["idle"].regression) < 0.1
    assert abs(ranked["idle"].rank_correlation) < 0.15


def test_the_same_seed_gives_the_same_plants_and_more_draws_only_add():
    few, many = draw_plants(SPREAD, 5, 3), draw_plants(SPREAD, 20, 3)
    assert many[:5] == few
    assert draw_plants(SPREAD, 5, 4) != few


def test_draws_stay_within_what_was_stated():
    draws = draw_plants(SPREAD, 500, 0)
    gains = np.array([draw["gain"] for draw in draws])
    delays = np.array([draw["delay"] for draw in draws])
    assert np.abs(gains).max() <= 0.1
    assert delays.min() >= 0.0
    assert delays.max() <= 0.01
    normal = draw_plants(Spread(factors={"gain": 0.1}, distribution="normal"), 2000, 0)
    assert np.std([draw["gain"] for draw in normal]) == pytest.approx(0.1, rel=0.06)


def test_a_diverged_draw_is_outside_and_named_infinite():
    def diverging(draws):
        return [np.full_like(REFERENCE, np.nan if index == 0 else 0.0) + REFERENCE for index in range(len(draws))]

    found = transfer(REFERENCE, draw_plants(SPREAD, 10, 0), diverging, joints=("one",), tolerance=0.1)
    assert found.within == 0.9
    assert found.quantiles((1.0,))[1.0] == np.inf


def test_the_scenario_s_block_spreads_every_joint_on_its_own():
    differences = PlantSpread(
        parameters={"spring_k_1": 0.1}, mass=0.05, friction=0.5, delay=0.002, added_friction=0.03, added_damping=0.04
    )
    spread = Spread.of(PlantSet(distribution="normal", spread=differences), ("one", "two"))
    assert spread.distribution == "normal"
    assert spread.factors == {
        "parameters.one.spring_k_1": 0.1,
        "parameters.two.spring_k_1": 0.1,
        "mass.one": 0.05,
        "mass.two": 0.05,
        "friction.one": 0.5,
        "friction.two": 0.5,
        "added_friction.one": 0.03,
        "added_friction.two": 0.03,
        "added_damping.one": 0.04,
        "added_damping.two": 0.04,
        "delay": 0.002,
    }


@pytest.mark.parametrize("strength", [0.0, 0.6])
def test_intervals_of_rank_correlations_hold_the_truth_as_often_as_they_say(strength):
    """2000 samples of 10 pairs from a normal distribution, whose rank correlation is known (Pearson 1907)."""
    generator = np.random.default_rng(3)
    one = generator.standard_normal((2000, 10))
    other = strength * one + np.sqrt(1.0 - strength**2) * generator.standard_normal(one.shape)
    ranks = [values.argsort(axis=1).argsort(axis=1) - 4.5 for values in (one, other)]
    found = (ranks[0] * ranks[1]).sum(axis=1) / (ranks[0] ** 2).sum(axis=1)
    truth = 6.0 / np.pi * np.arcsin(0.5 * strength)
    intervals = np.array([correlation_interval(float(value), 10, 0.95) for value in found])
    held = np.mean((intervals[:, 0] <= truth) & (truth <= intervals[:, 1]))
    assert 0.93 < held < 0.975


@pytest.mark.parametrize(("count", "told"), [(3, 0), (6, 0), (7, 0), (8, 3), (30, 3)])
def test_few_draws_tell_nothing_of_many_factors(count, told):
    """Three factors: a regression on so many needs twice as many draws, and two."""
    assert len(report(count=count).influences) == told
