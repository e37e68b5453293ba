"""`asrsim ilc --next` on independently simulated robots that differ from their models: no setback comes without a warning."""

import os
import secrets

import pytest

from asrsim.learning.hardware import next_input
from asrsim.learning.prepared import learning_model
from support.lessons import inputs_in, plant_of, record
from support.soft_arm import differing, random_arm

pytestmark = pytest.mark.slow
ROBOTS, TRIALS = 32, 3
LIMIT = 1.2
"""Ratio of a trial's error to the best error before it, above which the trial is a setback."""


def test_no_trial_exceeds_the_announced_limit_without_a_warning(tmp_path):
    """Masses, stiffnesses and losses are 15 to 40 % off; 1 mrad of noise. The motion is learned down to the noise, where each
    trial has a warning; few trials above the noise have one.
    """
    first = int(os.environ.get("ASRSIM_SEED") or secrets.randbelow(1_000_000))
    print(f"repeat with ASRSIM_SEED={first}")
    setbacks, needless, final = [], [], []
    for seed in range(first, first + ROBOTS):
        arm, motion, duration = random_arm(seed)
        folder = tmp_path / str(seed)
        plant, robot = plant_of(folder, arm, motion, duration, tolerance=1e-4), differing(arm, seed)
        inputs, errors, warned, ratios = learning_model(plant).guess, [], False, []
        for number in range(1 + TRIALS):
            error = record(folder / f"{number}.csv", plant, robot, inputs, seed=number)
            worse = bool(errors) and error > LIMIT * min(errors)
            if errors:
                ratios.append(f"{error / min(errors):.3f}{' (announced)' if warned else ''}")
            if worse and not warned:
                setbacks.append((seed, number, min(errors), error))
            if warned and not worse and min(errors) > 3e-3:
                needless.append((seed, number))
            errors.append(error)
            if number < TRIALS:
                warned = next_input(plant, folder, folder / f"{number}.csv").warning is not None
                inputs = inputs_in(folder / "next.csv", plant)
        final.append(min(errors))
        print(f"{seed}: first error {errors[0]:.2e}, best {min(errors):.2e} rad; over the best before: {', '.join(ratios)}")
    print(f"needless warnings: {needless}; largest errors of the best trials: {sorted(final)}")
    assert not setbacks
    assert len(needless) <= 3
    assert sorted(final)[ROBOTS // 2] < 2e-3
