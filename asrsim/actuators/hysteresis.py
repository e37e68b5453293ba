"""Hysteresis of springs: Dahl's element beside each, as pure laws (Dahl 1968; Bouc-Wen's with n = 1 and beta = gamma).

    dh/dx = (tau - sgn(dx/dt) h) / x_0        h: N m; x: deflection, rad; tau: hysteresis_torque; x_0: hysteresis_deflection

It depends on the path and not on time, is bounded by tau, and passive for every motion; it stores x_0 h^2 / (2 tau).
Between the turning points +-A a cycle takes 4 tau (A - x_0 tanh(A / x_0)).
"""

from __future__ import annotations

from collections.abc import Mapping
from math import exp

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def dahl(torque: float, change: float, level: float, length: float) -> float:
    """Torque in N m after the deflection changed by `change` rad one way: the law's solution, whatever the step.

    level: tau in N m; length: x_0 in rad.
    """
    if change > 0.0:
        return level + (torque - level) * exp(-change / length)
    return (torque + level) * exp(change / length) - level


def hysteresis_of(values: Mapping[str, float]) -> tuple[float, float] | None:
    """(tau in N m, x_0 in rad) of an actuator's parameters; None where there is none."""
    level = values.get("hysteresis_torque", 0.0)
    return (level, values["hysteresis_deflection"]) if level > 0.0 else None
