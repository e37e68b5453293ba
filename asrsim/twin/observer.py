"""Observer of the torque that the model lacks: the torque that pulls the twin's links to their measured positions.

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


class Controller:
    """The controller C(s) for links of inertia 1, for arrays of position errors of any shape."""

    def __init__(self, shape: int | tuple[int, ...], *, step: float, bandwidth: float) -> None:
        """step: time step, s; bandwidth: bandwidth of the observer, Hz."""
        w = self._w = 2.0 * math.pi * bandwidth
        self.step = step
        self._gains = 6.0 * w**2, 0.25 * w**3, -20.25 * w**3
        self._lag = math.exp(-4.0 * w * step)
        self.integral, self._lagged = np.zeros(shape), np.zeros(shape)

    def respond(self, error: Array) -> Array:
        """Torques for the next step from position errors. The integral is not updated here, but in `integrate`."""
        proportional, slow, quick = self._gains
        torque = proportional * error + slow * self.integral + quick * self._lagged
        self._lagged = self._lag * self._lagged + (1.0 - self._lag) / (4.0 * self._w) * error
        return np.asarray(torque)

    def integrate(self, error: Array) -> None:
        """Add the position errors of a step to the integral."""
        self.integral += self.step * error

    def restart(self) -> None:
        """Reset the state of the controller."""
        self.integral[...] = self._lagged[...] = 0.0


class ObserverResponse(Controller):
    """Response of the observer to torques on free links: the torques with the observer's delay."""

    def __init__(self, shape: int | tuple[int, ...], *, step: float, bandwidth: float) -> None:
        super().__init__(shape, step=step, bandwidth=bandwidth)
        self._error, self._velocity = np.zeros(shape), np.zeros(shape)

    def update(self, torques: Array, noise: Array | float = 0.0) -> Array:
        """Observed torques in this step; noise: errors of the measured positions."""
        error = self._error + noise
        seen = self.respond(error)
        self.integrate(error)
        self._velocity += self.step * (torques - seen)
        self._error = self._error + self.step * self._velocity
        return seen


class Observer(Controller):
    """Observer of n joints, coupled by the mass matrix."""

    def __init__(self, joints: int, *, step: float, bandwidth: float) -> None:
        super().__init__(joints, step=step, bandwidth=bandwidth)
        # Response of the fast torque to one wrong measured position.
        free, share, fast = ObserverResponse(1, step=step, bandwidth=bandwidth), filter_shares(step, bandwidth)[1], np.zeros(1)
        total = np.zeros(1)
        for k in range(math.ceil(20.0 / (self._w * step))):
            fast = fast + share * (free.update(np.zeros(1), float(k == 0)) - fast)
            total += fast * fast
        self.noise_gain = float(np.sqrt(total[0]))
        """Standard deviation of the fast torque of a joint with inertia 1 per standard deviation of position noise, s^-2."""

    def update(self, error: Array, masses: Array, most: Array) -> Array:
        """Torques (n,) for the next step, N m, from measured minus simulated positions in rad (NaN: not measured).

        masses: mass matrix (n, n), kg m^2; most: largest torques (n,), N m.
        """
        known = np.isfinite(error)
        error = np.where(known, error, 0.0)
        wanted = masses @ self.respond(error)
        torque = np.asarray(np.clip(wanted, -most, most))
        # The integral does not change while the torque is clipped.
        self.integrate(np.where(torque == wanted, error, 0.0))
        self.integral *= known
        return torque
