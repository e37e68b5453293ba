"""Predictions of motions that were not fitted: their errors, and why they fail."""

import re
from contextlib import ExitStack
from fnmatch import fnmatch
from itertools import chain, repeat

import numpy as np
import pytest

from asrsim.identification import identify
from asrsim.identification.judge import channel_fits
from asrsim.identification.problem import differences, set_up, solve
from asrsim.identification.task import task_of
from asrsim.identification.transfer import failed_predictions, transfers
from asrsim.identification.write import fit_data
from support.identify_files import BENCH, SEA, bench, record, save, write

TIME = np.arange(0.0, 4.0, 0.02)
"""s."""


def spring(folder, name, reach, power, *, noise=1e-3, offset=0.0):
    """Recording of a spring on a bench: 4 N m/rad, and 100 N m / rad^power times a power of the deflection."""
    bent = reach * np.sin(3.0 * TIME)
    torque = 4.0 * bent + 100.0 * np.sign(bent) * np.abs(bent) ** power + offset
    return save(folder / name, BENCH, TIME, bent, torque + noise * np.random.default_rng(len(name)).normal(size=len(TIME)))


def explained(problem, x):
    """Explanations of the predictions with a parameter vector."""
    return list(
        failed_predictions(problem, x, transfers(problem, x, channel_fits(problem, differences(problem.everything, x), x)))
    )


@pytest.mark.parametrize(
    ("power", "offset", "said"),
    [
        (3, 0.0, "bb.csv: if this recording is also fitted, its error falls to * too little information for its motion"),
        (2, 0.0, "bb.csv: if this recording is also fitted, * an effect that the model lacks"),
        (
            3,
            0.7,
            "bb.csv: its error falls to * if joint_1.elastic_torque_1.offset is 0.7 N m in this recording instead of 0 N m",
        ),
    ],
)
def test_a_failed_prediction_says_why(tmp_path, power, offset, said):
    """A small deflection does not show a cubic term; no cubic term explains a quadratic spring, or an offset of the sensor."""
    small, large = (
        spring(tmp_path, "a.csv", 0.4 if offset else 0.02, power),
        spring(tmp_path, "bb.csv", 0.4, power, offset=offset),
    )
    free = ["joint_1.spring_stiffness", "joint_1.spring_cubic"]
    with ExitStack() as stack:
        problem = set_up(task_of(bench(tmp_path, 4.0), [small], validate=[large], free=free), stack).problem
        (text,) = explained(problem, solve(problem, np.zeros(2)))
    assert fnmatch(text, said + "*"), text


def test_a_predicted_recording_has_its_own_start_zero_offset_and_delay(tmp_path):
    """Two motions of one robot: the second begins in motion, its sensor has another zero offset and another delay."""
    guess = {**SEA, "tags": "<spring_k>5</spring_k>"}
    true = write(tmp_path, "true", SEA, "{equilibrium_position: {chirp: {amplitude: 0.3, from: 0.5, to: 6, duration: 2}}}")
    record(true, tmp_path / "a.csv", offset=0.05, late=6)
    second = record(true, tmp_path / "b.csv", offset=-0.03, late=2, seed=1)
    head, *rows = second.read_text().splitlines()
    later = np.array([row.split(",") for row in rows], float)[350:]
    save(second, head, later[:, 0] - later[0, 0], *later[:, 1:].T)
    free = ["joint_1.spring_stiffness", "joint_1.damping", *(f"joint_1.link_position.{what}" for what in ("offset", "delay"))]
    result = identify(write(tmp_path, "lab", guess), [tmp_path / "a.csv"], validate=[second], free=free)
    (one,) = result.transfers
    assert one.ratio == pytest.approx(1.0, abs=0.15)
    (plain,) = fit_data(result)["predictions"]
    assert plain["text"].startswith(f"b.csv was predicted, not fitted: its RMS error is {one.ratio:.2g} times")
    (own,) = [text for text in result.remarks if "belong to the recording" in text]
    found = {key: float(value) for key, value in re.findall(r"joint_1\.(\S+) = (\S+)", own)}
    assert found["link_position.offset"] == pytest.approx(-0.03, abs=5e-4)
    assert found["link_position.delay"] == pytest.approx(0.002, abs=2e-4)
    assert found["initial_velocity"] > 1.0


def test_no_more_than_the_whole_error_remains(tmp_path, monkeypatch):
    """A fit to all recordings may predict one of them worse than before."""
    errors = chain([{1: 0.10}, {1: 0.15}], repeat({1: 1.0}))
    monkeypatch.setattr("asrsim.identification.transfer._errors", lambda *_: next(errors))
    small, large = spring(tmp_path, "a.csv", 0.1, 3), spring(tmp_path, "bb.csv", 0.4, 3)
    with ExitStack() as stack:
        task = task_of(bench(tmp_path, 4.0), [small], validate=[large], free=["joint_1.spring_stiffness"])
        (text,) = explained(set_up(task, stack).problem, np.zeros(1))
    assert text.startswith("bb.csv: if this recording is also fitted, 100 % of its error remain")


def test_nothing_is_said_without_a_recording_that_is_only_predicted(tmp_path):
    with ExitStack() as stack:
        task = task_of(bench(tmp_path, 4.0), [spring(tmp_path, "a.csv", 0.2, 3)], free=["joint_1.spring_stiffness"])
        assert explained(set_up(task, stack).problem, np.zeros(1)) == []
