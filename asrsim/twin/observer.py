"""Observer of the torque that a model lacks: the torque that pulls simulated links towards their measured positions.

The observer is the controller C(s) = M (6 w^2 s^2 + 4 w^3 s + w^4) / (s (s + 4 w)) on the differences of positions, with the
mass matrix M and the bandwidth w in rad/s. All poles of free links are then at -w for any coupling of the links, and a torque
on one joint is observed at this joint alone; springs and damping increase the stability.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from asrsim.samples import Array

SLOW, FAST = 0.7, 4.0
"""Cutoff frequencies of the filters of the reported torque and of the torque for alarms, as multiples of w."""


def filter_shares(step: float, bandwidth: float) -> Array:
    """Weights (2,) of a new value in both low-pass filters; step: time step, s; bandwidth: bandwidth of the observer, Hz."""
    return np.asarray(1.0 - np.exp(-step * 2.0 * math.pi * bandwidth * np.array([SLOW, FAST])))


class Gains(NamedTuple):
    """Numbers of the controller C(s) for a link of inertia 1."""

    proportional: float
    slow: float
    quick: float
    lag: float
    """Fraction of the lagged error that remains after a step, and weight of a new error in it."""
    share: float
    step: float
    """Time step, s."""


def gains_of(step: float, bandwidth: float) -> Gains:
    """Gains of the controller; step: time step, s; bandwidth: bandwidth of the observer, Hz."""
    w = 2.0 * math.pi * bandwidth
    lag = math.exp(-4.0 * w * step)
    return Gains(6.0 * w**2, 0.25 * w**3, -20.25 * w**3, lag, (1.0 - lag) / (4.0 * w), step)


def respond(error: float, integral: float, lagged: float, gains: Gains) -> tuple[float, float, float]:
    """Acceleration for the next step from a position error in rad (NaN: not measured), and the new integral and lagged error.
    The controller starts with zeros.
    """
    known = error == error
    if not known:
        error = 0.0
    found = gains.proportional * error + gains.slow * integral + gains.quick * lagged
    return found, integral + gains.step * error if known else 0.0, gains.lag * lagged + gains.share * error


def noise_gain(step: float, bandwidth: float) -> float:
    """Standard deviation of the fast torque on a free link of inertia 1 per standard deviation of the position noise, s^-2."""
    gains, share = gains_of(step, bandwidth), float(filter_shares(step, bandwidth)[1])
    position = velocity = fast = total = integral = lagged = 0.0
    for k in range(math.ceil(20.0 / (2.0 * math.pi * bandwidth * step))):
        seen, integral, lagged = respond(position + (k == 0), integral, lagged, gains)
        velocity -= step * seen
        position += step * velocity
        fast += share * (seen - fast)
        total += fast * fast
    return math.sqrt(total)
