"""Viscous damping of the links, implicit in the loop: how it answers torques, and how it may change with the stiffness.

The damped kick itself is :func:`asrsim.simulation.kernels.damp`, which the plain and the compiled loop share.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from asrsim.samples import Array
from asrsim.simulation.drives import Drive

COUPLED = 0.25
"""c h / I between joints above which their damping is bounded by the row's sum."""


def mean_response(mass: Array, dampings: Sequence[float], substep: float) -> tuple[list[float], list[float]]:
    """Half a kick's velocity per torque of each joint, h / 2 (M^-1)_jj, for the mean velocity that damping acts on; and lean.

    mass: (n, n) kg m^2; dampings: N m s/rad, one a joint; substep h in s. lean: by how much more than half the kick's change
    counts in the mean, 0 but for joints whose motion dies within a step.

    Over a kick that mean is v + Dv / 2, and Dv differs from the last kick's v - u by h M^-1 times what the torques of
    actuator and damping have changed by. Solved for the mean, damping is implicit, and midpoint for what is stiff;
    only second-order terms depend on the response, so the diagonal, now and then, will do.
    """
    inverse = np.linalg.inv(mass)
    root = np.sqrt(np.array(dampings))
    decay = substep * root[:, None] * inverse * root[None, :]
    own = np.diagonal(decay)
    coupled = np.sum(np.abs(decay), axis=1) - own
    # Where damping couples joints strongly (light links on light links), the row's sum bounds it: implicit, so stable.
    felt = np.where(coupled > COUPLED, own + coupled, own)
    # Midpoint, but for a joint whose motion dies within a step: there the midpoint rule would ring.
    weight = np.maximum(0.5, 1.0 - 1.0 / np.maximum(felt, 1e-12))
    scale = np.divide(felt, own, out=np.ones_like(own), where=own > 0.0)
    response: list[float] = (weight * substep * np.diagonal(inverse) * scale).tolist()
    return response, (weight - 0.5).tolist()


def make_damping_law(drive: Drive, lag: float) -> Callable[[float, Any, float, float], float] | None:
    """Additional link damping in N m s/rad as a function of link position, motor state and references, or None (the default).

    c = constant + 2 ratio sqrt(inertia stiffness): on real actuators the damping at the link changes with the stiffness
    preset (paper section 4.2.2); the toolbox keeps it fixed. lag: s by which motors' states are behind the link's.
    """
    law, actuator = drive.link_damping, drive.actuator
    if law is None or actuator is None or not (drive.mode and drive.mode.spring):
        return None if law is None or not law.constant else lambda q, state, first, second: law.constant
    elastic, motors = drive.elastic, drive.dynamic_motors

    def damping(q: float, state: Any, first: float, second: float) -> float:
        # Ideal motors and an adjuster stand at their references.
        theta_1 = state[0] + lag * state[1] if motors else first
        theta_2 = state[4] + lag * state[5] if motors > 1 else second
        stiffness = actuator.stiffness(q, theta_1, theta_2, elastic)
        return float(law.constant + 2.0 * law.ratio * max(law.inertia * stiffness, 0.0) ** 0.5)

    return damping
