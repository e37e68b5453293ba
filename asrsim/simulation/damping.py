"""Viscous damping of the links, implicit in the substep: how it answers torques, and how it may change with the stiffness.

The damped kick itself is :func:`asrsim.simulation.substep.make_damping`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.substep import BASE, INERTIA, RATIO

COUPLED = 0.1
"""Decay between joints in a step, c h / I, above which their damping is solved for together."""
RINGING = 0.5
"""Share of itself to which a motion that dies within a step comes back, with the other sign: less would lag, more would
ring."""


@dataclass(frozen=True)
class Response:
    """How mean velocities over a kick answer torques."""

    weight: float
    """Of the kick's change of velocity in the mean: 1/2 is the midpoint rule."""
    coupled: bool
    response: Array
    """(n, n) rad/s / N m: mean velocity of each joint per torque on each; with its damping in it if coupled."""
    spread: Array
    """(n, n): mean velocity of each joint per undamped one of each, if coupled."""


def mean_response(mass: Array, dampings: Sequence[float], substep: float, *, explicit: bool, coupled: bool | None) -> Response:
    """mass: (n, n) kg m^2; dampings: N m s/rad, one a joint; substep h in s; explicit: steppings that damp by the last
    velocity.

    The mean velocity over a kick is v + w Dv, and Dv differs from the last kick's by h M^-1 times what the torques have
    changed by. coupled: whether joints are solved for together, None: where it matters. Solved for the mean, damping is
    implicit, and midpoint (w = 1/2; explicit steppings: 0) but for what is stiff: a mode that decays by f = c h / I comes back
    as (1 - (1 - w) f) / (1 + w f), which stays above -:data:`RINGING`.
    """
    inverse = np.linalg.inv(mass)
    damping = np.asarray(dampings, dtype=float)
    root = np.sqrt(np.maximum(damping, 0.0))
    decay = substep * root[:, None] * inverse * root[None, :]
    weight = 0.0 if explicit else 0.5
    # No mode is faster than all of them together, which are seldom fast enough to be looked at one by one.
    if decay.trace() > 1.0:
        fastest = float(np.linalg.eigvalsh(decay)[-1])
        weight = max(weight, (fastest - 1.0 - RINGING) / (fastest * (1.0 + RINGING)))
    response = weight * substep * inverse
    if coupled is None:
        coupled = bool(np.abs(decay - np.diag(np.diagonal(decay))).max(initial=0.0) > COUPLED)
    spread = np.eye(len(mass))
    if coupled:
        spread = np.linalg.inv(spread + response * damping[None, :])
        response = spread @ response
    return Response(weight, coupled, np.asarray(response, dtype=float), np.asarray(spread, dtype=float))


def make_damping_law(drive: SteppedJoint) -> Callable[[Any, Any, float, tuple[float, ...]], float] | None:
    """Link damping in N m s/rad from the joint's row, its constants, q and record; None where it is constant.

    c = constant + 2 ratio sqrt(inertia stiffness): on real actuators the damping at the link changes with the stiffness
    preset (paper section 4.2.2); the toolbox keeps it fixed.
    """
    law, actuator = drive.link_damping, drive.actuator
    if law is None or actuator is None or not law.ratio or not (drive.mode and drive.mode.spring):
        return None
    stiffness, elastic_of = actuator.stiffness, drive.elastic_of

    def damping(joint: Any, constants: Any, q: float, record: tuple[float, ...]) -> float:
        # Of a record, entries 2 and 6 are the motors' positions at the kick.
        k = stiffness(q, record[2], record[6], elastic_of(constants))
        return float(joint[BASE] + 2.0 * joint[RATIO] * sqrt(max(joint[INERTIA] * k, 0.0)))

    return damping
