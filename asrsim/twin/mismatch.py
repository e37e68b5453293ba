"""Errors of a twin's model. While nothing touches the robot, they are estimated by a regression of the observed torque that
forgets old data.

Copies of the twin run beside the twin. In each copy, one kind of parameter has another value in all joints. The columns of the
regression are the differences between the observed torques of the copies and of the twin. They contain all effects of the
parameter: the motion of the motors, the delay of the observer, and the filters. The last column is constant. The contributions
of all other columns are subtracted from the observed torque.
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
"""Duration of motion after which a row of the regression has lost 63 % of its weight, s."""
SLOWEST = 0.05
"""Speed below which a link counts as resting, rad/s (m/s)."""
RIDGE = 1e-3
"""Regularisation of nearly collinear columns, as a fraction of each column's power."""
LEAST = 0.03
"""Smallest residual of the regression, as a fraction of the power of the springs' column."""
CORRELATED = 6.0
"""Number of successive rows whose errors are correlated; together they count as one independent row."""
SHARE, SUMMAND = 0.2, 1e-3
"""Fraction by which parameters are larger in the copies; number that is also added to damping (N m s/rad) and friction (N
m).
"""
KNOWN = 0.04
"""Largest relative standard error at which a stiffness is reported."""
KINDS = ("springs", "damping of links", "friction of links", "damping of motors", "friction of motors")
"""Kinds of parameters that differ in the copies."""
COLUMNS = len(KINDS) + 3
"""Number of columns of a row: velocity, regression, observed torque."""


def varied(prepared: Prepared) -> list[dict[str, Mapping[str, float]]]:
    """Parameters of the copies of a twin, by joint and name: one table for each of `KINDS`."""
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
    """Weighted sums (n, kinds + 2, kinds + 2) of the products of columns and torque."""
    found: Any
    """Errors of the parameters (kinds, n), as fractions."""
    learned: Any
    """Whether the regression contains at least one second of motion, (n,)."""
    stiffening: Any
    """Ratio of the robot's stiffness to the twin's stiffness (n,); NaN: too uncertain."""
    normal: Any
    """Work space (kinds + 1, kinds + 5); see `asrsim.engines.loops.solve_normal`."""
    size: Any
    """Scratch array (kinds + 2,) for the scales of the normal equations."""
    interval: float
    """Time between rows of the regression, s."""


def mismatch_of(joints: int, interval: float) -> Mismatch:
    """Regression without rows."""
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
    """Add a row to the regression of each joint that moves freely; joints at rest are left out, since friction at rest may have
    any value.

    rows: velocity, columns of the regression and observed torque after the slow filter, (kinds + 3, n); error: of the twin's
    positions (n,), NaN: not measured; alarm: of each joint (n,).
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
            # Two right-hand sides: the first gives the estimates, the second the first column of the inverse matrix.
            normal[a, columns], normal[a, columns + 1] = products[a, columns] / size[a] / size[columns], 1.0 if a == 0 else 0.0
        solve_normal(normal, columns, columns, 2)
        found, inverse = normal[:, columns + 2], normal[:, columns + 3]
        rest = 1.0
        for a in range(columns):
            rest -= found[a] * (products[a, columns] / size[a] / size[columns])
        # With a perfect twin the residual, and therefore the standard error, would be zero.
        residual = max(rest * (size[columns] * size[columns]), (LEAST * size[0]) * (LEAST * size[0]))
        # The squares of the constant column add up to the number of rows.
        seen = max(products[columns - 1, columns - 1], 1e-12)
        m.learned[j] = seen > 1.0 / m.interval
        for a in range(columns - 1):
            m.found[a, j] = found[a] * size[columns] / size[a] if m.learned[j] else 0.0
        deviation = math.sqrt(CORRELATED * residual / seen * inverse[0]) / size[0]
        # A stiffer copy needs less torque to follow the robot.
        m.stiffening[j] = 1.0 - m.found[0, j] if m.learned[j] and deviation < KNOWN else math.nan
