"""The torque that pulls a twin's links onto the measured ones: an observer of the torque that the model does not have.

It is a controller C(s) = M (6 w^2 s^2 + 4 w^3 s + w^4) / (s (s + 4 w)) on the differences of positions, M: the mass matrix.
Free links then have all their poles at -w, whatever couples them, and a torque on one joint is seen at that joint alone;
springs and damping only add to the stability.
"""

from __future__ import annotations

import math

import numpy as np

from asrsim.samples import Array

SLOW, FAST = 0.7, 4.0
"""Corners of the filters behind the torque, as multiples of w: of what is reported, and of what alarms are found from."""


def filter_shares(step: float, bandwidth: float) -> Array:
    """(2,) share of a new value in both filters; step: s, bandwidth: Hz."""
    return np.asarray(1.0 - np.exp(-step * 2.0 * math.pi * bandwidth * np.array([SLOW, FAST])))


class Observer:
    """The controllers and filters of n joints."""

    def __init__(self, joints: int, *, step: float, bandwidth: float) -> None:
        """step: s; bandwidth: Hz."""
        w = self._w = 2.0 * math.pi * bandwidth
        self._step = step
        self._gains = 6.0 * w**2, 0.25 * w**3, -20.25 * w**3
        self._lag = math.exp(-4.0 * w * step)
        self._integral, self._lagged = np.zeros(joints), np.zeros(joints)
        self.noise_gain = self._noise_gain(filter_shares(step, bandwidth)[1])
        """s^-2: deviation of the fast torque of a joint with inertia 1, over that of white noise of its position."""

    def update(self, error: Array, masses: Array, most: Array) -> Array:
        """(n,) N m for the next step, of the differences measured - twin in rad, at most `most`; NaN: nothing is measured.

        masses: (n, n) kg m^2.
        """
        known = np.isfinite(error)
        error = np.where(known, error, 0.0)
        proportional, slow, quick = self._gains
        wanted = masses @ (proportional * error + slow * self._integral + quick * self._lagged)
        torque = np.asarray(np.clip(wanted, -most, most))
        # Where the torque is clipped, the integral waits.
        self._integral += np.where(torque == wanted, self._step * error, 0.0)
        self._integral *= known
        self._lagged = self._lag * self._lagged + (1.0 - self._lag) / (4.0 * self._w) * error
        return torque

    def restart(self) -> None:
        """Forget what was seen."""
        self._integral[:] = self._lagged[:] = 0.0

    def _noise_gain(self, share: float) -> float:
        # The norm of the response to one wrong position: of a free link of inertia 1 under this very controller.
        proportional, slow, quick = self._gains
        integral = lagged = position = velocity = fast = total = 0.0
        for k in range(math.ceil(20.0 / (self._w * self._step))):
            error = float(k == 0) - position
            torque = proportional * error + slow * integral + quick * lagged
            integral += self._step * error
            lagged = self._lag * lagged + (1.0 - self._lag) / (4.0 * self._w) * error
            fast += share * (torque - fast)
            velocity += self._step * torque
            position += self._step * velocity
            total += fast * fast
        return math.sqrt(total)
