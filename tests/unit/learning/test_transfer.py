"""Transfer on a plant whose answer to each perturbation is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asrsim.learning import draw_plants, transfer
from asrsim.scenario.learning_keys import PlantSet, PlantSpread

REFERENCE = np.linspace(0.0, 1.0, 11)[:, None]
OTHERS = PlantSet(seed=7, draws=400, spread=PlantSpread(mass=0.1, damping=0.2, delay=0.01))


def report(outputs=None):
    """The output is off by the mass's relative change, and a little by the delay."""
    draws = draw_plants(OTHERS, ("one",))
    found = [REFERENCE * (1 + draw["mass.one"]) - 0.5 * draw["delay"] for draw in draws]
    return transfer(REFERENCE, draws, outputs or found, joints=("one",), tolerance=0.05)


def test_half_the_spread_is_within_half_the_tolerance():
    assert report().within == pytest.approx(0.5, abs=0.07)


def test_quantiles_are_those_of_the_largest_error():
    found = report().quantiles((0.5, 1.0))
    assert found[0.5] == pytest.approx(0.05, abs=0.01)
    assert found[1.0] <= 0.1 + 0.5 * 0.01


def test_the_same_seed_gives_the_same_plants_and_more_draws_only_add():
    few, many = draw_plants(OTHERS, ("one",), 5), draw_plants(OTHERS, ("one",), 20)
    assert many[:5] == few
    assert draw_plants(replace(OTHERS, seed=8), ("one",), 5) != few


def test_draws_stay_within_what_was_stated():
    draws = draw_plants(OTHERS, ("one",))
    masses = np.array([draw["mass.one"] for draw in draws])
    delays = np.array([draw["delay"] for draw in draws])
    assert np.abs(masses).max() <= 0.1
    assert delays.min() >= 0.0
    assert delays.max() <= 0.01
    normal = draw_plants(replace(OTHERS, distribution="normal"), ("one",), 2000)
    assert np.std([draw["mass.one"] for draw in normal]) == pytest.approx(0.1, rel=0.06)


def test_a_diverged_draw_is_outside_and_infinite():
    found = report([REFERENCE * np.nan if index < 40 else REFERENCE for index in range(400)])
    assert found.within == 0.9
    assert found.quantiles((1.0,))[1.0] == np.inf


def test_the_scenario_s_block_spreads_every_joint_on_its_own():
    spread = PlantSpread(parameters={"spring_k_1": 0.1}, mass=0.05, friction=0.5, delay=0.002, added_friction=0.03)
    (draw,) = draw_plants(PlantSet(spread=spread), ("one", "two"), 1)
    joints = {f"{what}.{joint}" for what in ("mass", "friction", "added_friction") for joint in ("one", "two")}
    assert set(draw) == joints | {"parameters.one.spring_k_1", "parameters.two.spring_k_1", "delay"}
    assert len(set(draw.values())) == len(draw)
