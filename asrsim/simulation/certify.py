"""The numerical error of a run: the run again with the step halved, twice, and Richardson's estimate from the differences."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np

from asrsim.robot.model import Robot
from asrsim.samples import Array, Samples
from asrsim.scenario.data import Scenario
from asrsim.simulation.run import Run, simulate
from asrsim.simulation.steppings import STEPPINGS

ORDER_TOLERANCE = 0.35
"""By how much the measured order may fall short of the scheme's before it is said."""
RESOLVED = 1e-12
"""rad and N m: differences at rounding level have no order."""


@dataclass(frozen=True, kw_only=True)
class JointError:
    """Estimated numerical error of one joint over the run."""

    position_max: float
    """rad (m)."""
    position_rms: float
    torque_max: float
    """N m (N)."""
    torque_rms: float
    order: float
    """Measured order of convergence of the position; NaN where the error is at rounding level."""


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """How wrong a run is, numerically."""

    stepping: str
    scheme_order: int
    step: float
    """s, the substep of the run that is certified."""
    joints: dict[str, JointError]
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, object]:
        """Plain values for JSON; NaN orders as null."""
        data = asdict(self)
        for joint in data["joints"].values():
            joint["order"] = None if math.isnan(joint["order"]) else joint["order"]
        return data


def certify(
    scenario: Scenario, run: Run, robot: Robot | None = None, *, progress: Callable[[str, float], None] | None = None
) -> Certificate:
    """Estimate the numerical error of `run`, which kept its samples, by runs at a half and a quarter of its step.

    robot: as read from its file, to read it only once. progress: told which run and its simulated time. Raises
    SimulationError if a finer run fails.
    """
    stepping = STEPPINGS.get(scenario.stepping)
    coarse = run.samples
    if coarse is None:
        coarse = _samples(scenario, robot, run, 1, progress)
    half = _samples(scenario, robot, run, 2, progress)
    quarter = _samples(scenario, robot, run, 4, progress)
    joints: dict[str, JointError] = {}
    warnings = []
    for j, name in enumerate(coarse.joints):
        position = [samples.values["link_position"][:, j] for samples in (coarse, half, quarter)]
        torque = [samples.values["link_torque"][:, j] for samples in (coarse, half, quarter)]
        order = _order(*position)
        error = _estimate(position, order, stepping.order)
        strain = _estimate(torque, order, stepping.order)
        joints[name] = JointError(
            position_max=float(np.max(np.abs(error))),
            position_rms=float(np.sqrt(np.mean(error**2))),
            torque_max=float(np.max(np.abs(strain))),
            torque_rms=float(np.sqrt(np.mean(strain**2))),
            order=order,
        )
        if order < stepping.order - ORDER_TOLERANCE:
            warnings.append(
                f"joint '{name}': the error falls with order {order:.2f}, not {stepping.order} as {stepping.name} does where "
                f"forces are smooth (friction, stops, contacts and limits lower it); the estimate uses the measured order"
            )
    return Certificate(
        stepping=stepping.name,
        scheme_order=stepping.order,
        step=scenario.step / run.resolution.substeps,
        joints=joints,
        warnings=tuple(warnings),
    )


def _samples(
    scenario: Scenario, robot: Robot | None, run: Run, finer: int, progress: Callable[[str, float], None] | None
) -> Samples:
    """The run again with a step `finer` times finer, logged at the same times."""
    resolution = run.resolution
    if STEPPINGS.get(scenario.stepping).released:
        changed = replace(scenario, step=scenario.step / finer, log_every=scenario.log_every * finer)
    else:
        changed = replace(scenario, substeps=resolution.substeps * finer, motor_substeps=resolution.motor_substeps)
    name = {1: "again", 2: "half step", 4: "quarter step"}[finer]
    tell = None if progress is None else lambda time: progress(name, time)
    samples = simulate(changed, robot, progress=tell).samples
    if samples is None or len(samples.time) == 0:
        from asrsim.errors import SimulationError

        raise SimulationError(f"the run at {name} gave no samples")
    return samples


def _order(coarse: Array, half: Array, quarter: Array) -> float:
    """Measured order of convergence from three runs."""
    first, second = float(np.sqrt(np.mean((coarse - half) ** 2))), float(np.sqrt(np.mean((half - quarter) ** 2)))
    if first < RESOLVED or second < RESOLVED:
        return math.nan
    return math.log2(first / second)


def _estimate(runs: list[Array], order: float, scheme: int) -> Array:
    """Error of the coarse run by Richardson: the difference to the quarter-step run, whose own error is 4^-order of it."""
    used = max(order, 0.5) if order < scheme - ORDER_TOLERANCE else scheme
    estimate: Array = (runs[0] - runs[2]) / (1.0 - 4.0**-used)
    return estimate
