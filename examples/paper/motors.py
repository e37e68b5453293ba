"""Motor parameters of figures 11 to 15, fitted to the logged motion with Newton's law.

    P (r - theta) - tau_spring = J theta'' + (d + D) theta' + F sign(theta')

The fit uses the logged references and positions, and the paper's springs. It uses neither the actuators nor the robot
files nor the logged torques. `paper.newton` fits the links in the same way.
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
"""Inertia (kg m^2), damping (N m s/rad) and friction (N m) of the qbMove's motors (paper, table 2)."""
PROPORTIONAL, DERIVATIVE = 125.0, 4.5
"""Gains of the motor controllers, N m/rad and N m s/rad."""
LIMIT, FASTEST = 0.95 * 12.0, 0.95 * 6.0
"""Torque (N m) and speed (rad/s) up to which rows are fitted. At the limits of the motors, the equation does not hold."""
ALLOWED = (0.01, 0.01, 0.05, 0.01)
"""Tolerated relative errors of inertia, d + D, friction and gain. An error of 25 % in d is an error of 1.4 % in d + D."""


def departure(samples: Samples, springs: Sequence[Springs]) -> float:
    """Largest relative error of the fitted inertia, d + D, friction and gain of the motors, as a fraction of `ALLOWED`."""
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
    fitted = np.linalg.lstsq(np.vstack(rows), np.concatenate(errors), rcond=None)[0]
    paper = np.array([INERTIA, DAMPING + DERIVATIVE, FRICTION, 1.0]) / PROPORTIONAL
    return float(np.max(np.abs(fitted / paper - 1.0) / ALLOWED))


def qbmove_claims(results: Mapping[str, Result], law: Law, *, until: Mapping[str, float] | None = None) -> list[Claim]:
    """Claims that links and motors of each run move as the paper's links and motors do with AlterEgo's springs.

    law, until: see `motion_claims`.
    """
    runs = {name: result.samples for name, result in results.items()}
    motors = [
        Claim(
            origin="theory",
            text=f"{name}: the motors move by Newton's law with the paper's inertia, damping, friction and gains",
            quantity="largest error of a fitted number, relative to its tolerance of 1 % (friction: 5 %)",
            measured=departure(samples, [ALTEREGO] * len(samples.joints)),
            bound=at_most(1.0),
        )
        for name, samples in runs.items()
    ]
    return [*motion_claims(runs, law, until=until), *motors]
