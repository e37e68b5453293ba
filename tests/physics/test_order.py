"""Second order at no cost: motions whose error is known from an independent solution, one of each kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from validation.fitting import orders
from validation.models import Body, chain, run
from validation.order import FASTEST, errors, jump_cases, smooth_cases
from validation.planar import Planar, solve

CASES = {case.name: case for case in (*smooth_cases(), *jump_cases())}
QUICK = (
    "double pendulum, free",
    "3 joints, mode 3, SEA swinging fast, damped",
    "2 joints, mode 1, PID on the link",
    "2 joints, mode 4, awas_ii",
    "2 joints, mode 6, qbmove",
    "2 joints, mode 6, bavs, jump off the grid",
    "2 joints, mode 3, external torque jumps off the grid",
)
"""One of each kind; the rest is in the slow tests of test_truth.py."""


@pytest.mark.parametrize("name", QUICK)
def test_the_error_falls_with_the_square_of_the_step(name: str) -> None:
    case = replace(CASES[name], duration=0.4)
    coarse, fine = errors(case, (FASTEST, FASTEST / 4.0))
    assert coarse < case.error
    assert orders([coarse, fine], 4.0)[0] > case.order


@pytest.mark.parametrize("stepping", ["euler", "toolbox"])
def test_the_older_schemes_are_of_first_order(stepping: str) -> None:
    case = replace(CASES["2 joints, mode 6, qbmove"], duration=0.4)
    coarse, fine = errors(case, (FASTEST, FASTEST / 4.0), stepping=stepping)
    assert 0.8 < orders([coarse, fine], 4.0)[0] < 1.2


def test_substeps_are_steps() -> None:
    """Four substeps of 1 ms err like a step of 0.25 ms."""
    case = CASES["2 joints, mode 3, SEA swinging fast"]
    fine = errors(case, (FASTEST, FASTEST / 4.0))[1]
    arguments = {"references": case.references, "parameters": case.parameters, "initial": case.initial, "duration": 0.6}
    split = run(chain(*case.bodies), mode=3, substeps=4, **arguments)
    small = run(chain(*case.bodies), mode=3, substeps=1, step=FASTEST / 4.0, **arguments)
    assert split.samples is not None
    assert small.samples is not None
    difference = np.abs(split.samples.values["link_position"] - small.samples.values["link_position"][::4])
    assert np.max(difference) < 0.05 * fine


def test_motor_substeps_keep_the_order() -> None:
    """A stiff preset on a light link: motors that are stepped finer than the world."""
    body = Body(actuator="qbmove", mass=0.5, reach=0.08, inertia=6e-4, damping=0.05)
    found = []
    for step in (1e-3, 2.5e-4, 1e-3 / 64.0):
        result = run(
            chain(body), mode=6, duration=0.3, step=step, substeps=1, motor_substeps=3,
            references={"equilibrium_position": 0.5, "stiffness_preset": 0.4},
            parameters={"motor_1_friction_torque": 0.0, "motor_2_friction_torque": 0.0},
        )  # fmt: skip
        assert result.samples is not None
        found.append(result.samples.values["link_position"][:: round(1e-3 / step), 0])
    coarse, fine = (float(np.max(np.abs(q - found[-1]))) for q in found[:2])
    assert orders([coarse, fine], 4.0)[0] > 1.7


# -- the tools of the checks -------------------------------------------------------------------------------------------


def test_the_independent_model_keeps_energy_and_knows_its_mass_matrix() -> None:
    bodies = (Body(mass=0.5, reach=0.08, inertia=6e-4), Body(mass=0.4, reach=0.07, inertia=5e-4, length=0.2))
    model = Planar(bodies=bodies)
    q = np.array([0.3, -0.7])
    outer = 0.4 * 0.07**2 + 5e-4
    cross = 0.4 * 0.1 * 0.07 * np.cos(-0.7)
    inner = 0.5 * 0.08**2 + 6e-4 + 0.4 * 0.1**2
    np.testing.assert_allclose(model.mass_matrix(q), [[inner + outer + 2 * cross, outer + cross], [outer + cross, outer]])
    result = run(chain(*bodies), initial=[1.0, 0.5], duration=0.5)
    still = (lambda t: 0.0,) * 3
    path = solve(result, bodies, gravity=9.81, inputs=[still] * 2, step=1e-4)
    speed = np.gradient(path, 1e-4, axis=0, edge_order=2)
    energies = [model.energy(path[k], speed[k]) for k in range(0, 5001, 500)]
    assert np.ptp(energies) < 1e-6
