"""A prediction of a motion that was not fitted: it fails since the fitted motions show too little, or since the model lacks
something.
"""

from contextlib import ExitStack

import numpy as np
import pytest

from asrsim.identification.problem import set_up, solve
from asrsim.identification.task import task_of
from asrsim.identification.transfer import failed_predictions
from support.identify_files import BENCH, bench, save

TIME = np.arange(0.0, 4.0, 0.02)
"""s."""


def spring(folder, name, reach, power, *, noise=1e-3):
    """Recording of a spring on a bench: 4 N m/rad, and 100 N m / rad^power times a power of the deflection."""
    bent = reach * np.sin(3.0 * TIME)
    torque = 4.0 * bent + 100.0 * np.sign(bent) * np.abs(bent) ** power
    return save(folder / name, BENCH, TIME, bent, torque + noise * np.random.default_rng(len(name)).normal(size=len(TIME)))


@pytest.mark.parametrize(
    ("power", "said"), [(3, "too little information for its motion"), (2, "an effect that the model lacks")]
)
def test_a_failed_prediction_says_whether_a_fit_to_the_motion_would_help(tmp_path, power, said):
    """A small deflection does not show a cubic term; no cubic term explains a quadratic spring."""
    small, large = spring(tmp_path, "a.csv", 0.02, power), spring(tmp_path, "bb.csv", 0.4, power)
    free = ["joint_1.spring_stiffness", "joint_1.spring_cubic"]
    with ExitStack() as stack:
        problem = set_up(task_of(bench(tmp_path, 4.0), [small], validate=[large], free=free), stack).problem
        x = solve(problem, np.zeros(2))
        (text,) = failed_predictions(problem, x)
        assert text.startswith("bb.csv: if this recording is also fitted, ")
        assert said in text


def test_no_more_than_the_whole_error_remains(tmp_path, monkeypatch):
    """A fit to all recordings may predict one of them worse than before."""
    errors = iter([{1: 0.10}, {1: 0.15}])
    monkeypatch.setattr("asrsim.identification.transfer._errors", lambda *_: next(errors))
    small, large = spring(tmp_path, "a.csv", 0.1, 3), spring(tmp_path, "bb.csv", 0.4, 3)
    with ExitStack() as stack:
        task = task_of(bench(tmp_path, 4.0), [small], validate=[large], free=["joint_1.spring_stiffness"])
        (text,) = failed_predictions(set_up(task, stack).problem, np.zeros(1))
    assert text.startswith("bb.csv: if this recording is also fitted, 100 % of its error remain")


def test_nothing_is_said_without_a_recording_that_is_only_predicted(tmp_path):
    with ExitStack() as stack:
        task = task_of(bench(tmp_path, 4.0), [spring(tmp_path, "a.csv", 0.2, 3)], free=["joint_1.spring_stiffness"])
        problem = set_up(task, stack).problem
        assert list(failed_predictions(problem, np.zeros(1))) == []
