"""Link damping that grows with the stiffness. The paper mentions this effect in section 4.2.2, but does not model it.

c(k) = c_URDF + ratio 2 sqrt(I k), with the current stiffness k and the inertia I that the joint moves. The paper gives no
law. This law keeps the damping ratio of a joint constant for all presets, as damping inside a flexible element does to
first order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from asrsim import Result
    from asrsim.samples import Array

RATIO = 0.3
"""Damping ratio that the law adds."""


def damping_overrides(result: Result) -> tuple[str, ...]:
    """Overrides that switch the law on, with the inertia of each joint at the end of the run.

    Inertia: torque per unit acceleration while the other joints rest.
    """
    from asrsim.robot.dynamics import robot_model

    run = result.run
    model = robot_model(run.scenario, run.robot)
    inertias = np.diag(model.mass_matrix([float(result[joint].link_position[-1]) for joint in model.joints]))
    return tuple(
        f"link_damping.{joint}={{ratio: {RATIO}, inertia: {float(inertia)!r}}}"
        for joint, inertia in zip(model.joints, inertias, strict=True)
    )


def swings(values: Array, goal: float) -> int:
    """Number of turning points of a series (n,) after its first arrival at `goal`; swings below 2 % of the step are ignored."""
    x = values - goal
    floor = 0.02 * abs(float(x[0]))
    state = np.where(x > floor, 1, np.where(x < -floor, -1, 0))
    state = state[state != 0]
    return int(np.sum(np.diff(state) != 0))
