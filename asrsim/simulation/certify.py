"""Numerical error of a run, estimated by Richardson extrapolation from runs with a half and a quarter of the step."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np

from asrsim.robot.model import Robot
from asrsim.samples import Array, Samples
from asrsim.scenario.data import Scenario
from asrsim.simulation.run import Run, simulate
from asrsim.simulation.steppings import STEPPINGS

COMPARED = ("link_position", "link_torque")
ORDER_TOLERANCE = 0.35
"""Tolerance of the measured order of convergence: an order that is lower than the order of the scheme by more than this value
is reported, and the estimate of the error uses the measured order. A higher order is not reported."""
RESOLVED = 1e-12
"""Differences below this value, in rad or N m, are rounding errors; no order of convergence is computed from such
differences."""


@dataclass(frozen=True, kw_only=True)
class JointError:
    """Estimated numerical error of one joint over the run."""

    position_max: float
    """Largest error of the joint position in rad (m)."""
    position_rms: float
    torque_max: float
    """Largest error of the joint torque in N m (N)."""
    torque_rms: float
    order: float
    """Measured order of convergence of the position; NaN where the error is at rounding level."""


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """Estimated numerical error of a run."""

    stepping: str
    scheme_order: int
    step: float
    """Substep in s of the run whose error is estimated."""
    joints: dict[str, JointError]
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, object]:
        """Plain values for JSON; NaN orders as null."""
        data = asdict(self)
        for joint in data["joints"].values():
            joint["order"] = None if math.isnan(joint["order"]) else joint["order"]
        return data


def certify(
    scenario: Scenario,
    run: Run,
    robot: Robot | None = None,
    *,
    progress: Callable[[str, float], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Certificate | None:
    """Estimate of the numerical error of `run`, computed from runs with a half and a quarter of the step of `run`. A run
    without samples is repeated.

    robot: the robot as read from its file. progress: function that receives a text and the simulated time. stop: function that
    is called regularly; if `stop` returns True, the result is None. Raises SimulationError if a finer run fails.
    """
    stepping = STEPPINGS.get(scenario.stepping)
    motions = [] if run.samples is None else [run.samples]
    for times in (1, 2, 4)[len(motions) :]:
        tell = progress and partial(progress, "finer steps")
        finer = simulate(_finer(scenario, run, times), robot, names=COMPARED, progress=tell, stop=stop)
        if finer.status == "interrupted" or finer.samples is None:
            return None
        motions.append(finer.samples)
    coarse, half, quarter = motions
    first, whole, second = differences(coarse, half), differences(coarse, quarter), differences(half, quarter)
    joints: dict[str, JointError] = {}
    warnings = []
    for j, joint in enumerate(coarse.joints):
        order = _order(float(first[1, 0, j]), float(second[1, 0, j]))
        low = order < stepping.order - ORDER_TOLERANCE
        used = max(order, 0.5) if low else stepping.order
        # Richardson: the error of the run with a quarter of the step is 4^-order times the error of the coarse run.
        scale = 1.0 / (1.0 - 4.0**-used)
        position_max, torque_max, position_rms, torque_rms = (scale * whole[:, :, j]).ravel().tolist()
        joints[joint] = JointError(
            position_max=position_max, position_rms=position_rms, torque_max=torque_max, torque_rms=torque_rms, order=order
        )
        if low:
            warnings.append(
                f"joint '{joint}': the error falls with order {order:.2f}, not {stepping.order} as {stepping.name} does "
                f"where forces are smooth (friction, stops, contacts and limits lower it); the estimate uses the measured order"
            )
    return Certificate(
        stepping=stepping.name,
        scheme_order=stepping.order,
        step=scenario.step / run.resolution.substeps,
        joints=joints,
        warnings=tuple(warnings),
    )


def _finer(scenario: Scenario, run: Run, finer: int) -> Scenario:
    """The scenario with a step that is smaller by the factor `finer`, and with unchanged logging times."""
    if STEPPINGS.get(scenario.stepping).released:
        return replace(scenario, step=scenario.step / finer, log_every=scenario.log_every * finer)
    resolution = run.resolution
    return replace(scenario, substeps=resolution.substeps * finer, motor_substeps=resolution.motor_substeps)


def _order(first: float, second: float) -> float:
    """Measured order of convergence, computed from the differences between runs with the whole, half and quarter step; NaN if
    these differences are rounding errors."""
    return math.nan if first < RESOLVED or second < RESOLVED else math.log2(first / second)


def differences(first: Samples, second: Samples) -> Array:
    """Largest and root-mean-square differences of two motions over their common length, (2, quantities of `COMPARED`, joints of
    `first`); NaN for quantities that a joint does not have."""
    count = min(len(first.time), len(second.time))
    found = np.full((2, len(COMPARED), len(first.joints)), np.nan)
    for row, name in enumerate(COMPARED):
        for j, joint in enumerate(first.joints):
            there = second.values[name][:count, second.joints.index(joint)]
            difference = np.abs(first.values[name][:count, j] - there)
            difference = difference[~np.isnan(difference)]
            if len(difference):
                found[:, row, j] = difference.max(), np.sqrt(np.mean(difference**2))
    return found
