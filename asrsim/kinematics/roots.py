"""Roots of many increasing functions at once: inverts the spring laws over a whole motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from asrsim.samples import Array

MOST_STEPS = 120
"""Largest number of evaluations; about fifteen are usual."""
TOLERANCE = 1e-11
"""rad or m: the search ends when the bracket is narrower than this."""


def increasing_roots(function: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """(n,) roots of `function`, elementwise and increasing, each between low and high (n,).

    Without a root in the interval: the end nearer to the root. Regula falsi (Illinois), with a bisection in every third step.
    """
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    with np.errstate(all="ignore"):
        f_low, f_high = function(low), function(high)
        # Without a root in the interval, the search converges to the end beyond which the root lies.
        high = np.where(f_low >= 0.0, low, high)
        low = np.where((f_high <= 0.0) & (f_low < 0.0), high, low)
        for step in range(MOST_STEPS):
            middle = 0.5 * (low + high)
            if step % 3 != 2:
                secant = (low * f_high - high * f_low) / (f_high - f_low)
                middle = np.where(np.isfinite(secant) & (secant > low) & (secant < high), secant, middle)
            value = function(middle)
            above = value >= 0.0
            # Illinois: the value at the end that stays is halved, so that both ends move.
            f_low, f_high = np.where(above, 0.5 * f_low, value), np.where(above, value, 0.5 * f_high)
            high = np.where(above, middle, high)
            low = np.where((value <= 0.0), middle, low)
            if np.all(high - low <= TOLERANCE):
                break
    return 0.5 * (low + high)
