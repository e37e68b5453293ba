"""Errors of a twin's model. A regression with exponential forgetting estimates them from the torque that the twin observes
while nothing touches the robot.

Copies of the twin are simulated together with the twin. In each copy, one kind of parameter, such as damping, is larger in all
joints. Each column of the regression is the difference between the torques that a copy and the twin observe. Such a column
contains all effects of a parameter, including effects on the motion of the motors, after the observer and the filters. The last
column is constant. The contributions of all columns but the last are subtracted from the torque that the twin observes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from asrsim.engines.loops import solve_normal
from asrsim.simulation.prepared import Prepared
from asrsim.statics.sizing import linear_parameters

MEMORY = 5.0
"""Time of motion in which a row of the regression loses 63 % of its weight, s."""
SLOWEST = 0.05
"""A link counts as resting at or below this speed, rad/s (m/s)."""
RIDGE = 1e-3
"""Regularisation for nearly collinear columns. This fraction of each column's power is added to the diagonal of the normal
equations.
"""
LEAST = 0.03
"""Smallest residual that is assumed for the regression, as a fraction of the norm of the column of the springs."""
CORRELATED = 6.0
"""Number of successive rows that count as one row in the standard error, since their errors are correlated."""
SHARE, SUMMAND = 0.2, 1e-3
"""SHARE: fraction by which a parameter is larger in a copy than in the twin.
SUMMAND: number that is also added to damping (N m s/rad) and friction (N m), since these may be 0 in the twin.
"""
KNOWN = 0.04
"""The stiffness of a joint is reported if its relative standard error is below this value."""
KINDS = ("springs", "damping of links", "friction of links", "damping of motors", "friction of motors")
"""Kinds of parameters. Each kind is larger in one of the copies."""
COLUMNS = len(KINDS) + 3
"""Number of entries in a row of the regression: velocity, a column for each kind of parameter, the constant column, and the
observed torque.
"""


def varied(prepared: Prepared) -> list[dict[str, Mapping[str, float]]]:
    """For each copy of a twin, the parameters that differ from the twin's parameters, by joint and by name. There is one copy
    for each of `KINDS`.
    """
    tables: list[dict[str, Mapping[str, float]]] = [{} for _ in KINDS]
    for stepped in prepared.drives:
        joint, drive = stepped.joint, stepped.drive
        numbers = {"damping": joint.damping, "friction": joint.friction, **stepped.values}
        springs = linear_parameters(drive.actuator, drive.values) if drive else ()
        motors = [[name for name in numbers if name.endswith(end)] for end in ("_damping", "_friction_torque")]
        for table, names in zip(tables, (springs, ["damping"], ["friction"], *motors), strict=True):
            more = 0.0 if names is springs else SUMMAND
            table[joint.name] = {name: (1.0 + SHARE) * numbers[name] + more for name in names}
    return tables


class Mismatch(NamedTuple):
    """Regression of the observed torques of n joints. All arrays are updated in place."""

    products: Any
    """Sums (n, kinds + 2, kinds + 2) over the weighted rows of the products of two entries. An entry is a column or the
    observed torque.
    """
    found: Any
    """Coefficients (kinds, n) of the regression, which are the relative errors of the twin's parameters."""
    learned: Any
    """Whether the regression contains more than one second of motion, (n,)."""
    stiffening: Any
    """Ratio (n,) of the robot's stiffness to the twin's stiffness; NaN if the ratio is too uncertain."""
    normal: Any
    """Temporary array (kinds + 1, kinds + 5) for the normal equations; see `asrsim.engines.loops.solve_normal`."""
    size: Any
    """Temporary array (kinds + 2,) for the norms of the columns and of the torque, by which the normal equations are scaled."""
    interval: float
    """Time between two rows of the regression, s."""


def mismatch_of(joints: int, interval: float) -> Mismatch:
    """Regression that has no rows yet."""
    columns = len(KINDS) + 1
    return Mismatch(
        products=np.zeros((joints, columns + 1, columns + 1)),
        found=np.zeros((len(KINDS), joints)),
        learned=np.zeros(joints, dtype=bool),
        stiffening=np.full(joints, np.nan),
        normal=np.zeros((columns, columns + 4)),
        size=np.zeros(columns + 1),
        interval=interval,
    )


def learn(m: Mismatch, rows: Any, error: Any, alarm: Any) -> None:
    """Add a row to the regression of each joint that moves and has no alarm. Joints at rest are left out, since their friction
    may have any value up to the sliding friction.

    rows: velocity, columns of the regression and observed torque, all after the slow filter, (kinds + 3, n); error: position
    errors (n,) of the twin, NaN if a position is not measured; alarm: whether each joint has an alarm, (n,).
    """
    columns, normal = len(m.normal), m.normal
    for j in range(len(alarm)):
        if alarm[j] or error[j] != error[j] or not abs(rows[0, j]) > SLOWEST:
            continue
        products, size = m.products[j], m.size
        for a in range(columns + 1):
            for b in range(columns + 1):
                products[a, b] += rows[a + 1, j] * rows[b + 1, j] - m.interval / MEMORY * products[a, b]
            size[a] = math.sqrt(products[a, a]) + 1e-12
        for a in range(columns):
            for b in range(columns):
                normal[a, b] = products[a, b] / size[a] / size[b] + (RIDGE if a == b else 0.0)
            # Use two right-hand sides. The first gives the coefficients. The second gives the first column of the inverse
            # matrix, which is needed for the standard error of the stiffness.
            normal[a, columns], normal[a, columns + 1] = products[a, columns] / size[a] / size[columns], 1.0 if a == 0 else 0.0
        solve_normal(normal, columns, columns, 2)
        found, inverse = normal[:, columns + 2], normal[:, columns + 3]
        rest = 1.0
        for a in range(columns):
            rest -= found[a] * (products[a, columns] / size[a] / size[columns])
        # Assume at least a small residual. Otherwise a perfect twin would have a standard error of 0.
        residual = max(rest * (size[columns] * size[columns]), (LEAST * size[0]) * (LEAST * size[0]))
        # The constant column is 1, so the sum of its squares is the weighted number of rows.
        seen = max(products[columns - 1, columns - 1], 1e-12)
        m.learned[j] = seen > 1.0 / m.interval
        for a in range(columns - 1):
            m.found[a, j] = found[a] * size[columns] / size[a] if m.learned[j] else 0.0
        deviation = math.sqrt(CORRELATED * residual / seen * inverse[0]) / size[0]
        # If the robot is stiffer than the twin by a fraction x, a copy that is stiffer by x observes no torque. The coefficient
        # of the springs is then -x.
        m.stiffening[j] = 1.0 - m.found[0, j] if m.learned[j] and deviation < KNOWN else math.nan
