"""Checks of the eight cases in the paper's figure 8 against a Runge-Kutta solution with steps of 1e-5 s and against Gazebo."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from itertools import product
from typing import Any

import numpy as np

from asrsim.actuators import ACTUATORS
from asrsim.robot import load_robot
from asrsim.samples import Array
from asrsim.simulation.run import Run
from validation.check import DATA, Check
from validation.models import run

CASES = {
    "sea_k200": 1.2e-2,
    "sea_k400": 1.8e-2,
    "awas_s0.005": 1.1e-3,
    "awas_s0.04": None,
    "bavs_p0.001": 2.8e-3,
    "bavs_p0.22": 2.9e-3,
    "qbmove_p0.2": 9.6e-4,
    "qbmove_p0.6": 1.5e-3,
}
"""RMS error of Gazebo's run at 1 ms over 5 s, by case, rad. None: Gazebo is unstable in this case."""
STABLE = 5e-4
"""Bound for cases in which Gazebo is unstable, rad."""
GAZEBO_GRAVITY = 9.8


def preset_of(case: str) -> float:
    """Stiffness preset in the name of the case (SEA: none)."""
    return 0.0 if case.startswith("sea") else float(case.split("_")[1][1:])


def simulate_case(case: str, kind: str = "_ideal", **fields: Any) -> Run:
    """Simulate the run that was recorded in Gazebo: recorded URDF, reference of 0.8 rad from the start, 5 s."""
    robot = load_robot(DATA / f"gazebo_urdf/dof1_m3_step_{case}{kind}.urdf")
    options = {"duration": 5.0, **fields}
    return run(
        robot, gravity=GAZEBO_GRAVITY, references={"equilibrium_position": 0.8, "stiffness_preset": preset_of(case)}, **options
    )


def positions(result: Run) -> Array:
    """Positions (n,) of the only joint, rad."""
    if result.samples is None:
        raise ValueError("the run kept no samples")
    return result.samples.values["link_position"][:, 0]


def excess(result: Run, case: str) -> Callable[[float], float]:
    """Function of the position in rad: spring torque minus weight, from the closed-form law, N m."""
    block, link = result.robot.actuators[0], result.robot.links[1]
    law, values = ACTUATORS.get(block.actuator), block.values()
    elastic = tuple(values[parameter.name] for parameter in law.parameters)
    theta = law.motor_references(0.8, preset_of(case))
    weight = (link.mass or 0.0) * GAZEBO_GRAVITY * -link.centre_of_mass[2]
    return lambda q: sum(law.elastic_torques(q, *theta, elastic)) - weight * math.sin(q)


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def step_responses() -> Iterator[Check]:
    """RMS errors against the Runge-Kutta solution at default settings and 1 ms: at most a thirtieth of Gazebo's error."""
    truth = np.load(DATA / "ideal.npz")
    for case, gazebo in CASES.items():
        result = simulate_case(case)
        error = rms(positions(result) - truth[case][:, 1])
        bound = STABLE if gazebo is None else gazebo / 30.0
        source = "RK4 at 1e-5 s; " + ("Gazebo is unstable here" if gazebo is None else f"Gazebo {gazebo:.1e}")
        name = f"{case}, {result.resolution.substeps} substeps, omega h {result.resolution.omega_h:.2f}"
        yield Check(name=f"RMS distance over 5 s, {name}", figure=error, bound=bound, unit="rad", source=source)


def certificates() -> Iterator[Check]:
    """Ratio of the numerical error that `--certify` reports and the true error."""
    from asrsim.simulation.accuracy import certify
    from asrsim.simulation.examine import examine

    truth = np.load(DATA / "ideal.npz")
    for case, stepping in product(CASES, ("leapfrog", "euler")):
        result = simulate_case(case, stepping=stepping)
        error = positions(result) - truth[case][:, 1]
        certificate = certify(examine(result.scenario), result)
        reported = certificate["joints"]["joint"]
        ratios = (reported["position_rms"] / rms(error), reported["position_max"] / float(np.max(np.abs(error))))
        factor = max(max(ratio, 1.0 / ratio) for ratio in ratios)
        name = f"reported error / true error, {case}, {stepping}: order {reported['order']:.2f}"
        yield Check(name=name, figure=factor, bound=2.0, source="RK4 at 1e-5 s; the ratio or its inverse")


FRICTION = 0.025
"""Dry friction of the joint in the runs recorded in Gazebo, N m."""
APART = 2.5e-2
"""Bound on the RMS difference over 5 s, rad. The error of Gazebo's own time step of 1 ms is 1e-3 to 2e-2 rad."""


def recorded(case: str, kind: str) -> Array:
    """Positions (n,) of the run recorded in Gazebo, rad."""
    names = {run["run"]: run["columns"] for run in json.loads((DATA / "gazebo.json").read_text(encoding="utf-8"))["runs"]}
    name = f"dof1_m3_step_{case}{kind}"
    with np.load(DATA / "gazebo.npz") as runs:
        return np.asarray(runs[name][:, names[name].index("q")])


def gazebo() -> Iterator[Check]:
    """Differences from Gazebo's runs with friction and limits, and rest positions relative to the friction band."""
    for case, error in CASES.items():
        if error is None:
            continue
        ours, theirs = simulate_case(case, ""), recorded(case, "")
        q = positions(ours)[: len(theirs)]
        yield Check(
            name=f"RMS distance to Gazebo, {case}", figure=rms(q - theirs), bound=APART, unit="rad", source="gazebo.npz"
        )
        for who, end in (("asrsim", float(q[-1])), ("Gazebo", float(theirs[-1]))):
            share = abs(excess(ours, case)(end)) / FRICTION
            name = f"rest position under friction, {case}, {who}"
            yield Check(name=name, figure=share, bound=1.0 + 1e-6, source="holding torque / tau_f")
