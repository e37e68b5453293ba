"""Order of convergence of a random run: error against the independent solution at the steps h, h/2 and h/4."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import asrsim
from asrsim.samples import Samples
from asrsim.simulation.run import simulate
from support.independent_ode import solve
from support.random_runs import RandomRun

Array = np.ndarray


def truth_of(run: RandomRun) -> tuple[float, dict[str, Array]]:
    """Largest speed of a joint (at least 1 rad/s), and the independent solution."""
    times = np.arange(round(run.duration * 100) + 1) / 100.0
    # The torque of a spring with hysteresis has a corner wherever the deflection reverses.
    corners = any("hysteresis_torque" in joint.parameters for joint in run.joints)
    truth = solve(run, times, **({"tolerance": 1e-9, "longest": 2e-3} if corners else {}))
    return max(1.0, float(np.abs(truth["velocities"]).max())), truth


def errors(
    run: RandomRun, truth: dict[str, Array], folder: Path, engine: str, *, compiled: bool = False, **options: str
) -> list[float]:
    """Largest errors of links, motors and base at the steps h, h/2 and h/4, rad or m."""
    base = asrsim.make_scenario(run.write(folder), engine=engine, compiled=compiled, log_rate=100, **run.keys(), **options)
    found, scenario = [], base
    for finer in (1, 2, 4):
        result = simulate(scenario)
        assert result.samples is not None
        found.append(error(run, result.samples, truth))
        scenario = replace(
            base,
            substeps=result.resolution.substeps * 2 if finer == 1 else (scenario.substeps or 1) * 2,
            motor_substeps=result.resolution.motor_substeps,
        )
    return found


def error(run: RandomRun, samples: Samples, truth: dict[str, Array]) -> float:
    """Largest error of links, motors and base, rad or m."""
    order = [samples.joints.index(joint.name) for joint in run.joints]
    found = [samples.values["link_position"][:, order] - truth["positions"]]
    driven = [j for j, joint in enumerate(run.joints) if joint.actuator and joint.mode > 3]
    if driven:
        found.append((samples.values["motor_1_position"][:, order] - truth["motors"])[:, driven])
    if not run.fixed:
        (pose,) = samples.bodies.values()
        sign = np.sign(np.sum(truth["base"][:, 3:] * pose[:, 3:], axis=1, keepdims=True))
        found.append(pose - np.hstack([truth["base"][:, :3], sign * truth["base"][:, 3:]]))
    return max(float(np.abs(difference).max()) for difference in found)


def order_of(errors: list[float]) -> float:
    """Order of convergence from h to h/4. The larger of the first two errors is used, since one may be small by chance."""
    return float(np.log2(max(errors[0], errors[1]) / errors[2]) / 2.0)


def check(run: RandomRun, folder: Path, engines: list[str], *, order: float = 1.6) -> None:
    """Fail if an engine is far from the independent solution, or if its error does not fall with the order of the method.

    At the deflection limit of a spring and at the effort limit, the torque has a corner, which reduces the order slightly.
    """
    speed, truth = truth_of(run)
    for engine in engines:
        found = errors(run, truth, folder, engine)
        assert found[0] < 5e-5 * speed, (engine, found)
        assert order_of(found) > order, (engine, found)
