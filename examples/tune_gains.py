"""Tune the gains of a motor controller with Optuna. One simulation is reset with new gains in every trial.

This needs Optuna, which asrsim does not install: pip install optuna

    python tune_gains.py scenarios/step_2dof.yaml
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import optuna

import asrsim

TRIALS = 60
BLOCK = 10
"""Number of steps between two evaluations of the joint error."""
GAINS = {"proportional": (0.05, 20.0), "derivative": (1e-4, 0.1)}


def main(path: Path) -> None:
    """Minimise the mean square error between joint positions and references."""
    scenario = asrsim.load_scenario(path)[0]
    with asrsim.Simulation(scenario) as simulation:
        joints, steps = simulation.joints, round(scenario.duration / scenario.step)

        time = BLOCK * scenario.step * np.arange(1, steps // BLOCK + 1)
        goals = np.array([scenario.references_of(joint)["equilibrium_position"].values(time) for joint in joints]).T

        def cost(trial: optuna.Trial) -> float:
            shares = {name: trial.suggest_float(name, *ends, log=True) for name, ends in GAINS.items()}
            gains = {f"controller_{motor}_{name}": value for motor in (1, 2) for name, value in shares.items()}
            simulation.reset(parameters=dict.fromkeys(joints, gains))
            errors = []
            try:
                for goal in goals:
                    simulation.advance(BLOCK)
                    errors.append(goal - simulation.observe().link_position)
            except asrsim.DivergenceError:
                raise optuna.TrialPruned from None
            return float(np.mean(np.square(errors)))

        study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=0))
        study.optimize(cost, n_trials=TRIALS)
    sys.stdout.write(f"best mean square error {study.best_value:.4g} with {study.best_params}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "scenarios" / "step_2dof.yaml")
