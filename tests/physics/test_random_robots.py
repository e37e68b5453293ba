"""Random robots against the independent solution `support.independent_ode`, for all engines, bases, jumps and modes."""

from dataclasses import replace

import numpy as np
import pytest

import asrsim
from asrsim.simulation.run import simulate
from support.convergence import check
from support.random_runs import random_run
from validation.models import INSTALLED


# `test_two_engines.py` compares the engines, so one fixed and one floating robot in all engines are enough.
@pytest.mark.parametrize(
    ("seed", "fixed", "engines"),
    [(2, True, INSTALLED[:1]), (7, True, INSTALLED), (0, False, INSTALLED[:1]), (3, False, INSTALLED)],
)
def test_every_actuator_and_mode_at_second_order(tmp_path, seed, fixed, engines):
    check(random_run(seed, fixed=fixed), tmp_path, engines)


@pytest.mark.parametrize("fixed", [True, False])
def test_passive_trees_at_second_order(tmp_path, fixed):
    """Robots have only links, springs and damping, which the engines compute."""
    check(random_run(901, moving=6, fixed=fixed, passive=1.0, jumps=False), tmp_path, INSTALLED, order=1.9)


@pytest.mark.parametrize(("seed", "fixed"), [(105, False), (112, True)])
def test_optional_models_converge_at_second_order(tmp_path, seed, fixed):
    """One robot has electric motors with limits, hysteresis, moving motors at the start, and delayed commands."""
    check(random_run(seed, moving=3, fixed=fixed, extras=True), tmp_path, INSTALLED[:1], order=1.5)


@pytest.mark.parametrize(("seed", "fixed"), [(101, True), (123, False)])
def test_energies_balance_at_second_order(tmp_path, seed, fixed):
    """The work of the motors equals the energy of springs and links plus heat and losses, with all optional models."""
    run = random_run(seed, moving=3, fixed=fixed, extras=True, friction=True)
    base = asrsim.make_scenario(run.write(tmp_path), engine=INSTALLED[0], compiled=False, **run.keys())
    first = simulate(base)
    finer = replace(base, substeps=4 * first.resolution.substeps, motor_substeps=first.resolution.motor_substeps)
    left = [np.nanmax(np.abs(result.samples.values["energy_residual"])) for result in (first, simulate(finer))]
    assert left[0] < 1e-3
    assert np.log2(left[0] / left[1]) / 2.0 > 1.7
