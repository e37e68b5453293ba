"""Errors of a twin's model, estimated while nothing touches the robot by a regression of the observed torque, with forgetting.

Copies of the twin run beside the twin. In each copy one kind of parameter differs in all joints. The columns of the regression
are the differences between the observed torques of the copies and of the twin. They contain all effects of the parameter: the
motion of the motors, the delay of the observer, and the filters. The last column is constant. The contributions of all other
columns are subtracted from the observed torque.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from asrsim.samples import Array
from asrsim.simulation.prepare import Prepared
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
"""Fraction by which parameters are larger in the copies; number added to damping (N m s/rad) and friction (N m) as well."""
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


class Mismatch:
    """Regression of the observed torques of n joints."""

    def __init__(self, rows: Array, *, interval: float) -> None:
        """rows: velocity, columns of the regression and observed torque, after the slow and the fast filter,
        (2, `COLUMNS`, n), which the twin updates; interval: time between rows of the regression, s."""
        self._rows, self._interval = rows, interval
        joints = rows.shape[-1]
        self._products = np.zeros((joints, len(KINDS) + 2, len(KINDS) + 2))
        """Weighted sums of the products of columns and torque."""
        self.found = np.zeros((len(KINDS), joints))
        """Errors of the parameters (kinds, n), as fractions."""
        self.learned = np.zeros(joints, dtype=bool)
        """Whether the regression contains at least one second of motion."""
        self.spring, self.deviation = np.zeros(joints), np.full(joints, np.inf)
        """Excess of the robot's spring torques over the twin's, as a fraction, and its standard error."""

    @property
    def moves(self) -> NDArray[np.bool_]:
        """Whether each link moves."""
        return np.asarray(np.abs(self._rows[0, 0]) > SLOWEST)

    def learn(self, free: NDArray[np.bool_]) -> None:
        """Add a row to the regression of each joint that moves freely; joints at rest are left out, since friction at rest may
        have any value.
        """
        rows = self._rows[0, 1:].T
        gain = (free & self.moves).astype(float)[:, None, None]
        self._products += gain * (rows[:, :, None] * rows[:, None, :] - self._interval / MEMORY * self._products)
        size = np.sqrt(np.einsum("jii->ji", self._products)) + 1e-12
        correlations = self._products / size[:, :, None] / size[:, None, :]
        inverse = np.linalg.inv(correlations[:, :-1, :-1] + RIDGE * np.eye(len(KINDS) + 1))
        found = np.einsum("jik,jk->ji", inverse, correlations[:, :-1, -1])
        residual = (1.0 - (found * correlations[:, :-1, -1]).sum(axis=1)) * size[:, -1] ** 2
        # With a perfect twin the residual, and therefore the standard error, would be zero.
        residual = np.maximum(residual, (LEAST * size[:, 0]) ** 2)
        # The squares of the constant column add up to the number of rows.
        rows_seen = np.maximum(self._products[:, -2, -2], 1e-12)
        self.learned = rows_seen > 1.0 / self._interval
        self.found = np.ascontiguousarray((found * size[:, -1:] / size[:, :-1] * self.learned[:, None]).T[:-1])
        # A stiffer copy needs less torque to follow the robot.
        self.spring = -self.found[0]
        deviation = np.sqrt(CORRELATED * residual / rows_seen * inverse[:, 0, 0]) / size[:, 0]
        self.deviation = np.where(self.learned, deviation, np.inf)
