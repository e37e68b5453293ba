"""The numerical error of a run: the run again with the step halved, twice, and Richardson's estimate from the differences.

All runs go side by side, and what they differ by is summed up as they go: memory does not grow with the duration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace

from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario
from asrsim.simulation.run import Run, blame_laws
from asrsim.simulation.side_by_side import Differences, Track, rows_of_all
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
    first, second, whole = (Differences(len(run.info.joints)) for _ in range(3))
    with blame_laws(), ExitStack() as stack:
        finer = [Track(stack, _finer(scenario, run, times), robot) for times in (2, 4)]
        coarse = Track(stack, scenario if run.samples is None else [run.samples], robot)
        for one, half, quarter in rows_of_all([coarse, *finer]):
            if stop is not None and stop():
                return None
            first.add(one, half)
            second.add(half, quarter)
            whole.add(one, quarter)
            if progress is not None:
                progress("finer steps", min(track.time for track in finer))
    joints: dict[str, JointError] = {}
    warnings = []
    for j, joint in enumerate(run.info.joints):
        order = _order(first.of("link_position", j)[1], second.of("link_position", j)[1])
        used = max(order, 0.5) if order < stepping.order - ORDER_TOLERANCE else stepping.order
        # Richardson: of the difference to the run of a quarter step, whose own error is 4^-order of the coarse one's.
        scale = 1.0 / (1.0 - 4.0**-used)
        position, torque = whole.of("link_position", j), whole.of("link_torque", j)
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


def _order(first: float, second: float) -> float:
    """Measured order of convergence, from what halving the step changes, and halving it again; NaN at rounding level."""
    return math.nan if first < RESOLVED or second < RESOLVED else math.log2(first / second)
