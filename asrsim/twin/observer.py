"""Observer of the torque that the model lacks: the torque that pulls the twin's links to their measured positions.

It is the controller C(s) = M (6 w^2 s^2 + 4 w^3 s + w^4) / (s (s + 4 w)) on the differences of positions, with the mass matrix
M. All poles of free links are then at -w, whatever couples the links, and a torque on one joint appears at that joint alone;
springs and damping increase the stability.
"""

from __future__ import annotations

import math

import numpy as np

from asrsim.samples import Array

SLOW, FAST = 0.7, 4.0
"""Cutoff frequencies of the filters of the reported torque and of the torque for alarms, as multiples of w."""


def filter_shares(step: float, bandwidth: float) -> Array:
    """Weights (2,) of a new value in both filters; step: in s, bandwidth: in Hz."""
    return np.asarray(1.0 - np.exp(-step * 2.0 * math.pi * bandwidth * np.array([SLOW, FAST])))


class Observer:
    """Controllers of n joints."""

    def __init__(self, joints: int, *, step: float, bandwidth: float) -> None:
        """step: in s; bandwidth: in Hz."""
        w = self._w = 2.0 * math.pi * bandwidth
        self._step = step
        self._gains = 6.0 * w**2, 0.25 * w**3, -20.25 * w**3
        self._lag = math.exp(-4.0 * w * step)
        self._integral, self._lagged = np.zeros(joints), np.zeros(joints)
        self.noise_gain = self._noise_gain(filter_shares(step, bandwidth)[1])
        """Standard deviation of the fast torque of a joint with inertia 1 per standard deviation of position noise, s^-2."""

    def update(self, error: Array, masses: Array, most: Array) -> Array:
        """Torques (n,) for the next step, N m, from the differences measured - twin in rad (NaN: not measured).

        masses: mass matrix (n, n), kg m^2; most: largest torques (n,), N m.
        """
        known = np.isfinite(error)
        error = np.where(known, error, 0.0)
        proportional, slow, quick = self._gains
        wanted = masses @ (proportional * error + slow * self._integral + quick * self._lagged)
        torque = np.asarray(np.clip(wanted, -most, most))
        # The integral does not change while the torque is clipped.
        self._integral += np.where(torque == wanted, self._step * error, 0.0)
        self._integral *= known
        self._lagged = self._lag * self._lagged + (1.0 - self._lag) / (4.0 * self._w) * error
        return torque

    def restart(self) -> None:
        """Reset the state of the controllers."""
        self._integral[:] = self._lagged[:] = 0.0

    def _noise_gain(self, share: float) -> float:
        # Norm of the response of a free link of inertia 1 with this controller to a single wrong position.
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
