"""What the motors of figures 11 to 15 are, read from their logged motion by Newton's law, as `newton` reads the links.

    P (r - theta) - tau_spring = J theta'' + (d + D) theta' + F sign(theta')

with the references and positions that the log has, and the paper's springs. Nothing comes from the actuators, the robots'
files or the logged torques.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from asrsim.reproduce import Claim, at_most
from paper.newton import ALTEREGO, Springs, differences, motion_claims, sliding

if TYPE_CHECKING:
    from collections.abc import Mapping

    from asrsim import Result
    from asrsim.samples import Samples
    from paper.newton import Law

INERTIA, DAMPING, FRICTION = 0.0233, 0.2698, 0.02
"""kg m^2, N m s/rad, N m: the qbMove's motors (paper table 2)."""
PROPORTIONAL, DERIVATIVE = 125.0, 4.5
"""N m/rad, N m s/rad, of their controllers."""
LIMIT, FASTEST = 0.95 * 12.0, 0.95 * 6.0
"""N m, rad/s: short of the motors' own, at which they obey another law."""
ALLOWED = (0.01, 0.01, 0.05, 0.01)
"""Shares by which inertia, d + D, friction and gain may be off: 25 % of the damping d are 1.4 % of d + D."""


def departure(samples: Samples, springs: Sequence[Springs]) -> float:
    """How far inertia, d + D, friction and gain of the motors, by least squares, are off the paper's, as a share of ALLOWED."""
    step = float(samples.time[1] - samples.time[0])
    links, middle, apart = (samples.values[name] for name in ("link_position", "reference_1", "reference_2"))
    rows, errors = [], []
    for j, spring in enumerate(springs):
        motors = samples.values["motor_1_position"][:, j], samples.values["motor_2_position"][:, j]
        for theta, reference, torque in zip(
            motors, (middle[:, j] + apart[:, j], middle[:, j] - apart[:, j]), spring.torques(links[:, j], motors), strict=True
        ):
            v, acceleration = differences(theta, step)
            error = (reference - theta)[1:-1]
            free = np.abs(PROPORTIONAL * error - DERIVATIVE * v) < LIMIT
            use = sliding(v) & (np.abs(v) < FASTEST)
            use[1:-1] &= free[:-2] & free[1:-1] & free[2:]
            rows.append(np.column_stack([acceleration, v, np.sign(v), torque[1:-1]])[use])
            errors.append(error[use])
    found = np.linalg.lstsq(np.vstack(rows), np.concatenate(errors), rcond=None)[0]
    paper = np.array([INERTIA, DAMPING + DERIVATIVE, FRICTION, 1.0]) / PROPORTIONAL
    return float(np.max(np.abs(found / paper - 1.0) / ALLOWED))


def qbmove_claims(results: Mapping[str, Result], law: Law, *, until: Mapping[str, float] | None = None) -> list[Claim]:
    """That each run's links and motors move as the paper's with AlterEgo's springs. law, until: of :func:`motion_claims`."""
    runs = {name: result.samples for name, result in results.items()}
    motors = [
        Claim(
            origin="theory",
            text=f"{name}: the motors move as Newton's law with the paper's inertia, damping, friction and gains has it",
            quantity="how far the worst of them, read from the motion, is off, over the 1 % (friction 5 %) that it may be",
            measured=departure(samples, [ALTEREGO] * len(samples.joints)),
            bound=at_most(1.0),
        )
        for name, samples in runs.items()
    ]
    return [*motion_claims(runs, law, until=until), *motors]
