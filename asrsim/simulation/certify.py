"""The numerical error of a run: the run again with the step halved, twice, and Richardson's estimate from the differences.

All runs go side by side, and what they differ by is summed up as they go: memory does not grow with the duration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace

import numpy as np

from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.simulation.run import Run, blame_laws
from asrsim.simulation.side_by_side import COMPARED, Track, laggard
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
    scenario: Scenario,
    run: Run,
    robot: Robot | None = None,
    *,
    progress: Callable[[str, float], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Certificate | None:
    """Estimate the numerical error of `run` by runs at a half and a quarter of its step; one that kept no samples runs again.

    robot: as read from its file, to read it only once. progress: told what goes on and the simulated time. stop: asked now and
    then; if it says True there is no certificate. Raises SimulationError if a finer run fails.
    """
    stepping = STEPPINGS.get(scenario.stepping)
    differences = _Differences()
    with blame_laws(), ExitStack() as stack:
        tracks = [Track(stack, _finer(scenario, run, finer), robot) for finer in (2, 4)]
        if run.samples is None:
            tracks.insert(0, Track(stack, scenario, robot))
        else:
            tracks.insert(0, Track(stack, None, robot))
            tracks[0].write(run.samples)
        while any(track.running for track in tracks):
            if stop is not None and stop():
                return None
            laggard(tracks).advance()
            differences.add(*tracks)
            if progress is not None:
                progress("finer steps", min(track.time for track in tracks[1:]))
    joints: dict[str, JointError] = {}
    warnings = []
    for j, joint in enumerate(run.info.joints):
        order = differences.order(j)
        used = max(order, 0.5) if order < stepping.order - ORDER_TOLERANCE else stepping.order
        # Richardson: of the difference to the run of a quarter step, whose own error is 4^-order of the coarse one's.
        scale = 1.0 / (1.0 - 4.0**-used)
        position, torque = differences.of("link_position", j), differences.of("link_torque", j)
        joints[joint.name] = JointError(
            position_max=scale * position[0],
            position_rms=scale * position[1],
            torque_max=scale * torque[0],
            torque_rms=scale * torque[1],
            order=order,
        )
        if order < stepping.order - ORDER_TOLERANCE:
            warnings.append(
                f"joint '{joint.name}': the error falls with order {order:.2f}, not {stepping.order} as {stepping.name} does "
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
    """The scenario with a step `finer` times finer, logged at the same times."""
    if STEPPINGS.get(scenario.stepping).released:
        return replace(scenario, step=scenario.step / finer, log_every=scenario.log_every * finer)
    resolution = run.resolution
    return replace(scenario, substeps=resolution.substeps * finer, motor_substeps=resolution.motor_substeps)


class _Differences:
    """Sums of what three runs differ by."""

    def __init__(self) -> None:
        self._samples = 0
        self._first: Array | float = 0.0
        """Sum of the squared differences of the coarse run and the half step's, (quantities, joints)."""
        self._second: Array | float = 0.0
        """Of half step and quarter step."""
        self._whole: Array | float = 0.0
        """Of coarse run and quarter step."""
        self._largest: Array | float = 0.0

    def add(self, *tracks: Track) -> None:
        """Compare the rows that all three runs have."""
        count = min(track.count for track in tracks)
        if count:
            coarse, half, quarter = (track.take(count) for track in tracks)
            self._samples += count
            self._first = self._first + np.sum((coarse - half) ** 2, axis=0)
            self._second = self._second + np.sum((half - quarter) ** 2, axis=0)
            self._whole = self._whole + np.sum((coarse - quarter) ** 2, axis=0)
            self._largest = np.maximum(self._largest, np.max(np.abs(coarse - quarter), axis=0))

    def order(self, joint: int) -> float:
        """Measured order of convergence of the position, NaN at rounding level."""
        first, second = (self._rms(sums, 0, joint) for sums in (self._first, self._second))
        return math.nan if first < RESOLVED or second < RESOLVED else math.log2(first / second)

    def of(self, quantity: str, joint: int) -> tuple[float, float]:
        """Largest and RMS difference of coarse run and quarter step."""
        row = COMPARED.index(quantity)
        return float(np.asarray(self._largest)[row, joint]), self._rms(self._whole, row, joint)

    def _rms(self, sums: Array | float, row: int, joint: int) -> float:
        return math.sqrt(float(np.asarray(sums)[row, joint]) / self._samples)
