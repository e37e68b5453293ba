"""What a twin has wrong, found while nothing touches the robot: a regression of the observed torque, with forgetting.

The observed torque is that of spring, friction and damping which the twin has too little, plus what is really external. The
columns are the twin's spring torque, sign and size of the velocities of link and motors, and a constant. All but the constant
are taken off the external torque.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from asrsim.samples import Array
from asrsim.twin.observer import filter_shares

MEMORY = 5.0
"""s of motion in which a row loses 63 % of its weight."""
RUBBING = 0.05
"""rad/s, speed above which friction has its whole level."""
RIDGE = 1e-3
"""Share of each column's power that keeps columns apart which look alike."""
LEAST = 0.03
"""Share of the spring torque that is never explained."""
CORRELATED = 6.0
"""Rows that count as one: neighbours have the same error."""
COLUMNS = 6


class Mismatch:
    """Of n joints."""

    def __init__(self, joints: int, *, step: float, bandwidth: float, interval: float) -> None:
        """step: s; bandwidth: Hz of the observer; interval: s between rows of the regression."""
        self._shares = filter_shares(step, bandwidth)[:, None, None]
        self._keep, self._interval = 1.0 - interval / MEMORY, interval
        self._rows = np.zeros((2, joints, COLUMNS + 1))
        """Columns, and behind them the torque, through the slow and the fast filter."""
        self._squares, self._products = np.zeros((joints, COLUMNS, COLUMNS)), np.zeros((joints, COLUMNS))
        self._power, self._weight = np.zeros(joints), np.zeros(joints)
        self._found = np.zeros((joints, COLUMNS))
        self.learned = np.zeros(joints, dtype=bool)
        """Whether a second of motion has been seen."""
        self.spring, self.deviation = np.zeros(joints), np.full(joints, np.inf)
        """Spring torque that the twin has too little, as a share, and its standard error."""

    def take(self, torque: Array, spring: Array, link: Array, motor: Array) -> None:
        """Take in a step: observed torque and the twin's spring torque in N m, velocities in rad/s."""
        rows = np.empty(self._rows.shape[1:])
        rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 5], rows[:, 6] = spring, link, motor, 1.0, torque
        rows[:, 3:5] = np.minimum(np.maximum(rows[:, 1:3] / RUBBING, -1.0), 1.0)
        self._rows += self._shares * (rows - self._rows)

    def external(self) -> Array:
        """(2, n) N m through the slow and the fast filter, without what the twin has wrong."""
        return np.asarray(self._rows[:, :, -1] - (self._rows[:, :, : COLUMNS - 1] * self._found[:, :-1]).sum(axis=-1))

    def learn(self, free: NDArray[np.bool_]) -> None:
        """A row of the regression, of the joints that nothing touches and that move: at rest friction may have any value."""
        rows, torque, moves = self._rows[0, :, :-1], self._rows[0, :, -1], np.abs(self._rows[0, :, 1]) > RUBBING
        gain = (free & moves).astype(float)
        keep = 1.0 - (1.0 - self._keep) * gain
        self._squares = keep[:, None, None] * self._squares + (gain[:, None] * rows)[:, :, None] * rows[:, None, :]
        self._products = keep[:, None] * self._products + (gain * torque)[:, None] * rows
        self._power = keep * self._power + gain * torque * torque
        self._weight = keep * self._weight + gain
        size = np.sqrt(np.einsum("jii->ji", self._squares)) + 1e-12
        scaled = self._squares / size[:, :, None] / size[:, None, :]
        inverse = np.linalg.inv(scaled + RIDGE * np.eye(COLUMNS))
        found = np.einsum("jik,jk->ji", inverse, self._products / size)
        # A perfect twin leaves nothing, and at rest it shows nothing either.
        left = self._power - np.einsum("ji,ji->j", found, self._products / size)
        left = np.maximum(left, (LEAST * size[:, 0]) ** 2)
        rows_seen = np.maximum(self._weight, 1e-12)
        self.learned = rows_seen > 1.0 / self._interval
        self._found = found / size * self.learned[:, None]
        self.spring = self._found[:, 0]
        deviation = np.sqrt(CORRELATED * left / rows_seen * inverse[:, 0, 0]) / size[:, 0]
        self.deviation = np.where(self.learned, deviation, np.inf)
