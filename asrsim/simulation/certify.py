"""Numerical error of a run, estimated by Richardson extrapolation from runs with a half and a quarter of the step."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

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
    found: list[Array] = []
    earlier: list[Array] = []
    for times in (1, 2, 4):
        comparison = Comparison(scenario, earlier, keep=times < 4)
        if times == 1 and run.samples is not None:
            comparison.write(run.samples)
        else:
            tell = progress and partial(progress, "finer steps")
            options: Any = {"sinks": [comparison], "keep": False, "names": COMPARED, "progress": tell, "stop": stop}
            if simulate(_finer(scenario, run, times), robot, **options).status == "interrupted":
                return None
        found += comparison.differences
        earlier.append(comparison.motion)
    first, whole, second = found
    joints: dict[str, JointError] = {}
    warnings = []
    for j, joint in enumerate(part.name for part in run.info.joints):
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


class Comparison:
    """A sink that compares a motion with earlier motions (samples, quantities of `COMPARED`, joints), chunk by chunk. With
    `keep`, the motion is stored."""

    def __init__(self, scenario: Scenario, earlier: Sequence[Array], *, keep: bool) -> None:
        self._earlier, self._keep, self._count = tuple(earlier), keep, 0
        self._samples = scenario.steps // scenario.log_every + 1
        self._stored = np.empty((0, 0, 0))
        self._found: list[tuple[Array, Array, Array]] = []
        """Largest difference, sum of squared differences and number of differences, for each earlier motion."""

    def write(self, samples: Samples) -> None:
        """Compare the next samples."""
        rows = np.stack([samples.values[name] for name in COMPARED], axis=1)
        shape = rows.shape[1:]
        if not self._count:
            self._found = [(np.full(shape, np.nan), np.zeros(shape), np.zeros(shape)) for _ in self._earlier]
            self._stored = np.empty((self._samples if self._keep else 0, *shape))
        part = slice(self._count, self._count + len(rows))
        self._count = part.stop
        for other, (largest, squares, number) in zip(self._earlier, self._found, strict=True):
            # The earlier motion may be shorter, if that run diverged.
            beside = other[part]
            difference = np.abs(beside - rows[: len(beside)])
            largest[:] = np.fmax(largest, np.fmax.reduce(difference, axis=0, initial=np.nan))
            squares += np.nansum(difference**2, axis=0)
            number += np.isfinite(difference).sum(axis=0)
        if self._keep:
            self._stored[part] = rows

    @property
    def motion(self) -> Array:
        """The stored motion."""
        return self._stored[: self._count]

    @property
    def differences(self) -> list[Array]:
        """Largest and root-mean-square differences from each earlier motion, (2, quantities, joints), over the common length;
        NaN for quantities that a joint does not have. Empty if the run has no samples."""
        with np.errstate(invalid="ignore"):
            return [np.stack([largest, np.sqrt(squares / number)]) for largest, squares, number in self._found]
