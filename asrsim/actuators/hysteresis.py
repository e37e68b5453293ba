"""Hysteresis of springs: a Dahl element parallel to each spring (Dahl 1968; the Bouc-Wen model with n = 1, beta = gamma).

    dh/dx = (tau - sgn(dx/dt) h) / x_0        h: N m; x: deflection, rad; tau: hysteresis_torque; x_0: hysteresis_deflection

The torque depends on the path, not on time. It is bounded by tau and passive for every motion; the element stores the energy
x_0 h^2 / (2 tau). A cycle between the turning points +-A dissipates 4 tau (A - x_0 tanh(A / x_0)).
"""

from __future__ import annotations

from math import exp


def dahl(torque: float, change: float, level: float, length: float) -> float:
    """Torque in N m after the deflection has changed by `change` rad in one direction: the exact solution for any step.

    torque: h before the change in N m; level: tau in N m; length: x_0 in rad.
    """
    if change > 0.0:
        return level + (torque - level) * exp(-change / length)
    return (torque + level) * exp(change / length) - level
