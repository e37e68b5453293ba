"""Observer of the torque that a model lacks: the torque that pulls simulated links to their measured positions.

The observer is the controller C(s) = M (6 w^2 s^2 + 4 w^3 s + w^4) / (s (s + 4 w)) on the differences of positions, with the
mass matrix M and the bandwidth w in rad/s. All poles of free links are then at -w for any coupling of the links, and a torque
on one joint is observed at this joint alone; springs and damping increase the stability.
"""

from __future__ import annotations

import math

import numpy as np

from asrsim.samples import Array

SLOW, FAST = 0.7, 4.0
"""Cutoff frequencies of the filters of the reported torque and of the torque for alarms, as multiples of w."""


def filter_shares(step: float, bandwidth: float) -> Array:
    """Weights (2,) of a new value in both low-pass filters; step: time step, s; bandwidth: bandwidth of the observer, Hz."""
    return np.asarray(1.0 - np.exp(-step * 2.0 * math.pi * bandwidth * np.array([SLOW, FAST])))


class Observer:
    """The controller C(s) for links of inertia 1, for arrays of position errors."""

    def __init__(self, shape: tuple[int, ...], *, step: float, bandwidth: float) -> None:
        """shape: shape of the position errors; step: time step, s; bandwidth: bandwidth of the observer, Hz."""
        w = self._w = 2.0 * math.pi * bandwidth
        self._step, self._lag = step, math.exp(-4.0 * w * step)
        self._gains = 6.0 * w**2, 0.25 * w**3, -20.25 * w**3
        self._integral, self._lagged = np.zeros(shape), np.zeros(shape)

    def respond(self, error: Array) -> Array:
        """Accelerations for the next step from position errors in rad; NaN: not measured."""
        known = error == error
        error = np.where(known, error, 0.0)
        proportional, slow, quick = self._gains
        found = proportional * error + slow * self._integral + quick * self._lagged
        self._lagged = self._lag * self._lagged + (1.0 - self._lag) / (4.0 * self._w) * error
        self._integral = known * (self._integral + self._step * error)
        return np.asarray(found)

    def restart(self) -> None:
        """Reset the state of the controller."""
        self._integral[...] = self._lagged[...] = 0.0


def noise_gain(step: float, bandwidth: float) -> float:
    """Standard deviation of the fast torque on a free link of inertia 1 per standard deviation of the position noise, s^-2."""
    observer, share = Observer((), step=step, bandwidth=bandwidth), filter_shares(step, bandwidth)[1]
    position = velocity = fast = total = 0.0
    for k in range(math.ceil(20.0 / (2.0 * math.pi * bandwidth * step))):
        seen = float(observer.respond(np.array(position + (k == 0))))
        velocity -= step * seen
        position += step * velocity
        fast += share * (seen - fast)
        total += fast * fast
    return math.sqrt(total)
