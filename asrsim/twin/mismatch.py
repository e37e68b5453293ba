"""Errors of a twin's model. They are estimated from the torque that the twin observes while nothing touches the robot, by a
regression that forgets old data.

Copies of the twin run beside the twin. In each copy, one kind of parameter, such as damping, is larger in all joints. The
columns of the regression are the differences between the torque that a copy observes and the torque that the twin observes.
They thus contain all effects of a parameter, also those on the motion of the motors, as seen through the observer and the
filters. The last column is constant. The contributions of all columns but the last are subtracted from the torque that the twin
observes.
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
"""Duration of motion after which a row has lost 63 % of its weight in the regression, s."""
SLOWEST = 0.05
"""Speed below which a link counts as resting, rad/s (m/s)."""
RIDGE = 1e-3
"""Regularisation for nearly collinear columns: fraction of each column's power that is added to the normal equations."""
LEAST = 0.03
"""Smallest residual that is assumed for the regression, as a fraction of the size of the springs' column."""
CORRELATED = 6.0
"""Number of successive rows whose errors are correlated, so that they count as one row in the standard error."""
SHARE, SUMMAND = 0.2, 1e-3
"""Fraction by which a parameter is larger in a copy than in the twin, and number that is also added to damping (N m s/rad) and
friction (N m), which may be 0 in the twin.
"""
KNOWN = 0.04
"""Relative standard error of a joint's stiffness below which the stiffness is reported."""
KINDS = ("springs", "damping of links", "friction of links", "damping of motors", "friction of motors")
"""Kinds of parameters; each kind is larger in one of the copies."""
COLUMNS = len(KINDS) + 3
"""Number of entries of a row: velocity, a column for each kind of parameter, the constant column, and the observed torque."""


def varied(prepared: Prepared) -> list[dict[str, Mapping[str, float]]]:
    """Parameters of each copy of a twin that differ from the twin's, by joint and name; one copy for each of `KINDS`."""
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
    """Regression of the observed torques of n joints; all arrays are updated in place."""

    products: Any
    """Weighted sums (n, kinds + 2, kinds + 2) over the rows of the products of two entries, each a column or the torque."""
    found: Any
    """Relative errors (kinds, n) of the twin's parameters: the coefficients of the regression."""
    learned: Any
    """Whether the regression contains at least one second of motion, (n,)."""
    stiffening: Any
    """Ratio of the robot's stiffness to the twin's stiffness (n,); NaN where the ratio is too uncertain."""
    normal: Any
    """Work array (kinds + 1, kinds + 5) for the normal equations; see `asrsim.engines.loops.solve_normal`."""
    size: Any
    """Work array (kinds + 2,) for the sizes of the columns and of the torque, by which the normal equations are scaled."""
    interval: float
    """Time between rows of the regression, s."""


def mismatch_of(joints: int, interval: float) -> Mismatch:
    """Regression before its first row."""
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
    """Add a row to the regression of each joint that moves without an alarm. Joints at rest are left out, since their friction
    may have any value up to the sliding friction.

    rows: velocity, columns of the regression and observed torque, all after the slow filter, (kinds + 3, n); error: position
    errors (n,) of the twin, NaN where a position is not measured; alarm: whether an alarm is raised for each joint (n,).
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
            # matrix, from which the standard error of the stiffness follows.
            normal[a, columns], normal[a, columns + 1] = products[a, columns] / size[a] / size[columns], 1.0 if a == 0 else 0.0
        solve_normal(normal, columns, columns, 2)
        found, inverse = normal[:, columns + 2], normal[:, columns + 3]
        rest = 1.0
        for a in range(columns):
            rest -= found[a] * (products[a, columns] / size[a] / size[columns])
        # Assume at least a small residual: a perfect twin would otherwise have the standard error zero.
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
