"""Intervals where slopes have corners, encoders have steps, and starts were measured."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from asrsim.identification.intervals import with_faint_directions
from asrsim.identification.noise import quantum_of


def test_a_null_is_one_though_a_column_was_taken_across_a_corner():
    time = np.linspace(0.0, 1.0, 200)
    told = np.stack([np.sin(7.0 * time), time], axis=1) * 1e4
    # Two entries that show in their sum only, and one that shows by itself.
    true = np.column_stack([told[:, 0], told[:, 0], told[:, 1]])
    residuals = _Linear(true)
    wrong = true.copy()
    wrong[:, 0] *= 1.02
    wrong[:, 1] += 40.0 * np.cos(30.0 * time)

    mended = with_faint_directions(residuals, np.zeros(3), wrong, np.arange(3))
    null = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    assert np.linalg.norm(wrong @ null) > 100.0
    assert np.linalg.norm(mended @ null) < 1e-3
    # What is told stays so.
    assert np.linalg.norm(mended[:, 2]) == pytest.approx(np.linalg.norm(true[:, 2]), rel=1e-3)


class _Linear:
    layout = SimpleNamespace(bounds=(np.full(3, -9.0), np.full(3, 9.0)))

    def __init__(self, slopes) -> None:
        self.slopes = slopes

    def __call__(self, x):
        return self.slopes @ x


@pytest.mark.parametrize(("noise", "told"), [(0.0, True), (0.2, True), (3.0, False)])
def test_a_fast_motion_never_stands_still_on_the_steps_of_its_encoder(noise: float, told: bool) -> None:
    time, quantum = np.arange(0.0, 6.0, 0.002), 2.0 * np.pi / 4096
    values = 0.8 * np.sin(6.0 * time) + noise * quantum * np.random.default_rng(0).normal(size=len(time))
    found = quantum_of(quantum * np.round(values / quantum))
    assert found == (pytest.approx(quantum) if told else 0.0)
