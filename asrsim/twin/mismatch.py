"""Errors of a twin's model, estimated while nothing touches the robot by a regression of the observed torque, with forgetting.

The observed torque is the sum of the errors of spring, friction and damping, and of the external torque. A torque error on a
motor moves the motor by x: J x'' + D x' + (P + K) x = error, with the stiffness K of the spring and the gains P and D of the
controller. The spring transmits the torque K x to the link. So the columns of the regression are: the twin's spring torque
minus the motors' response to this torque; velocity and direction of the link; the motors' responses to their own velocity and
direction; and a constant. The columns are filtered with the observer's response, as the observed torque was. The parts of all
columns but the constant are subtracted from the observed torque.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from asrsim.samples import Array
from asrsim.twin.observer import ObserverResponse, filter_shares

MEMORY = 5.0
"""Time of motion in which a row loses 63 % of its weight, s."""
RUBBING = 0.05
"""Speed above which the friction torque is constant, rad/s."""
RIDGE = 1e-3
"""Regularisation of nearly collinear columns, as a fraction of each column's power."""
LEAST = 0.03
"""Smallest residual of the regression, as a fraction of the spring torque."""
CORRELATED = 6.0
"""Number of neighbouring rows with correlated errors, which count as one independent row."""
COLUMNS = 6


class Mismatch:
    """Regression of the observed torques of n joints."""

    def __init__(self, motors: Array, *, step: float, bandwidth: float, interval: float) -> None:
        """motors: inertia (kg m^2, infinite for a motor without dynamics), damping of motor and controller (N m s/rad), and
        gain of the controller (N m/rad), each (motors, n); step: duration of a step, s; bandwidth: bandwidth of the observer,
        Hz; interval: time between rows of the regression, s.
        """
        joints = motors.shape[2]
        inertia, damping, self._gain = motors
        self._step, self._kick, self._brake = step, step / inertia, 1.0 + step * damping / inertia
        self._moved, self._speed = np.zeros((3, *inertia.shape)), np.zeros((3, *inertia.shape))
        """Responses of the motors' positions and velocities to each kind of error: spring, damping and friction."""
        self._response = ObserverResponse((joints, COLUMNS - 1), step=step, bandwidth=bandwidth)
        self._shares = filter_shares(step, bandwidth)[:, None, None]
        self._keep, self._interval = 1.0 - interval / MEMORY, interval
        self._rows = np.zeros((2, joints, COLUMNS + 1))
        """Columns of the regression, then the observed torque, after the slow and the fast filter."""
        self._squares, self._products = np.zeros((joints, COLUMNS, COLUMNS)), np.zeros((joints, COLUMNS))
        self._power, self._weight = np.zeros(joints), np.zeros(joints)
        self._found = np.zeros((joints, COLUMNS))
        self.learned = np.zeros(joints, dtype=bool)
        """Whether the regression contains at least one second of motion."""
        self.spring, self.deviation = np.zeros(joints), np.full(joints, np.inf)
        """Missing spring torque as a fraction of the twin's spring torque, and its standard error."""

    def take(self, torque: Array, springs: Array, stiffness: Array, link: Array, motors: Array) -> None:
        """Add the values of a step: observed torque (n,) in N m; torques in N m and stiffnesses in N m/rad of the springs
        (motors, n); velocities of links (n,) and motors (motors, n) in rad/s.
        """
        # The direction of each velocity is its sign; below `RUBBING` it changes linearly.
        velocities = np.concatenate([link[None], motors])
        directions = np.minimum(np.maximum(velocities / RUBBING, -1.0), 1.0)
        # The integration step is implicit, so it is stable even for a light motor.
        errors, holds = np.array([springs, motors, directions[1:]]), self._gain + stiffness
        self._speed += self._kick * (errors - holds * self._moved)
        self._speed /= self._brake + self._step * self._kick * holds
        self._moved += self._step * self._speed
        spring, velocity, direction = (stiffness * self._moved).sum(axis=1)
        rows = np.empty(self._rows.shape[1:])
        rows[:, 0] = springs.sum(axis=0) - spring
        rows[:, 1], rows[:, 2] = link, velocity
        rows[:, 3], rows[:, 4] = directions[0], direction
        rows[:, 5], rows[:, 6] = 1.0, torque
        rows[:, :5] = self._response.update(rows[:, :5])
        self._rows += self._shares * (rows - self._rows)

    def external(self) -> Array:
        """External torques (2, n) after the slow and the fast filter, without the errors of the model, N m."""
        return np.asarray(self._rows[:, :, -1] - (self._rows[:, :, : COLUMNS - 1] * self._found[:, :-1]).sum(axis=-1))

    def learn(self, free: NDArray[np.bool_]) -> None:
        """Add a row to the regression of each joint that moves freely; joints at rest are left out, since friction at rest may
        have any value.
        """
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
        # With a perfect twin the residual, and therefore the standard error, would be zero.
        left = self._power - np.einsum("ji,ji->j", found, self._products / size)
        left = np.maximum(left, (LEAST * size[:, 0]) ** 2)
        rows_seen = np.maximum(self._weight, 1e-12)
        self.learned = rows_seen > 1.0 / self._interval
        self._found = found / size * self.learned[:, None]
        self.spring = self._found[:, 0]
        deviation = np.sqrt(CORRELATED * left / rows_seen * inverse[:, 0, 0]) / size[:, 0]
        self.deviation = np.where(self.learned, deviation, np.inf)
