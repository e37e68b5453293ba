"""Observer of torques that act on the robot but not in the model. A controller pulls the simulated links towards the measured
positions. Its torque is the observed torque.

The controller is C(s) = M (6 w^2 s^2 + 4 w^3 s + w^4) / (s (s + 4 w)). Its input is the measured minus the simulated positions.
M is the mass matrix, and w is the bandwidth in rad/s. For links without springs and damping, all poles are at -w, also if the
mass matrix couples the links. A torque on one joint is observed only at this joint. Springs and damping increase the stability.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from asrsim.samples import Array

SLOW, FAST = 0.7, 4.0
"""Cutoff frequencies of two low-pass filters, as multiples of w. SLOW: filter of the reported torque. FAST: filter of the
torque for alarms.
"""


def filter_shares(step: float, bandwidth: float) -> Array:
    """Weight of a new value in each of the two low-pass filters, (2,). step: time step, s; bandwidth: bandwidth of the
    observer, Hz.
    """
    return np.asarray(1.0 - np.exp(-step * 2.0 * math.pi * bandwidth * np.array([SLOW, FAST])))


class Gains(NamedTuple):
    """Gains of the controller C(s) for a link of inertia 1, at a fixed time step."""

    proportional: float
    slow: float
    quick: float
    lag: float
    """Fraction of the lagged error that remains after a step."""
    share: float
    """Weight of a new position error in the lagged error, s."""
    step: float
    """Time step, s."""


def gains_of(step: float, bandwidth: float) -> Gains:
    """Gains of the controller. step: time step, s; bandwidth: bandwidth of the observer, Hz."""
    w = 2.0 * math.pi * bandwidth
    lag = math.exp(-4.0 * w * step)
    return Gains(6.0 * w**2, 0.25 * w**3, -20.25 * w**3, lag, (1.0 - lag) / (4.0 * w), step)


def respond(error: float, integral: float, lagged: float, gains: Gains) -> tuple[float, float, float]:
    """Acceleration of the link for the next step, new integral of the error, and new lagged error.

    error: measured minus simulated position, rad, NaN if the position is not measured; integral, lagged: values that the last
    step returned, 0 in the first step.
    """
    known = error == error
    if not known:
        error = 0.0
    found = gains.proportional * error + gains.slow * integral + gains.quick * lagged
    return found, integral + gains.step * error if known else 0.0, gains.lag * lagged + gains.share * error


def noise_gain(step: float, bandwidth: float) -> float:
    """Ratio of two standard deviations for a link of inertia 1 without springs and damping: torque for alarms to position
    noise, s^-2. step: time step, s; bandwidth: bandwidth of the observer, Hz.
    """
    gains, share = gains_of(step, bandwidth), float(filter_shares(step, bandwidth)[1])
    position = velocity = fast = total = integral = lagged = 0.0
    for k in range(math.ceil(20.0 / (2.0 * math.pi * bandwidth * step))):
        seen, integral, lagged = respond(position + (k == 0), integral, lagged, gains)
        velocity -= step * seen
        position += step * velocity
        fast += share * (seen - fast)
        total += fast * fast
    return math.sqrt(total)
