"""Order of convergence of a random run: error against the independent solution at the steps h, h/2 and h/4."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import asrsim
from asrsim.samples import Samples
from asrsim.simulation.run import simulate
from support.independent_ode import solve
from support.random_runs import RandomRun

Array = np.ndarray
ROUNDING = 1e-9
"""Error below which no order can be measured, rad or m."""
CHANCE = 0.01
"""Fraction of the error of a run. Below it, the error of links, motors or base may be small by chance."""


def errors(
    run: RandomRun, folder: Path, engine: str, truth: dict[str, Array], *, compiled: bool = False, **options: str
) -> Array:
    """Largest errors (3, 3) at the steps h, h/2 and h/4 (rows) of links, motors and base (columns), rad or m."""
    base = asrsim.make_scenario(run.write(folder), engine=engine, compiled=compiled, log_rate=100, **run.keys(), **options)
    found, scenario = [], base
    for finer in (1, 2, 4):
        result = simulate(scenario)
        assert result.samples is not None
        found.append(distances(run, result.samples, truth))
        scenario = replace(
            base, substeps=result.resolution.substeps * 2 if finer == 1 else (scenario.substeps or 1) * 2,
            motor_substeps=result.resolution.motor_substeps,
        )  # fmt: skip
    return np.array(found)


def distances(run: RandomRun, samples: Samples, truth: dict[str, Array]) -> list[float]:
    """Largest errors of links, motors and base, rad or m."""
    order = [samples.joints.index(joint.name) for joint in run.joints]
    links = np.abs(samples.values["link_position"][:, order] - truth["positions"]).max()
    driven = [j for j, joint in enumerate(run.joints) if joint.actuator and joint.mode > 3]
    motors = 0.0
    if driven:
        places = samples.values["motor_1_position"][:, order]
        motors = np.abs(places - truth["motors"])[:, driven].max()
    base = 0.0
    if not run.fixed:
        (pose,) = samples.bodies.values()
        turned = truth["base"][:, 3:] * np.sign(np.sum(truth["base"][:, 3:] * pose[:, 3:], axis=1))[:, None]
        base = max(np.abs(pose[:, :3] - truth["base"][:, :3]).max(), np.abs(pose[:, 3:] - turned).max())
    return [float(links), float(motors), float(base)]


def speed_and_truth(run: RandomRun) -> tuple[float, dict[str, Array]]:
    """Largest speed of a joint (at least 1 rad/s), and the independent solution."""
    times = np.arange(round(run.duration * 100) + 1) / 100.0
    # The torque of a spring with hysteresis has a corner wherever the deflection reverses.
    corners = any("hysteresis_torque" in joint.parameters for joint in run.joints)
    truth = solve(run, times, **({"tolerance": 1e-9, "longest": 2e-3} if corners else {}))
    return max(1.0, float(np.abs(truth["velocities"]).max())), truth


def speed_and_errors(run: RandomRun, folder: Path, engine: str, **options: Any) -> tuple[float, Array]:
    """Largest speed of a joint (at least 1 rad/s), and the result of `errors`."""
    speed, truth = speed_and_truth(run)
    return speed, errors(run, folder, engine, truth, **options)


def check(run: RandomRun, folder: Path, engines: list[str], *, order: float = 1.6) -> None:
    """Fail if an engine is far from the independent solution, or if its error does not fall with the order of the method.

    At the deflection limit of a spring and at the effort limit, the torque has a corner, which reduces the order slightly.
    """
    speed, truth = speed_and_truth(run)
    for engine in engines:
        found = errors(run, folder, engine, truth)
        assert found[0].max() < 5e-5 * speed, (engine, found)
        for coarse, fine in zip(found[0], found[2], strict=True):
            small = coarse < ROUNDING or (coarse < CHANCE * found[0].max() and fine < coarse)
            assert small or np.log2(coarse / max(fine, 1e-16)) / 2.0 > order, (engine, found)
