"""Learning on independently simulated robots that differ from their models, and the reachability verdict for weak arms."""

from dataclasses import replace

import numpy as np
import pytest

from asrsim.learning import iterate
from asrsim.learning.hardware import next_input
from asrsim.learning.prepared import learning_model
from support.lessons import inputs_in, learned, plant_of, play, record
from support.soft_arm import perturbed, random_arm

pytestmark = pytest.mark.slow


def test_six_trials_learn_a_robot_and_setbacks_give_warnings(tmp_path):
    """Masses and stiffnesses differ by up to 25 %, losses by 50 %; delay 10 ms, noise 1 mrad. 15 of 16 errors are < 5 mrad."""
    good = 0
    for seed in range(100, 116):
        arm, motion, duration = random_arm(seed)
        folder = tmp_path / str(seed)
        plant, robot = plant_of(folder, arm, motion, duration), perturbed(arm, seed)
        inputs = learning_model(plant).guess
        errors, warned = [], False
        for number in range(6):
            errors.append(record(folder / f"{number}.csv", plant, robot, inputs, seed=number))
            assert warned or errors[-1] <= max(1.2 * min(errors), 0.005), (seed, errors)
            if errors[-1] <= 0.005:
                good += 1
                break
            warned = next_input(plant, folder, folder / f"{number}.csv").warning is not None
            inputs = inputs_in(folder / "next.csv", plant)
    assert good >= 15


def test_reachability_verdict_agrees_with_an_independent_robot(tmp_path):
    """Motor limits are 0.6 to 1.3 times the largest torque of the motion: 95 % of the verdicts are right."""
    right, reached = [], []
    for seed in range(200, 220):
        arm, motion, duration = random_arm(seed)
        model = learning_model(plant_of(tmp_path / str(seed), arm, motion, duration))
        scores = [
            max(d.score for d in model.inverse.demands if d.joint == j and d.what == "motor torque") for j in model.plant.joints
        ]
        factor = np.random.default_rng(seed).uniform(0.6, 1.3)
        limits = arm.values("motor_1_max_torque") * np.array(scores) * factor
        joints = zip(arm.joints, limits.tolist(), strict=True)
        weak = replace(arm, joints=tuple({**joint, "motor_1_max_torque": limit} for joint, limit in joints))
        plant = plant_of(tmp_path / f"weak_{seed}", weak, motion, duration)
        prepared, found = learned(plant)
        true = iterate(
            prepared.problem,
            lambda inputs, weak=weak, plant=plant: play(weak, plant, inputs),
            prepared.settings,
            law=prepared.law,
        )
        right.append(prepared.reach(found).startswith("within") == true.converged)
        reached.append(true.converged)
    assert 3 <= sum(reached) <= 17
    assert np.mean(right) >= 0.95, (right, reached)
