"""Pieces of designed motions."""

import numpy as np
import pytest

from asrsim.designs.motion import chirp, fresh, joined, step, varied
from asrsim.designs.run import altered
from support.identify_files import modelled

PRESETS, TIME = np.array([False, True]), 1e-3 * np.arange(2000)


@pytest.mark.parametrize("seed", range(5))
def test_every_piece_stays_in_its_range_and_begins_and_ends_at_rest(seed):
    generator = np.random.default_rng(seed)
    piece = fresh(generator, PRESETS).scaled(np.full((2, 8), generator.uniform(0.5, 9.0)))
    for one in (piece, varied(piece, generator)):
        values = one.values(TIME, 2.0)
        assert one.numbers.min() >= 0.0
        assert max(one.numbers.max(), np.abs(values).max()) <= 1.0
        assert np.abs(np.diff(values)).max() < 0.5
        np.testing.assert_allclose(values[:, [0, 1, -2, -1]], 0.0, atol=5e-3)
    assert not np.array_equal(varied(piece, generator).numbers, piece.numbers)


def test_a_chirp_sweeps_its_frequencies_geometrically():
    swept = chirp(PRESETS, 1.0, 8.0, preset=-1.0).values(TIME, 2.0)
    turns = np.count_nonzero(np.diff(np.sign(swept[0][swept[0] != 0.0])))
    assert turns == pytest.approx(2.0 * 2.0 * (8.0 - 1.0) / np.log(8.0), abs=2)
    np.testing.assert_allclose(swept[1][500:1700], -1.0)


def test_a_step_rises_in_10_ms_and_returns_at_the_end():
    moved, preset = step(PRESETS).values(TIME, 2.0)
    np.testing.assert_allclose(moved[[0, 5, 10, 1000, 1700]], [0.0, 0.15, 0.3, 0.3, 0.3])
    assert not preset.any()


def test_joined_pieces_keep_their_values():
    pieces = [chirp(PRESETS, 1.0, 2.0), step(PRESETS)]
    motion = joined(pieces, 1e-3, 4001)
    for number, piece in enumerate(pieces):
        np.testing.assert_array_equal(motion[:, 2000 * number : 2000 * (number + 1)], piece.values(TIME, 2.0))


@pytest.mark.parametrize("corner", [True, False])
def test_parameters_of_further_robots_differ_by_a_factor_of_two_at_most(corner):
    layout = modelled(lambda _: None, 4, 10).layout
    robots = [altered(layout, np.random.default_rng(seed), corner=corner) for seed in range(9)]
    factors = np.abs(
        np.log2([[one.value(at) / one.value(0.0) for one, at in zip(layout.entries, x, strict=True)] for x in robots])
    )
    assert np.isclose(factors, 1.0).all() == corner
    assert factors.max() <= 1.0 + 1e-12
